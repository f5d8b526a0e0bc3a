"""One calibration as a robot's history sees it: when it was driven, what came out, how certain that is."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

import numpy as np

from boxcal.calib.geometry.parameters import WHEELS
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.each_camera import each_camera
from boxcal.calib.results.verdict import Level
from boxcal.detect.log.remote.store import tells_content
from boxcal.target.arrays import Array

_EARLIEST_NS = 1_262_304_000 * 10**9
"""2010, before there was anything that records such logs: a drive dated earlier comes from a clock that was not set."""
_DAY_NS = 86_400 * 10**9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Session:
    """One calibration of one robot.

    Attributes
    ----------
    robot
        Its name.
    key
        Of the drive: the same for every calibration from the same logs.
    t_ns : ns
        When the robot drove, since 1970 (UTC).
    calibrated
        When it was calibrated, UTC, ISO 8601.
    camera : (5,), px
        fu, fv, cu, cv and the first radial coefficient.
    wheels : (3,), m
        rR, rL, b.
    T_body_cam : (4, 4), m
        Camera extrinsics.
    covariance : (14, 14)
        Of the parameters in ``ORDER``; infinite (on the diagonal) where not determined, all of it for a closed form.
    camera_kind, image_size
        What the camera's quantities belong to: they are compared within one kind and size only.
    verdict
        good, usable, redo, or empty.
    hardware
        Hardware revision, as the manifest has it; empty if it does not say.
    target
        SHA-256 of the box's landmark table.
    version
        Of boxcal.
    notes
        What was odd about its time.
    """

    robot: str
    key: str
    t_ns: int
    calibrated: str
    camera: Array
    wheels: Array
    T_body_cam: Array
    covariance: Array
    camera_kind: str = "radial"
    image_size: tuple[int, int] = (0, 0)
    verdict: str = ""
    hardware: str = ""
    target: str = ""
    version: str = ""
    notes: tuple[str, ...] = field(default=())

    @property
    def counts(self) -> bool:
        """Whether it says something of the robot: a result that must not be used does not, nor one without sigmas."""
        return self.verdict != Level.REDO.value and bool(np.any(np.isfinite(np.diag(self.covariance))))

    @property
    def date(self) -> str:
        """Day of the drive, UTC."""
        return datetime.fromtimestamp(self.t_ns / 1e9, UTC).date().isoformat()


def session_of(calibration: Calibration) -> Session:
    """Return a calibration as its robot's history keeps it.

    The drive's time is the first stop's, by the log. A log whose clock was not set (before 2010) or is ahead of the
    calibration by more than a day cannot be right; the time of the calibration takes its place, which the notes say.
    """
    p = calibration.provenance
    created = _nanoseconds(p.created)
    ends = [(s.t_start_ns, s.t_end_ns) for s in (*calibration.stops[:1], *calibration.stops[-1:])]
    t_ns = min((start for start, _ in ends), default=0)
    notes: tuple[str, ...] = ()
    if t_ns < _EARLIEST_NS or (created is not None and t_ns > created + _DAY_NS):
        told = "before 2010" if t_ns < _EARLIEST_NS else "later than it was calibrated"
        if created is None:
            created = max(t_ns, _EARLIEST_NS)
        t_ns, notes = created, (f"the log's clock says {told}: dated by when it was calibrated",)
    k, w, verdict = calibration.camera, calibration.wheels, calibration.verdict
    detail = calibration.detail
    return Session(
        robot=calibration.robot,
        key=drive_key(p.logs, ends),
        t_ns=t_ns,
        calibrated=p.created,
        camera=np.array([k.fu, k.fv, k.cu, k.cv, k.kr]),
        wheels=np.array([w.rR, w.rL, w.b]),
        T_body_cam=np.array(calibration.T_body_cam),
        covariance=np.diag(np.full(14, np.inf)) if detail is None else detail.covariance.matrix,
        camera_kind=str(k.kind),
        image_size=calibration.image_size,
        verdict="" if verdict is None else str(verdict.level),
        hardware=str(p.settings.get("hardware") or ""),
        target=p.target,
        version=p.version,
        notes=notes,
    )


def sessions_of(calibration: Calibration) -> tuple[Session, ...]:
    """Return the sessions of a calibration: the robot's own, and one for each further camera, named ``robot/camera``.

    A further camera's session is about that camera alone: its wheels are the robot's, which are watched once.
    """
    first, *others = each_camera(calibration)
    own, rig = session_of(first), calibration.rig
    if rig is None:
        return (own,)
    if not others and not np.array_equal(rig.cameras[0].T_body_cam, calibration.T_body_cam):
        return (_of_camera_alone(own),)
    further = zip(others, rig.cameras[1:], strict=True)
    return (own, *(_of_camera_alone(replace(session_of(one), verdict=c.verdict)) for one, c in further))


def _of_camera_alone(s: Session) -> Session:
    cov = s.covariance.copy()
    cov[WHEELS], cov[:, WHEELS] = 0.0, 0.0
    cov[WHEELS, WHEELS] = np.diag(np.full(3, np.inf))
    return replace(s, covariance=cov)


def drive_key(named: Mapping[str, str], stops: list[tuple[int, int]]) -> str:
    """Return what the same drive has in common however often it is calibrated: a hash of its logs' hashes.

    Logs without a hash (folders, and files of servers that say their size alone) are identified by when their first
    and last stop began and ended.
    """
    logs = sorted(named.values())
    if not logs or not all(map(tells_content, logs)):
        logs = [*logs, *(str(t) for t in (min(stops), max(stops)) if stops)] if stops else [*named, *logs]
    return hashlib.sha256("\n".join(logs).encode()).hexdigest()


def _nanoseconds(created: str) -> int | None:
    try:
        moment = datetime.fromisoformat(created)
    except ValueError:
        return None
    return int((moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()) * 10**9
