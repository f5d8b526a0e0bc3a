"""Logs as they arrive in a folder or bucket: given out once they have stopped changing, and again if they change."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from boxcal.calib.errors import CalibError
from boxcal.calib.one_robot.log_identity import file_state
from boxcal.calib.settings import CORRESPONDENCES, robot_name
from boxcal.detect.log.containers.bag_folder import METADATA, PARTS
from boxcal.detect.log.remote.store import expanded, store_of
from boxcal.detect.log.remote.urls import is_url
from boxcal.target.errors import BoxcalError

_KINDS = (*PARTS, CORRESPONDENCES)
_PATTERN = "*["
EVERY_S = 10.0
"""Seconds between two looks; a log that is the same in both has arrived."""


def check_places(places: Sequence[Path]) -> None:
    """Refuse what cannot be watched: it must be folders, or URLs of folders or with a pattern (CalibError)."""
    for place in places:
        if not is_url(place) and not place.is_dir():
            raise CalibError(
                "--watch needs a folder, or the URL of one or of a pattern", source=place, remedy="make the folder"
            )


def logs_in(places: Sequence[Path]) -> dict[Path, Any]:
    """Return the logs that lie in folders now, or behind URLs, each with what changes when it does.

    Raises
    ------
    BoxcalError
        If a place cannot be looked at.
    """
    found: dict[Path, Any] = {}
    for place in places:
        if is_url(place):
            found |= {log: store_of(log).state() for log in _behind(place)}
            continue
        try:
            there = [p for p in place.iterdir() if not p.name.startswith(".")]
            bags = [p for p in there if p.is_dir() and (p / METADATA).is_file()]
            files = [p for p in there if p.is_file() and p.name.lower().endswith(_KINDS)]
            found |= {log: file_state(log) for log in (*bags, *files)}
        except OSError as error:
            raise CalibError(str(error.strerror or error), source=place, remedy="check the folder") from error
    return found


def _behind(place: Path) -> list[Path]:
    if any(sign in str(place) for sign in _PATTERN):
        try:
            return expanded(place)
        except BoxcalError as error:
            if error.found == "nothing matches":
                return []
            raise
    return [place / name for name in store_of(place).names() if name.lower().endswith(_KINDS)]


class Arrivals:
    """Logs that have arrived since the look before: those that stopped changing, and again those that changed since.

    Parameters
    ----------
    look
        Gives the logs that are there, each with what changes when it does.
    """

    def __init__(self, look: Callable[[], Mapping[Path, Any]]) -> None:
        self._look = look
        self._before: Mapping[Path, Any] = {}
        self._given: dict[Path, Any] = {}

    def next(self) -> list[Path]:
        """Look once, and return what has arrived, sorted."""
        now, before = self._look(), self._before
        ready = sorted(log for log, state in now.items() if before.get(log) == state and self._given.get(log) != state)
        self._given |= {log: now[log] for log in ready}
        self._before = now
        return ready

    def again(self, logs: Iterable[Path]) -> None:
        """Have logs given once more at the next look: nothing came of them, for no reason of their own."""
        for log in logs:
            self._given.pop(log, None)


def robots_of_their_own(logs: Iterable[Path]) -> tuple[list[Path], list[BoxcalError]]:
    """Return the logs that robots can be named after, and what speaks against each other one."""
    named: dict[str, Path] = {}
    problems: list[BoxcalError] = []
    for log in logs:
        try:
            name = robot_name(log)
        except BoxcalError as error:
            problems.append(error)
            continue
        if name in named:
            problems.append(
                CalibError(f"{named[name].name} is called {name} too", source=log, remedy="rename one of them")
            )
        named.setdefault(name, log)
    return list(named.values()), problems
