"""A box that came out wrong, printed too small and one face low: measuring mends the result, not measuring shows."""

from dataclasses import replace

import numpy as np
import pytest

from boxcal.calib.assessment.verdict import judge
from boxcal.calib.calibrate import calibrate
from boxcal.calib.four_steps.procedure import solve_four_steps
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.estimator import estimate
from boxcal.calib.results.build import refined
from boxcal.calib.results.calibration import Calibration, Provenance
from boxcal.calib.results.verdict import Level
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import Robot, turtlebot
from boxcal.detect.correspondences import Correspondences
from boxcal.target.box import Box, Target, make_target
from boxcal.target.measure.measured_size import Measured

BUILT = {"sx": 0.996, "sy": 0.998, "width": 0.2506, "depth": 0.2497, "height": 0.2}
RULER = np.diag([0.001, 0.001, 0.0003, 0.0003, 0.0003]) ** 2
LOW = 0.0005


def _built() -> Target:
    """The box as it stands there: printed at 99.6 % x 99.8 %, face 1 half a millimetre low."""
    target = make_target(Box(), Measured(**BUILT, cov=RULER))
    corners = target.tag_corners.copy()
    corners[target.tag_faces == 1, :, 2] -= LOW
    return replace(target, tag_corners=corners)


def _read(rng: np.random.Generator) -> Target:
    """What the user knows: each figure as a ruler reads it, nothing of the low face."""
    read = rng.multivariate_normal(list(BUILT.values()), RULER)
    return make_target(Box(), Measured(**dict(zip(BUILT, read.tolist(), strict=True)), cov=RULER))


def _drive(robot: Robot, known: Target, seed: int) -> Correspondences:
    """A drive around the box as built, its landmarks taken where the user believes them."""
    rng = np.random.default_rng(seed)
    drive = simulate_drive(robot, make_target(), DriveOptions(stops=14, slip=2e-4), rng)
    seen = exact_correspondences(robot, _built(), drive, 0.05, rng)
    return replace(seen, stops=tuple(replace(s, p_box=known.p_box(s.landmark_ids)) for s in seen.stops))


@pytest.mark.parametrize("seed", range(3))
def test_a_measured_box_with_free_faces_gives_wheels_within_3_sigma(seed: int) -> None:
    robot = turtlebot()
    known = _read(np.random.default_rng(100 + seed))
    drive = _drive(robot, known, seed)
    free = (2 * LOW / 0.125, 2 * LOW)
    found = estimate([drive], None, EstimateOptions(target=known, face_sigma=free))
    for name in ("rR", "rL", "b"):
        assert abs(getattr(found, name) - getattr(robot, name)) < 3 * found.sigma[name]
    sure = estimate(
        [drive], None, EstimateOptions(target=replace(known, measured=None), scale_sigma=0.0, face_sigma=free)
    )
    # All lengths scale with the box, so the ruler's 0.1 % is part of every sigma.
    assert found.sigma["rL"] > sure.sigma["rL"]
    assert found.sigma["rL"] > 0.0005 * robot.rL


def test_a_wrong_box_taken_as_designed_is_said_in_the_verdict() -> None:
    robot, design = turtlebot(), make_target()
    drive = _drive(robot, design, 1)
    steps = solve_four_steps(drive)
    as_designed = EstimateOptions(target=design, scale_sigma=0.0, face_sigma=(0.0, 0.0), bow_sigma=0.0)
    found = estimate([drive], [steps], as_designed)
    origin = Provenance(version="0", command="", created="2026-01-01T00:00:00+00:00")
    result: Calibration = refined("r", [drive], [steps], found, origin)
    judged = judge(result, drive, design)
    assert judged.level != "good"
    assert any("box" in r.text.lower() or "print" in r.text.lower() for r in judged.reasons if r.level != "good")
    assert any("measure" in r.advice.lower() for r in judged.reasons if r.level != "good")


@pytest.mark.parametrize("size", [0.99, 1.03])
def test_a_box_of_another_size_looks_like_a_wrong_print_and_is_not_good_until_it_is_measured(size: float) -> None:
    robot, design, rng = turtlebot(), make_target(), np.random.default_rng(5)
    figures = {"sx": 1.0, "sy": 1.0, "width": 0.25 * size, "depth": 0.25 * size, "height": 0.2}
    built = make_target(Box(), Measured(**figures, cov=RULER))
    drive = simulate_drive(robot, built, DriveOptions(stops=14, slip=2e-4), rng)
    seen = exact_correspondences(robot, built, drive, 0.05, rng)
    found, measured = (
        calibrate(replace(seen, stops=tuple(replace(s, p_box=box.p_box(s.landmark_ids)) for s in seen.stops)), box)
        for box in (design, built)
    )
    assert abs(found.wheels.rL * size / robot.rL - 1) < 2e-3
    assert found.verdict is not None
    assert found.verdict.level is Level.USABLE
    assert [r.rule for r in found.verdict.reasons if r.level is not Level.GOOD] == ["box-size"]
    assert "measure-target" in found.verdict.next_steps[0]
    assert measured.verdict is not None
    assert measured.verdict.level is Level.GOOD
    assert abs(measured.wheels.rL / robot.rL - 1) < 2e-3
