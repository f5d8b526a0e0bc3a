"""Makes the helper modules of this folder importable, and shares calibrations and the browser."""

import shutil
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

import faulty
from browser import Browser

from boxcal.calib.results.calibration import Calibration
from boxcal.detect.correspondences import Correspondences


@cache
def _drive(name: str) -> Correspondences:
    found: Correspondences = getattr(faulty, name)()
    return found


@cache
def _calibrated(name: str) -> Calibration:
    return faulty.calibrated(_drive(name))


@pytest.fixture(scope="session")
def drives() -> Callable[[str], Correspondences]:
    """Drives of ``faulty`` by name, simulated once."""
    return _drive


@pytest.fixture(scope="session")
def calibrations() -> Callable[[str], Calibration]:
    """Their calibrations, made once."""
    return _calibrated


@pytest.fixture(scope="session")
def full() -> tuple[Calibration, Correspondences]:
    """A calibration with all that a report can show, and its drive."""
    drive = _drive("slipped")
    return faulty.calibrated(drive, growth=(8, 11, 14), held_out=True), drive


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """Chromium without a window."""
    chromium = next(
        (p for name in ("chromium", "chromium-browser", "google-chrome") if (p := shutil.which(name))), None
    )
    if chromium is None:
        pytest.skip("no chromium on this machine: the pages are not rendered")
    with Browser(chromium, tmp_path_factory.mktemp("chromium")) as opened:
        yield opened
