"""Many robots, one target frame: every log is calibrated and written, and failures are kept apart."""

import os
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context

from boxcal.calib.calibrate import calibrate_robot
from boxcal.calib.errors import CalibError
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.settings import Job, Outcome, listed
from boxcal.detect.alignment.compilation import prepare
from boxcal.target.errors import BoxcalError


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
    if any(log.suffix != ".npz" for job in jobs for log in job.logs):
        prepare(progress)
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
                    error=CalibError(
                        "the process that worked on it died (out of memory?)",
                        source=listed(job.logs),
                        remedy="try --jobs 1",
                    ),
                )


def attempt(job: Job, progress: Callable[[str], None] | None = None) -> Outcome:
    """Return what becomes of one robot, whatever happens: one bad robot never hides the others."""
    start = time.monotonic()
    calibration: Calibration | None = None
    error: BoxcalError | None = None
    details = ""
    try:
        calibration = calibrate_robot(job, progress)
    except BoxcalError as problem:
        error = problem
    except OSError as problem:
        where = f"{listed(job.logs)}: {problem.filename or 'a file'}"
        error = CalibError(str(problem.strerror or problem), source=where)
    except Exception as problem:  # our own bug: told in full with the other robots calibrated
        found = f"unexpected {type(problem).__name__}: {problem}"
        error = CalibError(found, source=listed(job.logs), remedy="please report it")
        details = traceback.format_exc()
    return Outcome(job=job, calibration=calibration, error=error, details=details, seconds=time.monotonic() - start)
