"""Many robots, one target frame: every log is calibrated, and failures are kept apart."""

import os
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from multiprocessing import get_context
from pathlib import Path

from calib.camera import CameraMode
from calib.errors import CalibError
from calib.four_steps import FourSteps, solve_four_steps
from calib.frames import inverse
from calib.result import Calibration, Provenance, Quality, StopResult, Wheels, save_calibration
from detect.correspondences import Correspondences, load_correspondences
from detect.errors import DetectError
from detect.extract import extract
from detect.names import Topics
from target.box import Target
from target.errors import TargetError

CORRESPONDENCES = ".npz"
"""Suffix of a correspondence file, which stands for a log that was read before."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """What a user may choose.

    Attributes
    ----------
    topics
        Topics and joints, where their names do not tell.
    camera_mode
        One camera for all stops, or every stop alone.
    """

    topics: Topics = field(default_factory=Topics)
    camera_mode: CameraMode = CameraMode.JOINT


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One robot to calibrate.

    Attributes
    ----------
    log
        Its recording (MCAP), or correspondences saved before (``.npz``).
    target
        The landmark table.
    settings
        What the user chose.
    out
        Folder that gets ``<robot>/calibration.json`` and ``<robot>/correspondences.npz``; None writes nothing.
    command
        The command line, for the provenance.
    """

    log: Path
    target: Target
    settings: Settings
    out: Path | None
    command: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What became of one robot: a calibration, or why there is none.

    Attributes
    ----------
    log
        Its recording.
    calibration
        The result, None if it failed.
    error
        One line for the user, empty if all went well.
    details
        Traceback of an error that is ours, not the input's; else empty.
    seconds
        Time taken.
    """

    log: Path
    calibration: Calibration | None
    error: str = ""
    details: str = ""
    seconds: float = 0.0


def robot_name(log: Path) -> str:
    """Return the robot that a log belongs to: the log's stem.

    Raises
    ------
    CalibError
        If the stem cannot name a folder.
    """
    name = log.parent.name if log.name == f"correspondences{CORRESPONDENCES}" else log.stem
    if name in {"", ".", ".."} or not name.isprintable():
        raise CalibError(f"{log.name!r}: no name for a robot can be made of it; rename the file")
    return name


def calibrate_log(job: Job, progress: Callable[[str], None] | None = None) -> Calibration:
    """Return the calibration of one robot, and write it where the job says.

    Raises
    ------
    DetectError, TargetError, CalibError
        If the log cannot be used or does not determine the calibration.
    OSError
        If the result cannot be written.
    """
    robot = robot_name(job.log)
    if job.log.suffix == CORRESPONDENCES:
        drive = load_correspondences(job.log)
    else:
        drive = extract(job.log, job.target, topics=job.settings.topics, progress=progress)
    try:
        result = assemble(robot, drive, solve_four_steps(drive, job.settings.camera_mode), job)
    except CalibError as error:
        raise CalibError(f"{job.log.name}: {error}") from error
    if job.out is not None:
        drive.save(job.out / robot / f"correspondences{CORRESPONDENCES}")
        save_calibration(result, job.out / robot / "calibration.json")
    return result


def assemble(robot: str, drive: Correspondences, steps: FourSteps, job: Job) -> Calibration:
    """Return the result that the four steps gave, with where it came from."""
    camera, mounting = steps.camera, steps.mounting
    T_box_cam = inverse(camera.T_cam_box)
    stops = tuple(
        StopResult(
            t_start_ns=drive.stops[j].t_start_ns,
            t_end_ns=drive.stops[j].t_end_ns,
            landmarks=len(drive.stops[j].landmark_ids),
            reprojection_rms_px=float(rms),
            T_box_cam=T,
        )
        for j, rms, T in zip(camera.kept, camera.stop_rms_px, T_box_cam, strict=True)
    )
    return Calibration(
        robot=robot,
        image_size=drive.image_size,
        camera=camera.camera,
        wheels=Wheels(rR=mounting.rR, rL=mounting.rL, b=mounting.b),
        T_body_cam=steps.T_body_cam,
        quality=Quality(
            stops=len(stops),
            landmarks=sum(stop.landmarks for stop in stops),
            reprojection_rms_px=camera.rms_px,
            heading_rms_rad=steps.heading.rms,
            sigma5_sigma4=mounting.null_ratio,
            sigma4_sigma3=mounting.rank_ratio,
            up_error_rad=steps.axis.up_error,
        ),
        stops=stops,
        notes=steps.notes,
        provenance=Provenance(
            version=boxcal_version(),
            command=job.command,
            created=datetime.now(UTC).isoformat(timespec="seconds"),
            inputs={drive.source.log: drive.source.sha256, "target": drive.source.target_sha256},
            settings={"camera_mode": str(job.settings.camera_mode), "topics": asdict(job.settings.topics)},
        ),
    )


def boxcal_version() -> str:
    """Return the installed version."""
    try:
        return version("boxcal")
    except PackageNotFoundError:
        return "not installed"


def calibrate_fleet(
    jobs: Sequence[Job], *, workers: int | None = None, progress: Callable[[str], None] | None = None
) -> Iterator[Outcome]:
    """Yield an outcome for each job, as they finish.

    Parameters
    ----------
    jobs
        The robots.
    workers
        Processes; as many as there are cores (and no more than jobs) if None. One works in this process.
    progress
        Called with a line about what is going on, where one process does the work.
    """
    workers = min(len(jobs), workers or os.cpu_count() or 1)
    if workers <= 1:
        yield from (attempt(job, progress) for job in jobs)
        return
    lost: list[Job] = []
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        futures = {pool.submit(attempt, job): job for job in jobs}
        for future in as_completed(futures):
            try:
                yield future.result()
            except BrokenProcessPool:
                lost.append(futures[future])
    # A worker that dies takes the whole pool along: whoever was still waiting gets a process of its own.
    for job in lost:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            try:
                yield pool.submit(attempt, job).result()
            except BrokenProcessPool:
                yield Outcome(
                    log=job.log,
                    calibration=None,
                    error=f"{job.log.name}: the process that worked on it died (out of memory?); try --jobs 1",
                )


def attempt(job: Job, progress: Callable[[str], None] | None = None) -> Outcome:
    """Return what becomes of one robot, whatever happens: one bad robot never hides the others."""
    start = time.monotonic()
    error, details = "", ""
    calibration: Calibration | None = None
    try:
        calibration = calibrate_log(job, progress)
    except (DetectError, TargetError, CalibError) as problem:
        error = str(problem)
    except OSError as problem:
        error = f"{job.log.name}: {problem.filename or 'a file'}: {problem.strerror or problem}"
    except Exception as problem:  # our own bug: told in full with the other robots calibrated
        error = f"{job.log.name}: unexpected {type(problem).__name__}: {problem}; please report it"
        details = traceback.format_exc()
    return Outcome(log=job.log, calibration=calibration, error=error, details=details, seconds=time.monotonic() - start)
