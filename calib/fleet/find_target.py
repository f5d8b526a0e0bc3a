"""Search for the box that the robots drove around: the ``target.json`` beside or above their logs."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from boxcal.calib.errors import CalibError
from boxcal.detect.log.remote.store import fetched, store_of
from boxcal.detect.log.remote.urls import is_url, url_of
from boxcal.target.box import Target, make_target
from boxcal.target.files.target_json import load_target, target_sha256

MAX_TARGET_BYTES = 64 << 20
_LEVELS = 3
"""Folders above a log's own that are looked into."""
_PLACES = ("target.json", "box/target.json")
"""Where make-target and measure-target leave the file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundTarget:
    """A box, and the file that describes it (None: the default box)."""

    target: Target
    path: Path | None

    @property
    def said(self) -> str:
        """Description of the box that was found, in one line."""
        if self.path is None:
            return "box: the default one as designed (no target.json beside or above the logs; else give --target)"
        how = "as measured" if self.target.measured is not None else "as designed"
        return f"box: {url_of(self.path) or self.path} ({how})"


def find_target(given: Path | None, logs: Sequence[Path]) -> FoundTarget:
    """Return the box: as given, else the nearest ``target.json`` beside or above the logs, else the default one.

    Raises
    ------
    TargetError
        If the file is none.
    CalibError
        If logs have different boxes beside or above them.
    """
    if given is not None:
        return FoundTarget(target=_loaded(given), path=given)
    beside = {log.parent: log for log in logs}.values()
    paths = list(dict.fromkeys(path for log in beside if (path := _nearest(log)) is not None))
    found = [FoundTarget(target=_loaded(path), path=path) for path in paths]
    if len({target_sha256(f.target) for f in found}) > 1:
        raise CalibError(
            f"logs have different boxes beside or above them ({', '.join(str(path) for path in paths)})",
            remedy="say with --target which box they all drove around",
        )
    return found[0] if found else FoundTarget(target=make_target(), path=None)


def _loaded(path: Path) -> Target:
    if not is_url(path):
        return load_target(path)
    with tempfile.TemporaryDirectory(prefix="boxcal-") as name:
        copy = Path(name) / path.name
        copy.write_bytes(fetched(path, MAX_TARGET_BYTES))
        return load_target(copy)


def _nearest(log: Path) -> Path | None:
    if is_url(log):
        return next((log.parent / name for name in _PLACES if store_of(log.parent / name).exists()), None)
    folder = log.absolute().parent
    here = Path.cwd()
    for place in [folder, *folder.parents][: _LEVELS + 1]:
        for name in _PLACES:
            path = place / name
            if path.is_file():
                return path.relative_to(here) if path.is_relative_to(here) else path
    return None
