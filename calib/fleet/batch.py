"""Many robots at once: each log is calibrated by a call of its own, and failures are kept apart."""

import os
import time
import traceback
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from functools import cache, partial

from boxcal.calib.calibrate import calibrate_robot
from boxcal.calib.errors import CalibError
from boxcal.calib.fleet.engine.calls import Call, Done, Engine
from boxcal.calib.fleet.engine.here import ThisProcess
from boxcal.calib.fleet.engine.processes import LocalProcesses
from boxcal.calib.fleet.engine.telling import tell
from boxcal.calib.likelihood.compiled.compilation import prepare_all
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.settings import Job, Outcome, Progress, Stage, listed
from boxcal.detect.log.remote.urls import is_url
from boxcal.target.errors import BoxcalError
from boxcal.target.files.atomic_write import clear_parts


def local_engine(robots: int, *, workers: int | None = None, limit_s: float = float("inf")) -> Engine:
    """Return the engine of this machine for so many robots: one that works alone needs no further process.

    Parameters
    ----------
    robots
        How many there are to do.
    workers
        Processes; as many as there are cores (and no more than robots) if None. One works in this process, where a
        robot may take as long as it does.
    limit_s
        Seconds that a robot may take.
    """
    workers = min(robots, workers or os.cpu_count() or 1)
    if workers <= 1:
        return ThisProcess()
    return LocalProcesses(workers, limit_s=limit_s)


def calibrate_fleet(
    jobs: Sequence[Job], *, workers: int | None = None, engine: Engine | None = None, progress: Progress | None = None
) -> Generator[Outcome, None, None]:
    """Yield an outcome for each job, as they finish; closing it early ends what works on the others.

    Parameters
    ----------
    jobs
        The robots.
    workers
        Processes, as :func:`local_engine` has it, unless an engine is given.
    engine
        Where the work is done.
    progress
        Told how far each robot has come.

    Raises
    ------
    CalibError
        If the engine is lost.
    KeyboardInterrupt
        If Ctrl-C was pressed.
    """
    if not jobs:
        return
    prepare_all(partial(_tell_compiling, progress))  # before there are processes that would all wait for it
    if engine is None:
        with local_engine(len(jobs), workers=workers) as own:
            yield from _outcomes(jobs, own, progress)
    else:
        yield from _outcomes(jobs, engine, progress)


def _outcomes(jobs: Sequence[Job], engine: Engine, progress: Progress | None) -> Generator[Outcome, None, None]:
    waiting = {f"{k} {job.robot}": job for k, job in enumerate(jobs)}
    calls = [Call(key=key, function=attempt, arguments=(job,)) for key, job in waiting.items()]
    running = engine.run(calls, progress)
    try:
        for done in running:
            yield _outcome(waiting.pop(done.call.key), done)
    finally:
        running.close()
        for job in waiting.values():
            _clear(job)


def _outcome(job: Job, done: "Done[Attempt]") -> Outcome:
    found = done.result
    if found is None:
        _clear(job)
        remedy = "please report it" if done.details else "give fewer --jobs, or a longer --time-limit"
        error = CalibError(done.lost, source=listed(job.logs), remedy=remedy)
        return Outcome(job=job, calibration=None, error=error, details=done.details)
    return Outcome(
        job=job, calibration=found.calibration, error=found.error, details=found.details, seconds=found.seconds
    )


def _clear(job: Job) -> None:
    """Remove what was left half written by who worked on a robot until they were ended."""
    if job.out is not None and not is_url(job.out):
        clear_parts(job.out / job.robot)


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempt:
    """Outcome of one robot without its job, as it travels (see :class:`boxcal.calib.settings.Outcome`)."""

    calibration: Calibration | None
    error: BoxcalError | None
    details: str
    seconds: float


def attempt(job: Job) -> Attempt:
    """Return what becomes of one robot, whatever happens: one bad robot never hides the others.

    Raises
    ------
    MemoryError
        If there is no memory left: there may be some elsewhere, or later.
    """
    start = time.monotonic()
    calibration: Calibration | None = None
    error: BoxcalError | None = None
    details = ""
    try:
        _compile_once()
        _clear(job)
        calibration = calibrate_robot(job, tell)
    except BoxcalError as problem:
        error = problem
    except OSError as problem:
        where = f"{listed(job.logs)}: {problem.filename or 'a file'}"
        error = CalibError(str(problem.strerror or problem), source=where)
    except MemoryError:
        raise
    except Exception as problem:  # our own bug: told in full with the other robots calibrated
        found = f"unexpected {type(problem).__name__}: {problem}"
        error = CalibError(found, source=listed(job.logs), remedy="please report it")
        details = traceback.format_exc()
    return Attempt(calibration=calibration, error=error, details=details, seconds=time.monotonic() - start)


@cache
def _compile_once() -> None:
    """Have compiled code made ready in this process, once."""
    prepare_all(lambda text: _tell_compiling(tell, text))


def _tell_compiling(progress: Progress | None, text: str) -> None:
    if progress is not None:
        progress(Stage(robot="all robots", name="compile", text=text, share=0.0))
