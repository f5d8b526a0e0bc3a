"""Many robots at once: each log is calibrated by a call of its own, and failures are kept apart."""

from collections.abc import Generator, Sequence
from functools import partial

from boxcal.calib.errors import CalibError
from boxcal.calib.fleet.attempt import Attempt, attempt, attempt_elsewhere, clear_results, compiling, plain_error
from boxcal.calib.fleet.engine.calls import Call, Done, Engine
from boxcal.calib.fleet.engine.chosen import local_engine
from boxcal.calib.likelihood.compiled.compilation import prepare_detector
from boxcal.calib.one_robot.log_identity import may_be_read
from boxcal.calib.one_robot.put_files import put_files
from boxcal.calib.results.without_drive import without_drive
from boxcal.calib.settings import Job, Outcome, Progress, listed
from boxcal.target.errors import BoxcalError


def calibrate_fleet(
    jobs: Sequence[Job], *, workers: int | None = None, engine: Engine | None = None, progress: Progress | None = None
) -> Generator[Outcome, None, None]:
    """Yield an outcome for each job, as they finish; closing it early ends what works on the others.

    Parameters
    ----------
    jobs
        The robots.
    workers
        Processes, as :func:`boxcal.calib.fleet.engine.chosen.local_engine` has it, unless an engine is given.
    engine
        Where the work is done.
    progress
        Receives how far each robot has come.

    Raises
    ------
    CalibError
        If the engine is lost.
    KeyboardInterrupt
        If Ctrl-C was pressed.
    """
    if not jobs:
        return
    if any(may_be_read(log) for job in jobs for log in job.logs):  # before there are processes that would all wait
        prepare_detector(partial(_tell_compiling, progress))
    if engine is None:
        with local_engine(len(jobs), workers=workers) as own:
            yield from _outcomes(jobs, own, progress)
    else:
        yield from _outcomes(jobs, engine, progress)


def _outcomes(jobs: Sequence[Job], engine: Engine, progress: Progress | None) -> Generator[Outcome, None, None]:
    waiting = {f"{k} {job.robot}": job for k, job in enumerate(jobs)}
    function = attempt if engine.sees_files else attempt_elsewhere
    calls = (Call(key=key, function=function, arguments=(job,)) for key, job in list(waiting.items()))
    running = engine.run(calls, progress)
    try:
        for done in running:
            yield _outcome(waiting.pop(done.call.key), done)
    finally:
        running.close()
        for job in waiting.values():
            clear_results(job)


def _outcome(job: Job, done: Done[Attempt]) -> Outcome:
    found = done.result
    if found is None:
        clear_results(job)
        remedy = "please report it" if done.details else "give fewer --jobs, or a longer --time-limit"
        error = CalibError(done.lost, source=listed(job.logs), remedy=remedy)
        return Outcome(job=job, calibration=None, error=error, details=done.details)
    if found.files and job.out is not None:
        try:
            put_files(job.out / job.robot, found.files)
        except (BoxcalError, OSError) as problem:
            return Outcome(job=job, calibration=None, error=plain_error(problem, job), seconds=found.seconds)
    calibration = without_drive(found.calibration) if found.calibration is not None else None
    return Outcome(job=job, calibration=calibration, error=found.error, details=found.details, seconds=found.seconds)


def _tell_compiling(progress: Progress | None, text: str) -> None:
    if progress is not None:
        progress(compiling(text))
