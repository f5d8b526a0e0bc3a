"""Logs calibrated as they arrive, until somebody ends it."""

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from boxcal.calib.fleet.watch import EVERY_S, Arrivals, check_places, logs_in, robots_of_their_own
from boxcal.target.errors import BoxcalError

Tell = Callable[[str], None]
"""Receives a line for the user."""
_SAYS = "fleet-calibrate: "
"""Before every line, as the command has it."""


def watch(places: Sequence[Path], calibrate: Callable[[list[Path], Tell], list[Path] | None], tell: Tell) -> None:
    """Give logs to be calibrated as they arrive, for ever, or until calibrating says that it was interrupted.

    Logs that nothing came of, for no reason of their own (a scheduler that is down), are tried at every look until
    something does; what prevents it is said once.

    Parameters
    ----------
    places
        Folders and buckets.
    calibrate
        Calibrates logs and returns those that were not reached, None if it was interrupted; reports what prevents it
        of all of them by what it is given.
    tell
        Receives what goes on.

    Raises
    ------
    BoxcalError
        If a place cannot be watched.
    """
    check_places(places)
    tell(f"{_SAYS}watching; Ctrl-C ends it")
    in_the_way, unreachable = _Once(tell), _Once(tell)

    def look() -> Mapping[Path, Any]:
        try:
            found = logs_in(places)
        except BoxcalError as error:  # it may be there again at the next look
            unreachable.tell(f"{_SAYS}{error}")
            return {}
        unreachable.forget()
        return found

    arrivals = Arrivals(look)
    while True:
        logs, problems = robots_of_their_own(arrivals.next())
        for problem in problems:
            tell(f"{_SAYS}{problem}")
        if logs:
            left = calibrate(logs, in_the_way.tell)
            if left is None:
                return
            if not left:
                in_the_way.forget()
            arrivals.again(left)
        wait()


def wait() -> None:
    """Wait until it is time to look again."""
    time.sleep(EVERY_S)


class _Once:
    """Lines reported once, however often they come up, until they are forgotten."""

    def __init__(self, tell: Tell) -> None:
        self._tell = tell
        self._told: set[str] = set()

    def tell(self, line: str) -> None:
        if line not in self._told:
            self._tell(line)
        self._told.add(line)

    def forget(self) -> None:
        self._told.clear()
