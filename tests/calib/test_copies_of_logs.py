"""Robots that were calibrated from copies of one recording, as the command names them."""

from types import SimpleNamespace

import pytest

from boxcal.calib.fleet.copies import said_of_copies
from boxcal.calib.results.calibration import Provenance


def _result(robot: str, **logs: str) -> SimpleNamespace:
    return SimpleNamespace(
        robot=robot, provenance=Provenance(version="", command="", created="", inputs={**logs, "target": "box"})
    )


@pytest.mark.parametrize("identity", ["5f3a", "etag:9b:1200"])
def test_robots_of_one_recording_are_named(identity: str) -> None:
    said = said_of_copies([_result("r1", a=identity), _result("r2", b=identity), _result("r3", c="other")])
    assert len(said) == 1
    assert said[0].startswith("r1, r2 were calibrated from one recording")


@pytest.mark.parametrize("identity", ["", "etag:none:1200"])
def test_logs_whose_content_nothing_tells_are_not_called_copies(identity: str) -> None:
    """A folder has no hash; of a file behind some servers the size alone is known, which two logs may share."""
    assert said_of_copies([_result("r1", a=identity), _result("r2", b=identity)]) == []
