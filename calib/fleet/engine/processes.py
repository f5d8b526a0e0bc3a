"""The engine of this machine: a pool of processes, each with a pipe of its own, so that the loss of one is its own.

``concurrent.futures`` loses all calls of a pool with one process that dies, and cannot end a call that takes too long.
"""

import time
from collections import deque
from collections.abc import Generator, Iterable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any

from boxcal.calib.fleet.engine.calls import OUT_OF_MEMORY, Call, Done, T, Told
from boxcal.calib.fleet.engine.worker_process import DONE, SAID, STARTED, work
from boxcal.calib.fleet.interrupts import children_without_interrupts, interrupts_held

_ATTEMPTS = 2
"""How often a call is made whose process is lost."""
_PATIENCE_S = 5.0
"""Seconds that a process is given to put away what it was writing."""
_LISTEN_S = 0.2
"""Seconds until Ctrl-C and a time that is over are noticed."""
_START_S = 120.0
"""Seconds that a process may take to start on its first call besides the call's own time."""
DIED = "the process that worked on it died (out of memory?)"


@dataclass(slots=True, kw_only=True)
class _Attempt:
    """A call that is being made, for the how manieth time, and until when (``time.monotonic``)."""

    call: Call[Any]
    number: int
    deadline: float


@dataclass(slots=True, kw_only=True, eq=False)
class _Worker:
    """A process, this end of its pipe, and what it works on."""

    process: SpawnProcess
    pipe: "Connection[Any, Any]"
    attempt: _Attempt | None = None


class LocalProcesses(AbstractContextManager["LocalProcesses"]):
    """Processes of this machine, started as they are needed; they stay until the engine is left.

    Parameters
    ----------
    workers
        How many.
    limit_s
        Seconds that a call may take before its process is ended.
    """

    sees_files = True

    def __init__(self, workers: int, *, limit_s: float = float("inf")) -> None:
        self.workers = workers
        self._limit_s = limit_s
        self._pool: list[_Worker] = []

    def __exit__(self, *_: object) -> None:
        self._end(self._pool)

    def run(self, calls: Iterable[Call[T]], told: Told | None = None) -> Generator[Done[T], None, None]:
        """Yield what becomes of each call, as they finish (see :meth:`boxcal.calib.fleet.engine.calls.Engine.run`)."""
        waiting = iter(calls)
        again: deque[_Attempt] = deque()
        try:
            with interrupts_held() as pressed:
                while self._give(waiting, again) or again or self._busy():
                    yield from self._happened(again, told)
                    if pressed():
                        raise KeyboardInterrupt
        finally:
            self._end(self._busy())

    def _busy(self) -> list[_Worker]:
        return [worker for worker in self._pool if worker.attempt is not None]

    def _give(self, waiting: "Iterator[Call[Any]]", again: deque[_Attempt]) -> bool:
        """Give every process that is free a call; return whether any was given."""
        given = False
        while len(self._busy()) < self.workers:
            attempt = again.popleft() if again else None
            if attempt is None:
                call = next(waiting, None)
                if call is None:
                    return given
                attempt = _Attempt(call=call, number=1, deadline=0.0)
            attempt.deadline = time.monotonic() + self._limit_s + _START_S
            worker = self._free()
            worker.attempt = attempt
            try:
                worker.pipe.send(attempt.call)
            except OSError:  # it died while it was free: that is not the call's fault
                self._end([worker])
                attempt.number -= 1
                again.appendleft(_next(attempt))
            given = True
        return given

    def _free(self) -> _Worker:
        for worker in self._pool:
            if worker.attempt is None:
                return worker
        ours, theirs = get_context("spawn").Pipe()
        process = get_context("spawn").Process(target=work, args=(theirs,), daemon=True)
        with children_without_interrupts():
            process.start()
        theirs.close()
        self._pool.append(_Worker(process=process, pipe=ours))
        return self._pool[-1]

    def _happened(self, again: deque[_Attempt], told: Told | None) -> Iterable[Done[Any]]:
        """Wait a moment and yield the calls that are done or lost; those to be made again are put there."""
        ready = wait([worker.pipe for worker in self._busy()], timeout=_LISTEN_S)
        for worker in self._busy():
            if worker.pipe in ready:
                yield from self._heard(worker, again, told)
            elif worker.attempt is not None and time.monotonic() > worker.attempt.deadline:
                yield from self._lost(worker, again, f"took longer than {self._limit_s:g} s")

    def _heard(self, worker: _Worker, again: deque[_Attempt], told: Told | None) -> Iterable[Done[Any]]:
        """Take a message from a process; yield its call if that is done."""
        attempt = worker.attempt
        assert attempt is not None  # noqa: S101 - only busy processes are listened to
        try:
            kind, content = worker.pipe.recv()
        except (EOFError, OSError):
            yield from self._lost(worker, again, DIED)
            return
        if kind == STARTED:
            attempt.deadline = time.monotonic() + self._limit_s
        elif kind == SAID and told is not None:
            told(content)
        elif kind == DONE:
            result, lost, details = content
            if lost == OUT_OF_MEMORY and attempt.number < _ATTEMPTS:
                yield from self._lost(worker, again, lost)  # in a fresh process
                return
            worker.attempt = None
            yield Done(call=attempt.call, result=result, lost=lost, details=details)

    def _lost(self, worker: _Worker, again: deque[_Attempt], why: str) -> Iterable[Done[Any]]:
        """End a process; have its call made again, or yield it as lost if it was already."""
        attempt = worker.attempt
        assert attempt is not None  # noqa: S101
        self._end([worker])
        if attempt.number < _ATTEMPTS:
            again.append(_next(attempt))
        else:
            yield Done(call=attempt.call, lost=f"{why}, {_ATTEMPTS} times")

    def _end(self, workers: "list[_Worker]") -> None:
        """End processes, with the time to put away what they were writing unless they do not listen."""
        deadline = time.monotonic() + _PATIENCE_S
        for worker in workers:
            worker.process.terminate()
        for worker in workers:
            worker.process.join(max(0.0, deadline - time.monotonic()))
            if worker.process.is_alive():
                worker.process.kill()
                worker.process.join()
            worker.pipe.close()
            worker.process.close()
        self._pool = [worker for worker in self._pool if worker not in workers]


def _next(attempt: _Attempt) -> _Attempt:
    return _Attempt(call=attempt.call, number=attempt.number + 1, deadline=0.0)
