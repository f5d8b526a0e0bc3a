"""Many robots at once: each log is calibrated in a process of its own, and failures are kept apart."""

import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from multiprocessing import active_children, get_context
from multiprocessing.process import BaseProcess
from multiprocessing.queues import Queue

from boxcal.calib.calibrate import calibrate_robot
from boxcal.calib.errors import CalibError
from boxcal.calib.fleet.interrupts import children_without_interrupts, interrupts_held
from boxcal.calib.likelihood.compiled.compilation import prepare_all
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.settings import Job, Outcome, Progress, Stage, listed
from boxcal.target.errors import BoxcalError
from boxcal.target.files.atomic_write import clear_parts

_PATIENCE_S = 5.0
"""Seconds that a process is given to put away what it was writing."""
_LISTEN_S = 0.2
"""Seconds until Ctrl-C is noticed."""


def calibrate_fleet(
    jobs: Sequence[Job], *, workers: int | None = None, progress: Progress | None = None
) -> Generator[Outcome, None, None]:
    """Yield an outcome for each job, as they finish; closing it early ends the processes.

    Parameters
    ----------
    jobs
        The robots.
    workers
        Processes; as many as there are cores (and no more than jobs) if None. One works in this process.
    progress
        Told how far each robot has come, in a thread of its own.
    """
    if jobs:
        prepare_all(partial(_tell_compiling, progress))
    workers = min(len(jobs), workers or os.cpu_count() or 1)
    if workers <= 1:
        yield from (attempt(job, progress) for job in jobs)
        return
    lost: list[Job] = []
    with _listening(progress) as stages:
        for job, outcome in _in_processes(jobs, workers, stages):
            if outcome is None:
                lost.append(job)
            else:
                yield outcome
        # A worker that dies takes the whole pool along: whoever was still waiting gets a process of its own.
        for job in lost:
            for _, outcome in _in_processes([job], 1, stages):
                yield outcome or Outcome(job=job, calibration=None, error=_died(job))


def _tell_compiling(progress: Progress | None, text: str) -> None:
    if progress is not None:
        progress(Stage(robot="all robots", name="compile", text=text, share=0.0))


def attempt(job: Job, progress: Progress | None = None) -> Outcome:
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


def _died(job: Job) -> CalibError:
    found = "the process that worked on it died (out of memory?)"
    return CalibError(found, source=listed(job.logs), remedy="try --jobs 1")


def _in_processes(
    jobs: Sequence[Job], workers: int, stages: "Queue[Stage | None] | None"
) -> Iterator[tuple[Job, Outcome | None]]:
    """Yield each job with its outcome, None where the process died; ended early, the processes are ended too.

    Raises
    ------
    KeyboardInterrupt
        If Ctrl-C was pressed, between two outcomes.
    """
    before = set(active_children())
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=_begin_worker, initargs=(stages,))
    try:
        with interrupts_held() as pressed:
            with children_without_interrupts():
                futures: dict[Future[Outcome], Job] = {pool.submit(_attempt_there, job): job for job in jobs}
            waiting = set(futures)
            while waiting:
                done, waiting = wait(waiting, timeout=_LISTEN_S, return_when=FIRST_COMPLETED)
                for future in done:
                    died = isinstance(future.exception(), BrokenProcessPool)
                    if died:
                        _clear([futures[future]])
                    yield futures[future], None if died else future.result()
                if pressed():
                    raise KeyboardInterrupt
            pool.shutdown()
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        _end(list(set(active_children()) - before))
        _clear(jobs)
        raise


def _clear(jobs: Sequence[Job]) -> None:
    """Remove what processes that were ended left half written."""
    for job in jobs:
        if job.out is not None:
            clear_parts(job.out / job.robot)


def _end(processes: Sequence[BaseProcess]) -> None:
    deadline = time.monotonic() + _PATIENCE_S
    for process in processes:
        process.terminate()
    for process in processes:
        process.join(max(0.0, deadline - time.monotonic()))
        if process.is_alive():
            process.kill()
            process.join()


@contextmanager
def _listening(progress: Progress | None) -> "Iterator[Queue[Stage | None] | None]":
    """Give the queue through which processes tell their stages, and pass on what arrives."""
    if progress is None:
        yield None
        return
    stages: Queue[Stage | None] = get_context("spawn").Queue()

    def pass_on() -> None:
        while (stage := stages.get()) is not None:
            progress(stage)

    listener = threading.Thread(target=pass_on, daemon=True)
    listener.start()
    try:
        yield stages
    finally:
        stages.put(None)
        listener.join(_PATIENCE_S)
        stages.cancel_join_thread()
        stages.close()


_stages: "Queue[Stage | None] | None" = None
"""Where this process tells its stages, if it is a worker."""


def _begin_worker(stages: "Queue[Stage | None] | None") -> None:
    global _stages  # noqa: PLW0603  (a process has one, handed over when it starts)
    _stages = stages
    if stages is not None:
        stages.cancel_join_thread()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that half-written files are put away


def _attempt_there(job: Job) -> Outcome:
    return attempt(job, None if _stages is None else _stages.put)
