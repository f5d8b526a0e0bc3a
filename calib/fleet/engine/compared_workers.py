"""Workers of a Dask cluster that may be used: their versions and their code compared with those here."""

import time
from collections.abc import Iterable
from secrets import token_hex
from typing import Any

from boxcal.calib.fleet.engine.versions import OURS, differences, versions
from boxcal.detect.log.safe_text import listed

_VERSIONS_S = 60.0
"""Seconds that a worker is given to say its versions: it loads boxcal for it."""

_OTHERS_S = 15.0
"""Seconds after which workers that have not said theirs do not hold up those that have."""


class ComparedWorkers:
    """Workers by whether they may be used: those that have this version of boxcal, with the same code.

    Parameters
    ----------
    client
        ``distributed.Client``.
    """

    def __init__(self, client: Any) -> None:
        self._client, self._here = client, versions()
        self._asked: dict[str, tuple[Any, float]] = {}
        self._known: set[str] = set()
        self.usable: set[str] = set()

    def wait(self, workers: Iterable[str]) -> list[str]:
        """Wait until workers have said their versions, or had the time to; return as :meth:`look` does.

        Once some have, the others are not waited for much longer: they may be used later.
        """
        self._ask(workers)
        begun = time.monotonic()
        while any(not future.done() and time.monotonic() < deadline for future, deadline in self._asked.values()):
            if time.monotonic() > begun + _OTHERS_S and any(f.status == "finished" for f, _ in self._asked.values()):
                break
            time.sleep(0.02)
        return self.look(workers)

    def look(self, workers: Iterable[str]) -> list[str]:
        """Ask workers that are new, hear what others answered; return what differs: each difference once, with who.

        Parameters
        ----------
        workers
            Addresses of those that there are now.
        """
        self._ask(workers)
        who: dict[str, list[str]] = {}
        for worker, (future, deadline) in list(self._asked.items()):
            if not future.done() and time.monotonic() < deadline:
                continue
            del self._asked[worker]
            found, unusable = self._judged(future)
            if not unusable:
                self.usable.add(worker)
            for text in found:
                who.setdefault(text + ("; left out" if unusable else ""), []).append(worker)
            self._client.cancel([future], force=True)
        return [f"worker {listed(names)} {text}" for text, names in who.items()]

    def _ask(self, workers: Iterable[str]) -> None:
        for worker in set(workers) - self._known:
            key = f"boxcal versions {token_hex(4)} {worker}"
            future = self._client.submit(versions, workers=[worker], pure=False, key=key)
            self._asked[worker] = future, time.monotonic() + _VERSIONS_S
            self._known.add(worker)

    def _judged(self, future: Any) -> tuple[list[str], bool]:
        """Return what differs on a worker, in words, and whether it cannot be used."""
        if future.status == "finished":
            there = future.result()
            found = [f"has {text}" for text in differences(self._here, there)]
            return found, any(there.get(name) != self._here[name] for name in OURS)
        if future.status == "error":
            return [f"cannot load boxcal ({type(future.exception()).__name__})"], True
        return [f"does not answer within {_VERSIONS_S:g} s"], True
