"""Logs as they arrive in a folder or bucket: given out once they have stopped changing, and again if they change."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from boxcal.calib.errors import CalibError
from boxcal.calib.one_robot.log_identity import file_state
from boxcal.calib.settings import CORRESPONDENCES
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


def arrivals(look: Callable[[], Mapping[Path, Any]], pause: Callable[[], None]) -> Iterator[list[Path]]:
    """Yield the logs that have arrived since, look by look, sorted; for ever.

    Parameters
    ----------
    look
        Gives the logs that are there, each with what changes when it does.
    pause
        Called between two looks.
    """
    before: Mapping[Path, Any] = {}
    given: dict[Path, Any] = {}
    while True:
        now = look()
        ready = sorted(log for log, state in now.items() if before.get(log) == state and given.get(log) != state)
        given |= {log: now[log] for log in ready}
        before = now
        if ready:
            yield ready
        pause()
