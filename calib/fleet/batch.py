"""Many robots, one target frame: every log is calibrated and written, and failures are kept apart."""

import json
import os
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from datetime import UTC, datetime
from multiprocessing import get_context
from pathlib import Path

from boxcal.calib.assessment.limits import Verdict
from boxcal.calib.calibrate import boxcal_version, placed, solve
from boxcal.calib.errors import CalibError
from boxcal.calib.exports.files import exports
from boxcal.calib.exports.foxglove.results_mcap import results_mcap
from boxcal.calib.exports.rerun import rerun_recording
from boxcal.calib.exports.scene import make_scene
from boxcal.calib.fleet.stop_images import draw_stops, stop_jpegs
from boxcal.calib.report.robot import judge, robot_report
from boxcal.calib.results.calibration import Calibration, save_calibration
from boxcal.calib.settings import CORRESPONDENCES, Job, Outcome, listed
from boxcal.detect.correspondences import Correspondences, load_correspondences, taken_as
from boxcal.detect.errors import DetectError
from boxcal.detect.extract import ExtractSettings, extract
from boxcal.target.box import Target
from boxcal.target.errors import TargetError
from boxcal.target.files.atomic_write import write_atomically
from boxcal.target.files.json_document import read_json
from boxcal.target.files.target_json import target_sha256

FLEET = "fleet.json"
"""What a folder of results says of itself."""


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
        raise error.of(listed(job.logs)) from error
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
        try:
            return placed(taken_as(load_correspondences(log), job.settings.wheel_units), job.target)
        except CalibError as error:
            raise error.of(log.name) from error
    settings = ExtractSettings(bits=job.settings.bits)
    return extract(
        log,
        job.target,
        topics=job.settings.topics,
        units=job.settings.wheel_units,
        settings=settings,
        progress=progress,
    )


def check_folder(out: Path, target: Target) -> None:
    """Refuse a folder that holds the results of another fleet: one that drove around another box.

    Raises
    ------
    CalibError
        If its ``fleet.json`` names another target, or is no such file.
    """
    path = out / FLEET
    if not path.exists():
        return
    remedy = "give another folder with --out"
    fleet = read_json(path, "a fleet's file", error=CalibError, remedy=remedy)
    if "target" not in fleet:
        raise CalibError("not what fleet-calibrate writes", source=path, remedy=remedy)
    found = str(fleet["target"])
    if found != target_sha256(target):
        raise CalibError(
            f"holds the results of a fleet with another target ({found[:8]}, now {target_sha256(target)[:8]})",
            source=out,
            remedy="give another folder with --out",
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
