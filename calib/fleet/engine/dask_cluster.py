"""The engine of an existing Dask cluster: one call at a time in each of its worker processes.

Calls are given to workers by name, one each, so that it is known who is to blame when a call takes too long, and a
worker that is frozen is not given another; Dask's own choice would queue further robots behind it.
"""

import time
from collections import deque
from collections.abc import Generator, Iterable, Iterator
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass
from queue import Empty, SimpleQueue
from secrets import token_hex
from typing import Any

from boxcal.calib.errors import CalibError
from boxcal.calib.fleet.engine.calls import OUT_OF_MEMORY, Call, Done, T, Told
from boxcal.calib.fleet.engine.compared_workers import ComparedWorkers
from boxcal.calib.fleet.engine.here import made
from boxcal.calib.fleet.engine.telling import heard_by
from boxcal.calib.fleet.interrupts import interrupts_held
from boxcal.calib.settings import NOTE, Stage

_ATTEMPTS = 2
"""Times that a call is made whose worker is lost."""
_LISTEN_S = 0.2
"""Seconds until Ctrl-C is noticed."""
_LOOK_S = 1.0
"""Seconds between looks at which workers there are."""
_START_S = 120.0
"""Seconds that a worker may take besides for its first call: it loads and perhaps compiles code."""
_FETCH_S = 60.0
"""Seconds that a result may take in transfer."""
_SAY_S = 0.5
"""Seconds between two stages that a call reports."""
_NOBODY_S = 60.0
"""Seconds after which a cluster that has no workers (left) is given up."""


@dataclass(slots=True, kw_only=True, eq=False)
class _Attempt:
    """A call that is being made: for the first or second time, by whom, until when (``time.monotonic``)."""

    call: Call[Any]
    number: int = 1
    worker: str = ""
    deadline: float = 0.0
    future: Any = None


