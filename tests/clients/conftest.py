"""Files that the clients' tests open: those of two made-up robots, and of the default box."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "exports"))

from made_up import calibration, detail

from boxcal.calib.exports.files import exports
from boxcal.calib.exports.names import names_for
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.settings import Settings
from boxcal.detect.log.source import Source


@pytest.fixture(scope="session")
def made() -> Calibration:
    return calibration(detail=detail())


@pytest.fixture(scope="session")
def robots(made: Calibration, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folders with the files of robots r01 and r02, whose frames wear their names."""
    found = {}
    for robot in ("r01", "r02"):
        folder = tmp_path_factory.mktemp(robot)
        names = names_for(Settings(prefix=f"{robot}_", camera_frame="camera_optical_frame"), Source())
        for name, content in exports(made, None, names).items():
            (folder / name).write_bytes(content)
        found[robot] = folder
    return found
