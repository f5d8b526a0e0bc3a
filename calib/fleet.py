"""Many robots, one target frame: every log is calibrated, and failures are kept apart."""

import json
import os
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from math import radians
from multiprocessing import get_context
from pathlib import Path

from calib.assemble import closed_form, refined
from calib.camera import CameraMode
from calib.draw import draw_stops, stop_jpegs
from calib.errors import CalibError
from calib.estimate import EstimateOptions, Lens, choose_lens, estimate
from calib.estimate.validate import validate
from calib.exports.files import exports
from calib.exports.nominal import Nominal
from calib.exports.rerun import rerun_recording
from calib.exports.results_mcap import results_mcap
from calib.exports.scene import make_scene
from calib.four_steps import FourSteps, solve_four_steps
from calib.growth import grow
from calib.report.judgement import Verdict
from calib.report.robot import judge, robot_report
from calib.result import Calibration, Provenance, save_calibration
from detect.correspondences import Correspondences, load_correspondences
from detect.errors import DetectError
from detect.extract import ExtractSettings, extract
from detect.names import Topics
from target.box import Target
from target.errors import TargetError
from target.files import write_atomically
from target.landmarks import target_sha256

FLEET = "fleet.json"
"""What a folder of results says of itself."""
MAX_FLEET_BYTES = 16 << 20
CORRESPONDENCES = ".npz"
"""Suffix of a correspondence file, which stands for a log that was read before."""
_ONE_LENS, _ONE_BASE = 0.03, 0.4
"""How far focal length and wheelbase of one robot's drives may differ; slip makes the closed form's wheels rough."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """What a user may choose.

    Attributes
    ----------
    topics
        Topics and joints, where their names do not tell.
    bits
        Used bits of frames stored in 16; told from the frames if None.
    camera_mode
        One camera for all stops, or every stop alone.
    closed_form
        The four steps alone, without the likelihood.
    validate
        Hold every stop out in turn and predict it.
    lens
        Lens model; None lets an information criterion choose, and says how all models did.
    tilt_prior : rad
        Standard deviation of the floor's tilt against the box.
    ink_prior : m
        Of the ink's spread: how far all edges of the tags' black lie outwards. A camera's tone curve looks the same.
    scale_prior
        Of the print's scale in x and y, relative; 0 takes the target's figures as exact.
    size_prior : m
        Of the box' width and depth; 0 takes the target's figures as exact.
    face_prior : (rad, m)
        Of the poses of faces 1 to 3 against face 0; zeros take the target's figures as exact.
    encoder_step : rad, optional
        Found from the samples if None.
    slip : m/sqrt(m), optional
        Estimated if None.
    report
        Write ``report.html`` for every robot (and let the caller write the fleet's).
    draw
        Write each stop's picture with detected and reprojected corners.
    nominal
        What a data sheet says of the wheels, for diff_drive_controller's multipliers.
    rerun, results_mcap
        Files for the Rerun viewer and for Foxglove.
    """

    topics: Topics = field(default_factory=Topics)
    bits: int | None = None
    camera_mode: CameraMode = CameraMode.JOINT
    closed_form: bool = False
    validate: bool = False
    lens: Lens | None = Lens.RADIAL
    tilt_prior: float = radians(1.0)
    ink_prior: float = 1e-4
    scale_prior: float = 0.0
    size_prior: float = 0.0
    face_prior: tuple[float, float] = (0.0, 0.0)
    encoder_step: float | None = None
    slip: float | None = None
    report: bool = True
    draw: bool = False
    nominal: Nominal | None = None
    rerun: Path | None = None
    results_mcap: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One robot to calibrate.

    Attributes
    ----------
    robot
        Its name: the folder that its results go to.
    logs
        Its recordings (MCAP), or correspondences saved before (``.npz``); several drives are solved together.
    target
        The landmark table.
    settings
        What the user chose.
    out
        Folder that gets ``<robot>/calibration.json`` and what is made from it; None writes nothing.
    command
        The command line, for the provenance.
    """

    robot: str
    logs: tuple[Path, ...]
    target: Target
    settings: Settings
    out: Path | None
    command: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What became of one robot: a calibration, or why there is none.

    Attributes
    ----------
    job
        What was to be done.
    calibration
        The result, None if it failed.
    verdict
        Whether it can be used and why, None if it failed.
    error
        One line for the user, empty if all went well.
    details
        Traceback of an error that is ours, not the input's; else empty.
    seconds
        Time taken.
    """

    job: Job
    calibration: Calibration | None
    verdict: Verdict | None = None
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


def calibrate_robot(job: Job, progress: Callable[[str], None] | None = None) -> tuple[Calibration, Verdict]:
    """Return the calibration of one robot and whether it can be used, and write both where the job says.

    Raises
    ------
    DetectError, TargetError, CalibError
        If a log cannot be used or the drives do not determine the calibration.
    OSError
        If the result cannot be written.
    """
    drives = [read_drive(log, job, progress) for log in job.logs]
    try:
        result = solve(job, drives)
    except CalibError as error:
        raise CalibError(f"{listed(job.logs)}: {error}") from error
    judged = judge(result, drives, job.target)
    if job.out is not None:
        folder = job.out / job.robot
        for k, drive in enumerate(drives):
            number = f"-{k + 1}" if len(drives) > 1 else ""
            drive.save(folder / f"correspondences{number}{CORRESPONDENCES}")
        for name, content in exports(result, job.settings.nominal).items():
            write_atomically(folder / name, content)
        if job.settings.report:
            write_atomically(folder / "report.html", robot_report(result, drives, job.target))
        if job.settings.draw:
            pictures = draw_stops(job.logs, job.target, topics=job.settings.topics, calibration=result, drives=drives)
            for name, content in pictures:
                write_atomically(folder / "stops" / name, content)
        save_calibration(result, folder / "calibration.json")
    _write_viewer_files(job, result, drives)
    return result, judged


def _write_viewer_files(job: Job, result: Calibration, drives: list[Correspondences]) -> None:
    settings = job.settings
    if settings.rerun is None and settings.results_mcap is None:
        return
    scene = make_scene(result, drives, job.target)
    images = stop_jpegs(job.logs, scene.stops, topics=settings.topics)
    if settings.rerun is not None:
        write_atomically(settings.rerun, rerun_recording(scene, images))
    if settings.results_mcap is not None:
        write_atomically(settings.results_mcap, results_mcap(scene, images))


def read_drive(log: Path, job: Job, progress: Callable[[str], None] | None = None) -> Correspondences:
    """Return what a robot saw and did in one drive."""
    if log.suffix == CORRESPONDENCES:
        return load_correspondences(log)
    settings = ExtractSettings(bits=job.settings.bits)
    return extract(log, job.target, topics=job.settings.topics, settings=settings, progress=progress)


def solve(job: Job, drives: list[Correspondences]) -> Calibration:
    """Return the calibration that drives of one robot give: the four steps, then the likelihood.

    Raises
    ------
    CalibError
        If they do not determine it.
    """
    settings = job.settings
    steps = [solve_four_steps(drive, settings.camera_mode) for drive in drives]
    _check_one_robot(job, steps)
    provenance = Provenance(
        version=boxcal_version(),
        command=job.command,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        inputs={
            **{drive.source.log: drive.source.sha256 for drive in drives},
            "target": drives[0].source.target_sha256,
        },
        settings={name: _plain(value) for name, value in asdict(settings).items()},
    )
    if settings.closed_form:
        return closed_form(job.robot, drives, steps, provenance)
    options = EstimateOptions(
        lens=settings.lens or Lens.RADIAL,
        tilt_sigma=settings.tilt_prior,
        ink_sigma=settings.ink_prior,
        scale_sigma=settings.scale_prior,
        size_sigma=settings.size_prior,
        face_sigma=settings.face_prior,
        encoder_step=settings.encoder_step,
        slip=settings.slip,
        target=job.target,
    )
    if settings.lens is None:
        choice = choose_lens(drives, steps, options)
        found, options = choice.best, replace(options, lens=choice.best.lens)
        scores = ", ".join(f"{score.lens} {score.bic - choice.scores[0].bic:+.1f}" for score in choice.scores)
        found = replace(found, notes=(*found.notes, f"lens chosen by BIC (difference to the best): {scores}"))
    else:
        found = estimate(drives, steps, options)
    held_out = validate(drives, steps, options) if settings.validate else None
    grown = grow(drives[0], steps[0], found, options) if settings.report and len(drives) == 1 else ()
    return refined(job.robot, drives, steps, found, provenance, validation=held_out, growth=grown)


def _plain(value: object) -> object:
    """Return a setting as JSON has it; of a path only its name."""
    return value.name if isinstance(value, Path) else value


def _check_one_robot(job: Job, steps: Sequence[FourSteps]) -> None:
    """Refuse drives of different robots: what the four steps find in each is too far apart for one."""
    for log, step in zip(job.logs[1:], steps[1:], strict=True):
        for what, found, first, limit in (
            ("focal length", step.camera.camera.fu, steps[0].camera.camera.fu, _ONE_LENS),
            ("wheelbase", step.mounting.b, steps[0].mounting.b, _ONE_BASE),
        ):
            if abs(found / first - 1) > limit:
                raise CalibError(
                    f"{log.name}: not drives of one robot with one lens setting: {what} {found:.4g}, "
                    f"{job.logs[0].name} has {first:.4g}; leave it out or calibrate each by itself"
                )


def listed(logs: Sequence[Path]) -> str:
    """Return the names of logs in one line."""
    return ", ".join(log.name for log in logs)


def check_folder(out: Path, target: Target) -> None:
    """Refuse a folder that holds the results of another fleet: one that drove around another box.

    Raises
    ------
    CalibError
        If its ``fleet.json`` names another target, or is no such file.
    """
    try:
        content = (out / FLEET).read_bytes()[:MAX_FLEET_BYTES]
    except (FileNotFoundError, NotADirectoryError):
        return
    try:
        found = str(json.loads(content)["target"])
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise CalibError(f"{out / FLEET}: not what fleet-calibrate writes; give another folder with --out") from error
    if found != target_sha256(target):
        raise CalibError(
            f"{out}: holds the results of a fleet with another target ({found[:8]}, now {target_sha256(target)[:8]}); "
            "give another folder with --out"
        )


def fleet_record(outcomes: Sequence[Outcome], target: Target, command: str) -> bytes:
    """Return the content of ``fleet.json``: what a folder holds, and the failures."""
    document = {
        "schema": 1,
        "version": boxcal_version(),
        "command": command,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "target": target_sha256(target),
        "robots": {o.job.robot: str(o.verdict.level) for o in outcomes if o.verdict is not None},
        "failed": {o.job.robot: o.error for o in outcomes if o.calibration is None},
    }
    return (json.dumps(document, indent=2) + "\n").encode()


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
                    job=job,
                    calibration=None,
                    error=f"{listed(job.logs)}: the process that worked on it died (out of memory?); try --jobs 1",
                )


def attempt(job: Job, progress: Callable[[str], None] | None = None) -> Outcome:
    """Return what becomes of one robot, whatever happens: one bad robot never hides the others."""
    start = time.monotonic()
    error, details = "", ""
    calibration: Calibration | None = None
    verdict: Verdict | None = None
    try:
        calibration, verdict = calibrate_robot(job, progress)
    except (DetectError, TargetError, CalibError) as problem:
        error = str(problem)
    except OSError as problem:
        error = f"{listed(job.logs)}: {problem.filename or 'a file'}: {problem.strerror or problem}"
    except Exception as problem:  # our own bug: told in full with the other robots calibrated
        error = f"{listed(job.logs)}: unexpected {type(problem).__name__}: {problem}; please report it"
        details = traceback.format_exc()
    return Outcome(
        job=job,
        calibration=calibration,
        verdict=verdict,
        error=error,
        details=details,
        seconds=time.monotonic() - start,
    )
