"""A robot with several cameras: read, solved for together, judged and written."""

from collections.abc import Callable, Collection
from dataclasses import replace

from boxcal.calib.errors import CalibError
from boxcal.calib.exports.photographs import keeping
from boxcal.calib.likelihood.finding import Finding
from boxcal.calib.one_robot.cameras_read import ReadCameras, job_of, read_cameras
from boxcal.calib.one_robot.cameras_solved import SolvedCamera, solve_all
from boxcal.calib.one_robot.judging import judged
from boxcal.calib.one_robot.log_identity import file_state, fingerprint_of
from boxcal.calib.one_robot.writing import write
from boxcal.calib.report.robot import FLEET_PAGE
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.verdict import Level, Reason
from boxcal.calib.settings import CORRESPONDENCES, Job, listed

Tell = Callable[[str, str, float], None]
"""Called with a stage, what goes on in it, and the fraction of all that is done."""


def calibrate_cameras_of(job: Job, tell: Tell, read_share: float, solved_share: float) -> Calibration:
    """Return the calibration of a robot with several cameras, judged, and write it where the job says.

    Each camera after the first gets a folder of its own in the robot's.

    Parameters
    ----------
    job
        The robot; its settings say which cameras.
    tell
        Called with how far the work is.
    read_share, solved_share
        Fractions of the whole work that are done once all is read, and solved.

    Raises
    ------
    BoxcalError, OSError
        As of :func:`boxcal.calib.calibrate.calibrate_robot`.
    """
    if job.settings.closed_form:
        raise CalibError(
            "--closed-form solves for one camera",
            source=listed(job.logs),
            remedy="name one with --camera-topic, or leave out --closed-form",
        )
    before = [file_state(log) for log in job.logs]
    shown = job.out is not None and job.settings.report
    given = read_cameras(
        job,
        lambda text, share: tell("read", text, read_share * share),
        (lambda photos: keeping(photos) if shown else None),
    )
    for log, state in zip(job.logs, before, strict=True):
        if file_state(log) != state:
            raise CalibError("changed while it was read", source=log.name, remedy="close its recorder and try again")
    saved = any(log.suffix == CORRESPONDENCES for log in job.logs)
    job = job if saved else replace(job, fingerprint=fingerprint_of(job, given.cameras[0].drives))
    count = len(given.cameras)
    tell("solve", f"solving {count} camera{'s' if count > 1 else ''}", read_share)
    solved = solved_and_judged(job, given)
    tell("write", "writing the results", solved_share)
    write_all(job, solved)
    return solved[0].calibration


def solved_and_judged(job: Job, given: ReadCameras) -> list[SolvedCamera]:
    """Return the calibrations of all cameras with their verdicts, the first the robot's own.

    Errors as of :func:`boxcal.calib.one_robot.cameras_solved.solve_all`.
    """
    try:
        solved = solve_all(job, given)
    except CalibError as error:
        raise error.of(listed(job.logs)) from error
    others = [_judged(camera, f"{job.robot}/{camera.read.name}") for camera in solved[1:]]
    first, robot = solved[0], _judged(solved[0], job.robot)
    known = {cause.text for cause in _causes(robot)}
    unusable = tuple(finding for other in others if (finding := _unusable(other, known)) is not None)
    if unusable:
        findings = (*first.calibration.findings, *unusable)
        robot = _judged(replace(first, calibration=replace(first.calibration, findings=findings)), job.robot)
    return _with_verdicts([robot, *others])


def _causes(camera: SolvedCamera) -> tuple[Reason, ...]:
    verdict = camera.calibration.verdict
    return () if verdict is None else verdict.causes


def _with_verdicts(cameras: list[SolvedCamera]) -> list[SolvedCamera]:
    """Return the results, each with the verdicts on all cameras in its list of cameras."""
    rig, verdicts = cameras[0].calibration.rig, [camera.calibration.verdict for camera in cameras]
    if rig is None:
        return cameras
    listed = tuple(
        camera
        if verdict is None
        else replace(camera, verdict=str(verdict.level), why=" ".join(cause.text for cause in verdict.causes))
        for camera, verdict in zip(rig.cameras, verdicts, strict=True)
    )
    rig = replace(rig, cameras=listed)
    return [replace(camera, calibration=replace(camera.calibration, rig=rig)) for camera in cameras]


def _judged(camera: SolvedCamera, robot: str) -> SolvedCamera:
    result = judged(replace(camera.calibration, robot=robot), camera.look.drives, camera.look.target)
    return replace(camera, calibration=result)


def _unusable(camera: SolvedCamera, known: Collection[str]) -> Finding | None:
    """Return that another camera of the robot must not be used: the robot's own result is not good then.

    What the robot's own verdict says already, of its wheels say, is no fault of the other camera: None then.
    """
    own = [cause.text for cause in _causes(camera) if cause.level is Level.REDO and cause.text not in known]
    if not own:
        return None
    return Finding(
        cause="camera-unusable",
        text=f"camera {camera.read.name} must not be used: {own[0][:1].lower()}{own[0][1:].rstrip('.')}",
        advice=f"Look at {camera.read.name}/report.html, and do for that camera what it says.",
    )


def write_all(job: Job, solved: list[SolvedCamera]) -> None:
    """Write the results of all cameras, those of the robot itself last."""
    for number, camera in reversed(list(enumerate(solved))):
        own = replace(job_of(job, camera.read.topic), target=camera.look.target)
        photos = camera.read.photographs
        if not number:
            write(own, camera.calibration, camera.look.drives, photos)
        elif job.out is not None:
            settings = replace(own.settings, rerun=None, results_mcap=None, camera_frame=None)
            own = replace(own, robot=camera.read.name, out=job.out / job.robot, settings=settings)
            write(own, camera.calibration, camera.look.drives, photos, fleet=f"../{FLEET_PAGE}")
