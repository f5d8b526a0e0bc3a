"""The place that results go to: a folder, or a place behind a URL that a temporary folder stands for.

A robot's files are put by whoever calibrated it (``calibration.json`` last); what is about all robots is put at the
end. Each file appears whole: an object of a store when all of it has arrived, a file renamed from beside its place.
"""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from boxcal.calib.fleet.store import CAMERA_TABLES, FLEET, PAGES
from boxcal.calib.results.json_format import CALIBRATION
from boxcal.detect.log.remote.store import Store, store_of
from boxcal.detect.log.remote.urls import url_of


@dataclass(frozen=True, slots=True, kw_only=True)
class ResultsPlace:
    """A place of results.

    Attributes
    ----------
    out
        As the user named it.
    folder
        On this machine: the place itself, or what stands for it, with what it held of earlier runs.
    """

    out: Path
    folder: Path

    @property
    def said(self) -> str:
        """The place, for messages."""
        return url_of(self.out) or str(self.out)

    def with_file(self, name: str) -> set[str]:
        """Return the robots in whose folders a file of that name is (DetectError if a store cannot be reached)."""
        if self.folder == self.out:
            return {path.parent.name for path in self.out.glob(f"*/{name}")}
        return {relative.partition("/")[0] for relative in store_of(self.out).matching(f"*/{name}")}

    def put_fleet(self) -> None:
        """Put what was written about all robots; nothing is to be done for a folder (DetectError if it fails)."""
        if self.folder != self.out:
            store = store_of(self.out)
            kept = [p for p in self.folder.rglob("*") if p.is_file() and p.name != CALIBRATION]
            for path in sorted(kept, key=lambda p: p.name == FLEET):
                store.put(path.relative_to(self.folder).as_posix(), path.read_bytes())
            for name in (*PAGES, *CAMERA_TABLES.values()):
                if not (self.folder / name).exists():
                    store.remove(name)


@contextmanager
def results_place(out: Path) -> Iterator[ResultsPlace]:
    """Give the place of results; of one behind a URL what it holds of earlier runs is fetched first.

    Raises
    ------
    DetectError
        If the URL's place cannot be reached, read or written.
    """
    if url_of(out) is None:
        yield ResultsPlace(out=out, folder=out)
        return
    store = store_of(out)
    store.check_writable()
    with tempfile.TemporaryDirectory(prefix="boxcal-") as name:
        folder = Path(name)
        for found in (FLEET, f"*/{CALIBRATION}"):
            _fetch(store, found, folder)
        yield ResultsPlace(out=out, folder=folder)


def _fetch(store: Store, pattern: str, folder: Path) -> None:
    for relative, content in store.contents(pattern):
        (folder / relative).parent.mkdir(parents=True, exist_ok=True)
        (folder / relative).write_bytes(content)
