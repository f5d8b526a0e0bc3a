"""Calibrations of a robot's cameras: each by itself first, then all together."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from boxcal.calib.diagnosis.cameras import one_place, swapped
from boxcal.calib.diagnosis.explained_estimate import ExplainedEstimate
from boxcal.calib.diagnosis.first_look import FirstLook, first_look
from boxcal.calib.diagnosis.wheels_of_all import solve_explained
from boxcal.calib.likelihood.cameras.estimates import Cameras, apart
from boxcal.calib.likelihood.cameras.moving.merge import with_frames_of_all
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.likelihood.moving.clock import LATE
from boxcal.calib.likelihood.moving.mode import Moving
from boxcal.calib.one_robot.cameras_read import CameraDrives, ReadCameras, job_of, one_camera
from boxcal.calib.one_robot.solving import concluded, solve, solve_stops
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.diagnostics import MOUNTING
from boxcal.calib.results.provenance import plain_settings
from boxcal.calib.results.rig import Rig, RigCamera
from boxcal.calib.settings import Job, Settings
from boxcal.detect.log.safe_text import printable
from boxcal.detect.log.topics import says_raw
from boxcal.target.errors import BoxcalError
from boxcal.target.files.target_json import target_sha256

SWAPPED = "cameras-swapped"
EXPLAINED_BY_SWAPPED = ("camera-direction", "camera-height")
"""Findings about one camera that say of two exchanged ones the same once more, and another cause."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SolvedCamera:
    """One camera of a robot with its result.

    Attributes
    ----------
    read
        What it saw.
    look
        Its drives ready for the likelihood.
    calibration
        Its calibration, not judged yet.
    """

    read: CameraDrives
    look: FirstLook
    calibration: Calibration


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Alone:
    read: CameraDrives
    look: FirstLook
    explained: ExplainedEstimate


def solve_all(job: Job, given: ReadCameras) -> list[SolvedCamera]:
    """Return the calibrations of a robot's cameras, the first is the robot's own; not judged yet.

    Raises
    ------
    CalibError
        If no camera determines the calibration, or two topics that were named show one camera.
    """
    asked = plain_settings(asdict(job.settings))  # not those of one camera: by them a later run knows the result
    return [replace(s, calibration=_with_settings(s.calibration, asked)) for s in _solved(job, given)]


def _with_settings(calibration: Calibration, settings: Mapping[str, Any]) -> Calibration:
    return replace(calibration, provenance=replace(calibration.provenance, settings=settings))


def _solved(job: Job, given: ReadCameras) -> list[SolvedCamera]:
    left_out = dict(given.left_out)
    if len(given.cameras) == 1:
        only = given.cameras[0]
        return [_only(job, only, first_look(only.drives, job.target, job.settings.camera_mode), left_out)]
    alone = _without_twins(job, _each_alone(job, given.cameras, left_out), left_out)
    if len(alone) == 1:
        return [_only(job, alone[0].read, alone[0].look, left_out)]
    missing, said = _said_of(job, left_out)
    together = _together(alone, job.settings)
    together = replace(together, notes=tuple(_named(note, alone) for note in together.notes))
    doubts = (*missing, *_doubts(alone, together))
    solved = []
    for camera, estimate in zip(alone, together.estimates, strict=True):
        said_too = replace(
            estimate,
            notes=(*estimate.notes, *together.notes, *said, *_pairs_said(alone, together)),
            findings=(*estimate.findings, *doubts),
        )
        own = job_of(job, camera.read.topic)
        result = _unless_swapped(concluded(own, camera.look, said_too, camera.explained.options))
        solved.append(SolvedCamera(read=camera.read, look=camera.look, calibration=result))
    rig = _rig(solved, together, left_out)
    return [replace(s, calibration=replace(s.calibration, rig=rig)) for s in solved]


def _unless_swapped(found: Calibration) -> Calibration:
    """Return a camera's result without what exchanged cameras explain: that it looks elsewhere than is described."""
    if not any(finding.cause == SWAPPED for finding in found.findings):
        return found
    return replace(found, findings=tuple(f for f in found.findings if f.cause not in EXPLAINED_BY_SWAPPED))


def _only(job: Job, camera: CameraDrives, look: FirstLook, left_out: Mapping[str, str]) -> SolvedCamera:
    """Return the only camera of a robot that can be used, calibrated as a robot with one camera is."""
    missing, said = _said_of(job, left_out)
    found = solve(job_of(job, camera.topic), look)
    found = replace(found, notes=(*found.notes, *said), findings=(*found.findings, *missing))
    covariance = np.full((6, 6), np.nan) if found.detail is None else found.detail.covariance.block(MOUNTING)
    solved = SolvedCamera(read=camera, look=look, calibration=found)
    rig = Rig(cameras=(_rig_camera(solved),), covariance=covariance, left_out=tuple(sorted(left_out.items())))
    return replace(solved, calibration=replace(found, rig=rig))


def _said_of(job: Job, left_out: Mapping[str, str]) -> tuple[tuple[Finding, ...], tuple[str, ...]]:
    """Return findings of cameras that were asked for and are missing, and notes of all other topics not used."""
    named = job.settings.cameras
    missing = tuple(_missing(topic, why) for topic, why in left_out.items() if topic in named)
    rest = {topic: why for topic, why in left_out.items() if topic not in named}
    return missing, tuple(f"image topic {printable(topic)} is not used: {why}" for topic, why in rest.items())


