"""Sessions put into a store and read from it."""

import json
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import sqlalchemy as sa
from scipy.spatial.transform import Rotation

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.euler import quaternion
from boxcal.calib.geometry.so3_se3 import rigid
from boxcal.calib.history.session import Session
from boxcal.calib.history_store.tables import NUMBERS, robots, sessions
from boxcal.detect.log.safe_text import printable
from boxcal.target.arrays import Array

_SIZE = 14
_LOWER = np.tril_indices(_SIZE)
LOG, CALIBRATION, USER = "log", "calibration", "user"
"""What a session is dated by."""


def put(connection: Any, new: Iterable[Session]) -> list[str]:
    """Put sessions into a store; return what their robots' owners should know, a line each.

    A drive that is there already is replaced by what was calibrated last of it: nothing is there twice, in whatever
    order results come. A day that a user gave a session stays.
    """
    lines = []
    for s in sorted(new, key=lambda s: (s.t_ns, s.key)):
        robot = _robot_id(connection, s.robot)
        values = _row(s)
        there = (sessions.c.robot_id == robot) & (sessions.c.drive == s.key)
        kept = connection.execute(sa.select(sessions.c.calibrated, sessions.c.dated_by).where(there)).one_or_none()
        if kept is None:
            lines += _odd_time(connection, robot, s)
            try:
                with connection.begin_nested():
                    connection.execute(sessions.insert().values(robot_id=robot, drive=s.key, **values))
                continue
            except sa.exc.IntegrityError:  # another run has just put the same drive there
                kept = connection.execute(sa.select(sessions.c.calibrated, sessions.c.dated_by).where(there)).one()
        if s.calibrated >= kept.calibrated:
            if kept.dated_by == USER or (kept.dated_by == CALIBRATION and s.notes):
                del values["t_ns"], values["dated_by"]  # the first calibration was nearest to the drive
            if kept.dated_by == USER:
                del values["notes"]
            connection.execute(sessions.update().where(there).values(**values))
    return lines


def _odd_time(connection: Any, robot: int, s: Session) -> list[str]:
    """Return a line if a new drive is dated before one calibrated before it: a clock may have run backwards."""
    lines = [f"{printable(s.robot)}: {note}" for note in s.notes]
    newest = connection.execute(
        sa.select(sessions.c.t_ns, sessions.c.calibrated)
        .where(sessions.c.robot_id == robot)
        .order_by(sessions.c.t_ns.desc())
        .limit(1)
    ).one_or_none()
    if newest is not None and newest.t_ns > s.t_ns and newest.calibrated < s.calibrated and not s.notes:
        lines.append(
            f"{printable(s.robot)}: this drive is dated {s.date}, before one that was calibrated earlier; it is kept "
            f"by its date; if the robot's clock ran backwards: robot-history date {printable(s.robot)} {s.key[:8]} DATE"
        )
    return lines


def _robot_id(connection: Any, name: str) -> int:
    asked = sa.select(robots.c.id).where(robots.c.name == name)
    found = connection.execute(asked).scalar_one_or_none()
    if found is None:
        try:
            with connection.begin_nested():
                connection.execute(robots.insert().values(name=name))
        except sa.exc.IntegrityError:  # another run has just named it
            pass
        found = connection.execute(asked).scalar_one()
    return int(found)


def read(connection: Any, names: Sequence[str] = ()) -> list[Session]:
    """Return the sessions of some robots, or of all, by robot and time.

    Raises
    ------
    CalibError
        If a robot is not in the store, or a row is none of this package's.
    """
    query = sa.select(robots.c.name, sessions).join(robots, robots.c.id == sessions.c.robot_id)
    if names:
        known = set(connection.execute(sa.select(robots.c.name).where(robots.c.name.in_(names))).scalars())
        for name in names:
            if name not in known:
                raise CalibError(
                    f"no robot {printable(name)} in the store", remedy="robot-history list shows those that are"
                )
        query = query.where(robots.c.name.in_(names))
    query = query.order_by(robots.c.name, sessions.c.t_ns, sessions.c.drive)
    return [_session(row) for row in connection.execute(query).mappings()]


