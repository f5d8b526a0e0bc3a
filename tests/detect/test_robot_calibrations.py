"""A robot's recording, in its own topics, types and names, gives its calibration: every row of docs/recording.md."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drive_session import PARAMETERS, ROBOT, SETTINGS, TARGET, session, solution
from robot_logs import DRIVER, ROBOTS, RobotLog

from boxcal.calib.calibrate import calibrate
from boxcal.calib.exports.ros_diff_drive import diff_drive
from boxcal.calib.results.calibration import Calibration
from boxcal.calib.settings import Nominal
from boxcal.detect.log.topics import Topics
from boxcal.detect.log.wheel_samples import JointUnit, WheelUnits
from boxcal.target.arrays import Array

DOCS = Path(__file__).parents[2] / "docs/recording.md"
_ALIKE = 1e-9
"""What reads the very same angles and pictures gives the same calibration, relative to the largest figure."""
_SAMPLED = 1e-5
"""Midpoints instead of arcs, and float32 angles, move what comes out by no more than this, relative."""


def _nominal(wheels: tuple[float, float] | None) -> Nominal | None:
    return None if wheels is None else Nominal(wheel_radius=wheels[0], wheel_separation=wheels[1], source="driver.yaml")


def _calibrated(folder: Path, row: RobotLog) -> Calibration:
    path = row.log(folder / "r07.mcap", session().angles, session().pictures)
    options = {"topics": row.topics or Topics(), "wheel_units": row.units or WheelUnits()}
    return calibrate(path, TARGET, settings=replace(SETTINGS, nominal=_nominal(row.nominal), **options))


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Array:
    """The calibration from plain joint states in rad, in one vector."""
    return solution(_calibrated(tmp_path_factory.mktemp("plain"), ROBOTS["Andino"]))


@pytest.mark.parametrize("robot", ROBOTS)
def test_every_robots_log_gives_its_calibration(tmp_path: Path, plain: Array, robot: str) -> None:
    row = ROBOTS[robot]
    c = _calibrated(tmp_path, row)
    metres = row.units is not None and row.units.unit is JointUnit.METRES
    unit = np.array([DRIVER[0], DRIVER[0], 1.0]) if metres else np.ones(3)  # a radius is then a factor to the driver's
    found, true = solution(c), np.array([getattr(ROBOT, name) for name in PARAMETERS])
    assert c.detail is not None
    sigma = np.array([c.detail.covariance.sigma[name] for name in PARAMETERS])
    assert np.all(np.abs(found[:3] - true / unit) < 4 * sigma)
    assert np.all(sigma * unit / true < 2e-3)
    assert c.verdict is not None
    allowed = {"usable"} if metres else {"good", "usable"} if row.tick else {"good"}  # coarse ticks may not tell enough
    assert c.verdict.level in allowed
    jpeg = row.cameras[0][1] == "jpeg"
    if not row.tick and not jpeg:
        found[:3] *= unit
        exact = _SAMPLED if row.driver else _ALIKE
        np.testing.assert_allclose(found, plain, rtol=exact, atol=exact)


def test_odometry_gives_the_corrections_to_its_drivers_wheels(tmp_path: Path) -> None:
    p = diff_drive(_calibrated(tmp_path, ROBOTS["LIMO"]).wheels, _nominal(DRIVER))
    assert (p.wheel_radius, p.wheel_separation) == DRIVER
    assert p.left_wheel_radius_multiplier == pytest.approx(ROBOT.rL / DRIVER[0], rel=1e-3)
    assert p.right_wheel_radius_multiplier == pytest.approx(ROBOT.rR / DRIVER[0], rel=1e-3)
    assert p.wheel_separation_multiplier == pytest.approx(ROBOT.b / DRIVER[1], rel=1e-3)


def test_without_its_drivers_wheels_odometry_gives_ratios_and_is_never_good(tmp_path: Path) -> None:
    c = _calibrated(tmp_path, replace(ROBOTS["LIMO"], nominal=None))
    assert (c.wheels.rR + c.wheels.rL) / 2 / 0.05 == pytest.approx((ROBOT.rR + ROBOT.rL) / 2 / DRIVER[0], rel=2e-3)
    assert c.wheels.b / 0.3 == pytest.approx(ROBOT.b / DRIVER[1], rel=1e-2)
    assert c.verdict is not None
    assert c.verdict.level == "usable"
    (said,) = [reason for reason in c.verdict.reasons if "the sizes mean nothing" in reason.text]
    assert "--nominal" in said.advice


def test_the_docs_table_names_every_robot_that_is_held_here() -> None:
    text = DOCS.read_text(encoding="utf-8")
    table = text[text.index("## Robots") : text.index("**Skid steering.**")]
    cells = " ".join(re.findall(r"^\|([^|]*)\|", table, re.MULTILINE))
    for robot in ROBOTS:
        name = robot.partition(" (")[0]
        assert name in cells or robot in _IN_OTHER_WORDS, robot


_IN_OTHER_WORDS = {
    "six wheels",
    "odometry beside its robot's description",
    "odometry beside its driver's parameters",
    "Int32 counters",
    "Int64 counters",
    "Int16 counters",
    "any message, ticks in a list",
    "any message, angles",
    "wheels without a side in their names",
    "a reversed wheel",
    "degrees",
    "turns",
    "metres",
}
"""Rows that the table has under the message or the option that matters."""
