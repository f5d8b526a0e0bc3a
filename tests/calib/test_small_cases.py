"""Small inputs that went wrong once, each with the right value; see shared/cases/README.md."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from boxcal.calib.calibrate import calibrate
from boxcal.calib.errors import CalibError
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.verdict import Level
from boxcal.calib.settings import Settings
from boxcal.detect.correspondences import load_correspondences
from boxcal.detect.errors import DetectError
from boxcal.detect.log.wheel_samples import JointUnit, WheelUnits
from boxcal.target.arrays import Array

WHEELS = ("rR", "rL", "b")
TURTLEBOT = {"rR": 0.032707, "rL": 0.033178, "b": 0.162272}
"""Of the drives without a truth: what the sound one of them gives, to 1e-4."""


@pytest.fixture(scope="module")
def drives(shared_data: Path) -> Path:
    return shared_data.parent / "cases" / "drives"


@pytest.fixture(scope="module")
def calibrated(drives: Path) -> Callable[[str], Calibration]:
    """Calibrate a drive, once for all tests."""
    return cache(lambda name: calibrate(drives / f"{name}.npz"))


@pytest.fixture(scope="module")
def logs(shared_data: Path) -> Path:
    return shared_data.parent / "cases" / "logs"


def values(found: Calibration) -> dict[str, float]:
    w, c = found.wheels, found.camera
    place = dict(zip(("tx", "ty", "tz"), found.T_body_cam[:3, 3].tolist(), strict=True))
    return {"rR": w.rR, "rL": w.rL, "b": w.b, "fu": c.fu, "fv": c.fv, "cu": c.cu, "cv": c.cv, **place}


def truth(document: dict[str, object]) -> dict[str, float]:
    of_camera = document.get("camera", document)
    T: Array = np.array(document.get("T_body_cam", document.get("T_vehicle_camera")))
    place = dict(zip(("tx", "ty", "tz"), T[:3, 3].tolist(), strict=True))
    wheels = {name: float(document[name]) for name in WHEELS}  # type: ignore[arg-type]
    return wheels | {name: float(of_camera[name]) for name in ("fu", "fv", "cu", "cv")} | place  # type: ignore[index]


def worst(found: Calibration, true: dict[str, float]) -> float:
    """Return the largest error in predicted standard deviations."""
    assert found.detail is not None
    sigma = found.detail.covariance.sigma
    return max(abs(values(found)[name] - true[name]) / sigma[name] for name in true)


@pytest.mark.parametrize(
    "name",
    [
        "enc2deg_slip_collapses",
        "floor_0p01deg_good_10_sigma",
        "floor_0p1deg_box_blamed",
        "lens_c270_good_70_sigma",
        "lens_wide_print_blamed",
    ],
)
def test_a_drive_whose_cause_was_misjudged_is_right(
    drives: Path, calibrated: Callable[[str], Calibration], name: str
) -> None:
    found = calibrated(name)
    assert found.verdict is not None
    assert found.verdict.level is not Level.REDO
    assert found.findings == ()
    assert worst(found, truth(json.loads((drives / f"{name}.truth.json").read_text()))) < 3.5


def test_slip_is_honest_with_a_coarse_encoder(drives: Path, calibrated: Callable[[str], Calibration]) -> None:
    found = calibrated("enc2deg_slip_collapses")
    true = json.loads((drives / "enc2deg_slip_collapses.truth.json").read_text())
    assert found.detail is not None
    noise = found.detail.noise
    assert abs(noise.slip - float(true["slip"])) < 3.5 * noise.slip_sigma
    assert noise.slip > 1e-4


@pytest.mark.parametrize("name", ["pivot_3deg", "one_wrong_reading", "floor_0.1deg"])
def test_a_turtlebot_with_one_thing_wrong_is_calibrated(calibrated: Callable[[str], Calibration], name: str) -> None:
    found = calibrated(name)
    assert found.verdict is not None
    assert found.verdict.level is Level.GOOD
    for parameter, value in TURTLEBOT.items():
        assert values(found)[parameter] == pytest.approx(value, rel=5e-4), parameter


def test_a_glitch_a_nudge_and_a_leg_without_joints_cost_one_leg_and_no_more(
    calibrated: Callable[[str], Calibration],
) -> None:
    names = ("glitch-one-sample-0.1rad", "nudge-one-wheel-0.02rad-20Hz", "leg-7-without-joints")
    glitch, nudge, silent = (calibrated(name) for name in names)
    for found in (glitch, nudge, silent):
        assert found.verdict is not None
        assert found.verdict.level is Level.GOOD
        assert len(found.findings) == 1
        assert found.findings[0].stops == (6, 7)
    assert worst(glitch, values(silent)) < 3
    assert worst(nudge, values(silent)) < 3


@pytest.mark.parametrize(
    "name",
    [
        "enc2deg_slip_collapses",
        "faces02_swapped_crash",
        "floor_0p1deg_box_blamed",
        "glitch-one-sample-0.1rad",
        "nudge-one-wheel-0.02rad-20Hz",
        "one_wrong_reading",
        "slip10_refused_as_swapped",
    ],
)
def test_what_is_chosen_does_not_hang_on_rounding(
    drives: Path, calibrated: Callable[[str], Calibration], name: str
) -> None:
    """A difference of rounding once let a nudged wheel be taken for a backlash: choices must have a margin."""
    rng = np.random.default_rng(3)
    seen = load_correspondences(drives / f"{name}.npz")
    stops = tuple(replace(stop, uv_px=stop.uv_px + rng.normal(0, 1e-9, stop.uv_px.shape)) for stop in seen.stops)
    as_it_is, moved = calibrated(name), calibrate(replace(seen, stops=stops))
    assert chosen(moved) == chosen(as_it_is)
    assert as_it_is.detail is not None
    assert worst(moved, values(as_it_is)) < 1e-2
    sigma = as_it_is.detail.covariance.sigma
    assert moved.detail is not None
    assert moved.detail.covariance.sigma == pytest.approx(sigma, rel=0.02)


def chosen(found: Calibration) -> tuple[object, ...]:
    """Return what was chosen of alternatives: verdict, camera model, causes, legs left out."""
    assert found.verdict is not None
    assert found.detail is not None
    causes = tuple(finding.cause for finding in found.findings)
    legs = tuple(leg.leg for leg in found.detail.flagged_legs)
    return found.verdict.level, found.camera.kind, causes, legs


def test_a_slippery_drive_is_calibrated_with_large_sigmas(calibrated: Callable[[str], Calibration]) -> None:
    found = calibrated("slip10_refused_as_swapped")
    assert found.detail is not None
    assert found.verdict is not None
    assert found.verdict.level is Level.REDO
    assert found.verdict.causes[0].rule == "slip"
    assert found.detail.noise.slip == pytest.approx(0.010, rel=0.5)
    assert worst(found, {"rR": 0.0327, "rL": 0.0331, "b": 0.162}) < 3.5
    assert not any("swapped" in note for note in found.notes)


def test_sheets_0_and_2_are_said_to_be_swapped(calibrated: Callable[[str], Calibration]) -> None:
    found = calibrated("faces02_swapped_crash")
    assert found.findings[0].cause == "sheets-swapped"
    assert "sheets 0 and 2 are swapped" in found.findings[0].text
    assert found.wheels.b == pytest.approx(0.162, rel=0.01)


def test_degrees_are_named_and_taken_as_such_when_told(drives: Path, calibrated: Callable[[str], Calibration]) -> None:
    found = calibrated("degrees-12stops")
    assert found.verdict is not None
    assert found.verdict.level is Level.REDO
    assert found.findings[0].cause == "unit"
    assert "degrees" in found.findings[0].text
    assert "--joint-unit deg" in found.findings[0].advice
    told = Settings(report=False, wheel_units=WheelUnits(unit=JointUnit.DEGREES))
    right = calibrate(drives / "degrees-12stops.npz", settings=told)
    assert right.verdict is not None
    assert right.verdict.level is Level.GOOD
    assert right.wheels.rR == pytest.approx(np.degrees(found.wheels.rR), rel=1e-6)


@pytest.fixture(scope="module")
def sound(logs: Path) -> Calibration:
    return calibrate(logs / "good.mcap")


@pytest.fixture(scope="module")
def true_of_logs(logs: Path) -> dict[str, float]:
    return truth(json.loads((logs / "good.truth.json").read_text()))


@pytest.mark.parametrize(
    ("name", "level", "said"),
    [
        ("good", Level.GOOD, ""),
        ("broken-arm-topic", Level.GOOD, ""),
        ("chunk-opcode-flipped", Level.USABLE, "the recording is damaged"),
        ("dither-12bit-half-tick", Level.GOOD, ""),
        ("img-clock-2s-late", Level.GOOD, "the camera's clock is 2.0 s ahead"),
        ("leg-without-joints", Level.GOOD, "between stop 5 and stop 6 the wheels do not cover the path"),
        ("one-empty-image", Level.GOOD, "1 image of 9 left out"),
        ("truncated-85-percent", Level.USABLE, "the recording is damaged: truncated"),
    ],
)
def test_a_log_with_one_thing_wrong_is_calibrated_and_it_is_said(
    logs: Path, name: str, level: Level, said: str, true_of_logs: dict[str, float]
) -> None:
    found = calibrate(logs / f"{name}.mcap")
    assert found.verdict is not None
    assert found.verdict.level is level
    assert any(said in note for note in found.notes)
    assert worst(found, true_of_logs) < 4
    for parameter in WHEELS:
        assert values(found)[parameter] == pytest.approx(true_of_logs[parameter], rel=1e-3)


def test_a_log_in_degrees_is_never_used_unless_told(logs: Path, sound: Calibration) -> None:
    found = calibrate(logs / "degrees.mcap")
    assert found.verdict is not None
    assert found.verdict.level is Level.REDO
    assert "--joint-unit deg" in found.findings[0].advice
    told = Settings(report=False, wheel_units=WheelUnits(unit=JointUnit.DEGREES))
    right = calibrate(logs / "degrees.mcap", settings=told)
    assert right.wheels.rR == pytest.approx(sound.wheels.rR, rel=1e-9)


def test_a_log_in_ticks_is_refused_unless_told(logs: Path, sound: Calibration) -> None:
    with pytest.raises(DetectError, match=r"encoder ticks.*--joint-unit ticks --ticks-per-turn"):
        calibrate(logs / "ticks-4096.mcap")
    told = Settings(report=False, wheel_units=WheelUnits(unit=JointUnit.TICKS, ticks_per_turn=4096.0))
    right = calibrate(logs / "ticks-4096.mcap", settings=told)
    assert right.verdict is not None
    assert right.verdict.level is Level.GOOD
    assert worst(right, values(sound)) < 3


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("chunk-length-2p63", "the chunk at byte 8 is damaged"),
        ("turtlebot4-zeros", "never move"),
    ],
)
def test_a_log_that_holds_no_drive_gets_one_true_line(logs: Path, name: str, said: str) -> None:
    with pytest.raises((DetectError, CalibError), match=said) as error:
        calibrate(logs / f"{name}.mcap")
    assert "\n" not in str(error.value)