class DaskCluster(AbstractContextManager["DaskCluster"]):
    """Workers of a Dask cluster; those that join later are used too, once their versions were compared.

    Parameters
    ----------
    client
        ``distributed.Client``; closed when the engine is left.
    compared
        Which workers may be used.
    limit_s
        Seconds that a call may take; then it is given to another worker, and the one that had it gets no more.
    silent_s
        Seconds without a heartbeat after which a worker is taken to be frozen.
    """

    sees_files = False

    def __init__(
        self, client: Any, compared: ComparedWorkers, *, limit_s: float = float("inf"), silent_s: float = 60.0
    ) -> None:
        self._client, self._compared = client, compared
        self._limit_s, self._silent_s = limit_s, silent_s
        self._too_slow: set[str] = set()
        self._alive: list[str] = []
        self._seen: dict[str, tuple[float, float]] = {}
        self._looked, self._last_alive = -float("inf"), time.monotonic()
        self._warm: set[str] = set()
        self._running: dict[str, _Attempt] = {}
        self._finished: SimpleQueue[str] = SimpleQueue()
        self._said: SimpleQueue[tuple[str, Stage]] = SimpleQueue()
        self._topic = f"boxcal {token_hex(8)}"
        client.subscribe_topic(
            self._topic, lambda event: self._said.put((event[1]["call"], Stage(**event[1]["stage"])))
        )
        self._look()

    @property
    def workers(self) -> int:
        """Number of workers that are used."""
        return max(len(self._alive), 1)

    def __exit__(self, *_: object) -> None:
        self._client.close()

    def run(self, calls: Iterable[Call[T]], told: Told | None = None) -> Generator[Done[T], None, None]:
        """Yield what becomes of each call, as they finish (see :meth:`boxcal.calib.fleet.engine.calls.Engine.run`)."""
        waiting = iter(calls)
        again: deque[_Attempt] = deque()
        self._last_alive = time.monotonic()
        try:
            with interrupts_held() as pressed:
                while self._give(waiting, again) or again or self._running:
                    yield from self._happened(again)
                    yield from self._overdue(again)
                    self._pass_on(told)
                    if pressed():
                        raise KeyboardInterrupt
        finally:
            if self._running and self._client.status == "running":
                self._client.cancel([attempt.future for attempt in self._running.values()], force=True)
            self._running.clear()

    def _look(self) -> None:
        """See which workers there are, and which of them have not been heard of for long."""
        now = time.monotonic()
        if now < self._looked + _LOOK_S:
            return
        self._looked = now
        if self._client.status != "running":
            raise _gone()
        try:
            found = self._client.scheduler_info(n_workers=-1)["workers"]
        except (OSError, TimeoutError) as error:  # it went a moment ago
            raise _gone() from error
        for address, about in found.items():
            heard = float(about.get("last_seen", 0.0))
            if address not in self._seen or self._seen[address][0] != heard:
                self._seen[address] = (heard, now)
        for remark in self._compared.look(found):
            self._said.put(("", Stage(robot="cluster", name=NOTE, text=remark, share=0.0)))
        used = self._compared.usable - self._too_slow
        self._alive = [a for a in found if a in used and now - self._seen[a][1] < self._silent_s]
        if self._alive:
            self._last_alive = now
        elif now > self._last_alive + _NOBODY_S:
            raise CalibError(
                f"the cluster has no worker that answers, for {_NOBODY_S:g} s",
                remedy="what is finished is kept; start workers and give the same command again",
            )

    def _give(self, waiting: Iterator[Call[Any]], again: deque[_Attempt]) -> bool:
        """Give every worker that is free a call; return whether there are calls that wait for one."""
        self._look()
        busy = {attempt.worker for attempt in self._running.values()}
        for worker in self._alive:
            if worker in busy:
                continue
            attempt = again.popleft() if again else _first(waiting)
            if attempt is None:
                return False
            start = 0.0 if worker in self._warm else _START_S
            token = f"{attempt.call.key} {token_hex(4)}"
            attempt.worker, attempt.deadline = worker, time.monotonic() + self._limit_s + start
            attempt.future = self._client.submit(
                made_by_a_worker, attempt.call, self._topic, key=f"boxcal {token}", workers=[worker], pure=False
            )
            self._running[token] = attempt
            attempt.future.add_done_callback(lambda _, token=token: self._finished.put(token))
        return True

    def _pass_on(self, told: Told | None) -> None:
        """Pass on what calls that are under way said of themselves, and what is to be said of workers that joined."""
        under_way = {"", *(attempt.call.key for attempt in self._running.values())}
        while not self._said.empty():
            key, stage = self._said.get()
            if told is not None and key in under_way:  # a stage may come later than the result
                told(stage)

    def _happened(self, again: deque[_Attempt]) -> Iterator[Done[Any]]:
        """Wait a moment for a call to be done and yield it; one that is to be made again is put there."""
        try:
            token = self._finished.get(timeout=_LISTEN_S)
        except Empty:
            return
        attempt = self._running.pop(token, None)
        if attempt is None:  # cancelled meanwhile
            return
        try:
            result, lost, details = attempt.future.result(timeout=_FETCH_S)
        except Exception as error:
            if type(error).__name__ in _LOST:
                yield from self._lost(attempt, again, "the worker that worked on it died (out of memory?)")
            else:
                yield Done(call=attempt.call, lost=f"unexpected {type(error).__name__} on {attempt.worker}: {error}")
            return
        self._warm.add(attempt.worker)
        if lost == OUT_OF_MEMORY and attempt.number < _ATTEMPTS:
            yield from self._lost(attempt, again, lost)
        else:
            yield Done(call=attempt.call, result=result, lost=lost, details=details)

    def _overdue(self, again: deque[_Attempt]) -> Iterator[Done[Any]]:
        """Take calls from workers that are gone, frozen or too slow; yield those that were taken twice."""
        for token, attempt in list(self._running.items()):
            if attempt.worker not in self._alive:
                why = "the worker that worked on it died or froze (out of memory?)"
            elif time.monotonic() > attempt.deadline:
                why = f"took longer than {self._limit_s:g} s"
                self._too_slow.add(attempt.worker)
            else:
                continue
            del self._running[token]
            self._client.cancel([attempt.future], force=True)
            yield from self._lost(attempt, again, why)

    def _lost(self, attempt: _Attempt, again: deque[_Attempt], why: str) -> Iterator[Done[Any]]:
        if attempt.number < _ATTEMPTS:
            again.append(_Attempt(call=attempt.call, number=attempt.number + 1))
        else:
            yield Done(call=attempt.call, lost=f"{why}, {_ATTEMPTS} times")


_LOST = {"KilledWorker", "CancelledError", "FutureCancelledError", "FutureLostError", "TimeoutError", "CommClosedError"}
"""Names of what is raised for a result whose worker, or whose connection, is lost."""


def _gone() -> CalibError:
    return CalibError(
        "the cluster's scheduler is gone",
        remedy="what is finished is kept; start the scheduler and give the same command again",
    )


def _first(waiting: Iterator[Call[Any]]) -> _Attempt | None:
    call = next(waiting, None)
    return None if call is None else _Attempt(call=call)


def made_by_a_worker(call: Call[Any], topic: str) -> tuple[Any, str, str]:
    """Return what becomes of a call that is made here, without the call itself: result, why lost, traceback.

    The stages that it reports go out as events of a topic, one every :data:`_SAY_S` at most, since all of a cluster's
    go through one scheduler.
    """
    from distributed import get_worker  # noqa: PLC0415  (an extra)

    worker, last = get_worker(), -float("inf")

    def say(message: Any) -> None:
        nonlocal last
        if isinstance(message, Stage) and time.monotonic() > last + _SAY_S:
            last = time.monotonic()
            worker.log_event(topic, {"call": call.key, "stage": asdict(message)})

    with heard_by(say):
        done = made(call)
    return done.result, done.lost, done.details