def _each_alone(job: Job, cameras: Sequence[CameraDrives], left_out: dict[str, str]) -> list[_Alone]:
    """Return what each camera gives by itself; those that give nothing join what is left out."""
    found, first = list[_Alone](), None
    for camera in cameras:
        try:
            look = first_look(camera.drives, job.target, job.settings.camera_mode)
            explained = solve_stops(job_of(job, camera.topic), look)
        except BoxcalError as error:
            first = first or error
            left_out[camera.topic] = str(error)
            continue
        found.append(_Alone(read=camera, look=look, explained=explained))
    if first is not None and not found:
        raise first
    return found


def _without_twins(job: Job, cameras: Sequence[_Alone], left_out: dict[str, str]) -> list[_Alone]:
    """Return the cameras, of those that stand in one place at every stop one only (CalibError if both named).

    That is the first whose name says that its images are raw, else the first: others are made from its images.
    """
    kept: list[_Alone] = []
    for camera in cameras:
        twin = next((k for k, other in enumerate(kept) if _one_place(other, camera)), None)
        if twin is None:
            kept.append(camera)
            continue
        if not job.settings.all_cameras:
            raise one_camera(kept[twin].read, camera.read)
        spare = camera
        if says_raw(camera.read.topic) and not says_raw(kept[twin].read.topic):
            spare, kept[twin] = kept[twin], camera
        left_out[spare.read.topic] = (
            f"it shows the camera of {printable(kept[twin].read.topic)} once more: from one place at every stop"
        )
    return kept


def _one_place(a: _Alone, b: _Alone) -> bool:
    return one_place(a.explained.fit, b.explained.fit, (a.look.drives, b.look.drives))


def _together(cameras: Sequence[_Alone], settings: Settings) -> Cameras:
    found = [camera.explained.found for camera in cameras]
    boxes = {target_sha256(camera.look.target) for camera in cameras}
    if len(boxes) > 1:
        return apart(found, "they do not agree on how the box's sheets are glued")
    fits = [camera.explained.fit for camera in cameras]
    drives = [camera.look.drives for camera in cameras]
    together = solve_explained([camera.explained for camera in cameras], drives, settings.slip)
    if settings.moving is Moving.OFF:
        return together
    return with_frames_of_all(together, list(zip(found, fits, drives, strict=True)))


def _doubts(cameras: Sequence[_Alone], together: Cameras) -> list[Finding]:
    """Return what keeps several cameras' results from being good."""
    found = []
    if together.doubt:
        found.append(
            Finding(
                cause="cameras-disagree",
                text=f"the cameras contradict each other: {_named(together.doubt, cameras)}",
                advice="Check that all topics are of one robot and one drive, and that every camera is screwed tight.",
            )
        )
    described = [camera.look.drives[0].source.nominal_T_base_cam for camera in cameras]
    topics = [printable(camera.read.topic) for camera in cameras]
    exchanged = swapped([estimate.T_body_cam for estimate in together.estimates], described)
    if exchanged is not None:
        a, b = exchanged
        found.append(
            Finding(
                cause=SWAPPED,
                text=f"{topics[a]} sits where the robot's description has the camera of {topics[b]}, and the other way "
                "round",
                advice="Exchange the two cameras' topics or frames, in their drivers or in the description.",
            )
        )
    return found


def _named(doubt: str, cameras: Sequence[_Alone]) -> str:
    for number, camera in enumerate(cameras, 1):
        doubt = doubt.replace(f"camera {number} ", f"camera {camera.read.name} ")
    return doubt


def _missing(topic: str, why: str) -> Finding:
    return Finding(
        cause="camera-missing",
        text=f"camera {printable(topic)} was asked for and is not calibrated: {why}",
        advice="Stop where that camera sees the box too, or leave its topic out.",
    )


def _pairs_said(cameras: Sequence[_Alone], together: Cameras) -> tuple[str, ...]:
    names = ", ".join(camera.read.name for camera in cameras)
    if together.apart:
        return (f"{len(cameras)} cameras ({names}), each by itself: {together.apart}; sigmas between them are bounds",)
    return (f"{len(cameras)} cameras ({names}) were calibrated together",)


def _rig(solved: Sequence[SolvedCamera], together: Cameras, left_out: Mapping[str, str]) -> Rig:
    return Rig(
        cameras=tuple(_rig_camera(s) for s in solved),
        covariance=np.array(together.mountings),
        left_out=tuple(sorted(left_out.items())),
        apart=together.apart,
        stops=0 if together.fit is None else len(together.fit.problem.drive),
    )


def _rig_camera(solved: SolvedCamera) -> RigCamera:
    source, found = solved.look.drives[0].source, solved.calibration
    late_s = found.detail.extra.get(LATE, 0.0) if found.detail is not None else 0.0
    return RigCamera(
        name=solved.read.name,
        topic=source.camera_topic or solved.read.topic,
        frame=source.camera_frame,
        image_size=found.image_size,
        camera=found.camera,
        T_body_cam=found.T_body_cam,
        stops=found.quality.stops,
        reprojection_rms_px=found.quality.reprojection_rms_px,
        clock_offset=source.clock_offset + late_s,
        landmarks=found.quality.landmarks,
        covariance=None if found.detail is None else found.detail.covariance,
    )