def count(connection: Any) -> int:
    """Return how many sessions a store holds."""
    return int(connection.execute(sa.select(sa.func.count()).select_from(sessions)).scalar_one())


def set_time(connection: Any, robot: str, drive: str, t_ns: int) -> None:
    """Date a robot's session, named by the beginning of its drive's key, otherwise than its log does.

    Raises
    ------
    CalibError
        If there is no such session, or more than one.
    """
    own = _one(connection, robot, drive)
    there = (sessions.c.robot_id == _robot_id(connection, robot)) & (sessions.c.drive == own.key)
    connection.execute(sessions.update().where(there).values(t_ns=t_ns, dated_by=USER, notes="[]"))


def forget(connection: Any, robot: str, drive: str | None = None) -> int:
    """Remove one session of a robot, named by the beginning of its drive's key, or all of them; return how many.

    Raises
    ------
    CalibError
        If there is no such robot or session, or more than one.
    """
    gone = read(connection, [robot]) if drive is None else [_one(connection, robot, drive)]
    number = _robot_id(connection, robot)
    for s in gone:
        connection.execute(sessions.delete().where((sessions.c.robot_id == number) & (sessions.c.drive == s.key)))
    left = sa.select(sa.func.count()).where(sessions.c.robot_id == number)
    if not connection.execute(left).scalar_one():
        connection.execute(robots.delete().where(robots.c.id == number))
    return len(gone)


def _one(connection: Any, robot: str, drive: str) -> Session:
    own = [s for s in read(connection, [robot]) if s.key.startswith(drive.lower())]
    if len(own) != 1:
        found = "no drive" if not own else f"{len(own)} drives"
        raise CalibError(
            f"{found} of {printable(robot)} begin with {printable(drive)!r}",
            remedy=f"robot-history show {printable(robot)} lists them",
        )
    return own[0]


def _row(s: Session) -> dict[str, Any]:
    numbers = [*s.camera, *s.wheels, *quaternion(s.T_body_cam[:3, :3]), *s.T_body_cam[:3, 3]]
    return {
        "t_ns": int(s.t_ns),
        "dated_by": CALIBRATION if s.notes else LOG,
        "calibrated": s.calibrated,
        "version": s.version[:40],
        "verdict": s.verdict,
        "hardware": s.hardware[:200],
        "target": s.target[:64],
        "camera_kind": s.camera_kind,
        "image_width": int(s.image_size[0]),
        "image_height": int(s.image_size[1]),
        **{name: float(value) for name, value in zip(NUMBERS, numbers, strict=True)},
        "covariance": _packed(s.covariance),
        "notes": json.dumps(s.notes),
    }


def _packed(covariance: Array) -> bytes:
    return np.asarray(covariance, dtype="<f8")[_LOWER].tobytes()


def _session(row: Any) -> Session:
    try:
        lower = np.frombuffer(row["covariance"], dtype="<f8")
        covariance = np.zeros((_SIZE, _SIZE))
        covariance[_LOWER] = lower
        covariance.T[_LOWER] = lower
        numbers = np.array([row[name] for name in NUMBERS])
        return Session(
            robot=row["name"],
            key=row["drive"],
            t_ns=int(row["t_ns"]),
            calibrated=row["calibrated"],
            camera=numbers[:5],
            wheels=numbers[5:8],
            T_body_cam=rigid(Rotation.from_quat(numbers[8:12]).as_matrix(), numbers[12:]),
            covariance=covariance,
            camera_kind=row["camera_kind"],
            image_size=(row["image_width"], row["image_height"]),
            verdict=row["verdict"],
            hardware=row["hardware"],
            target=row["target"],
            version=row["version"],
            notes=tuple(json.loads(row["notes"])),
        )
    except (ValueError, TypeError) as error:
        raise CalibError(
            f"session {printable(str(row['drive'])[:8])} is damaged ({error})",
            source=printable(str(row["name"])),
            remedy="calibrate its log again, or import its results",
        ) from error
