"""Logs that once went wrong, each with one thing amiss; see shared/cases/README.md."""

import json
from pathlib import Path

import pytest

from boxcal.calib.calibrate import calibrate
from boxcal.calib.settings import Settings
from boxcal.target.errors import BoxcalError

SETTINGS = Settings(report=False)
_USED: dict[str, tuple[str, int, str]] = {
    "good": ("good", 9, ""),
    "leg-without-joints": ("good", 9, "the wheels do not cover the path"),
    "one-empty-image": ("good", 8, "1 image of 9 left out"),
    "broken-arm-topic": ("good", 9, "not used, and not all of their messages decode: /arm"),
    "truncated-85-percent": ("usable", 7, "the recording is damaged: truncated"),
    "img-clock-2s-late": ("good", 9, "the camera's clock is 2.0 s ahead of the wheels'"),
    "dither-12bit-half-tick": ("good", 9, ""),
    "chunk-opcode-flipped": ("usable", 9, "the recording is damaged"),
}
"""Verdict, stops and a note."""
_REFUSED = {
    "ticks-4096": "encoder ticks, not radians.*--joint-unit ticks --ticks-per-turn",
    "turtlebot4-zeros": "never move.*record the topic of the wheels' driver",
    "chunk-length-2p63": "the chunk at byte 8 is damaged",
}


@pytest.fixture(scope="module")
def logs(shared_data: Path) -> Path:
    return shared_data.parent / "cases" / "logs"


@pytest.mark.parametrize("name", _USED)
def test_a_log_with_one_thing_amiss_is_calibrated_rightly_and_said(logs: Path, name: str) -> None:
    level, stops, note = _USED[name]
    true = json.loads((logs / "good.truth.json").read_text())
    c = calibrate(logs / f"{name}.mcap", settings=SETTINGS)
    assert c.detail is not None
    for parameter in ("rR", "rL", "b"):
        off = getattr(c.wheels, parameter) - true[parameter]
        assert abs(off) < 4 * c.detail.covariance.sigma[parameter]
        assert abs(off) < 2e-3 * true[parameter]
    assert c.verdict is not None
    assert (c.verdict.level, len(c.stops)) == (level, stops)
    assert any(note in said for said in c.notes)


@pytest.mark.parametrize("name", _REFUSED)
def test_a_log_that_cannot_be_used_gets_the_true_cause(logs: Path, name: str) -> None:
    with pytest.raises(BoxcalError, match=f"^{name}.mcap: .*{_REFUSED[name]}"):
        calibrate(logs / f"{name}.mcap", settings=SETTINGS)


def test_readings_in_degrees_are_never_good_and_the_option_is_named(logs: Path) -> None:
    c = calibrate(logs / "degrees.mcap", settings=SETTINGS)
    assert c.verdict is not None
    assert c.verdict.level == "redo"
    assert any("--joint-unit deg" in step for step in c.verdict.next_steps)
