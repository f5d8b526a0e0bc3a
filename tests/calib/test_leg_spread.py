"""Legs that slip unlike: not taken for faults, and weighed less where they slip much."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, special, stats

from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.estimator import estimate
from boxcal.calib.likelihood.leg_spread import SPREADS, spread_of, spread_weights, surprise
from boxcal.calib.simulate.drive import DriveOptions
from boxcal.calib.simulate.imperfect_drive import hand_made, imperfect_drive
from boxcal.calib.simulate.robot import turtlebot
from boxcal.target.box import make_target

LEGS = 13
LIMIT = 0.01 / LEGS
QUANTILES = (np.arange(LEGS - 1) + 0.5) / (LEGS - 1)
ALIKE = stats.chi2(3).ppf(QUANTILES)
UNLIKE = np.random.default_rng(5).permutation(ALIKE) * np.exp(1.6 * stats.norm.ppf(QUANTILES))


def chance(of: float, others: np.ndarray) -> float:
    square = np.append(others, of)
    normal = special.chdtrc(3, square)
    return float(surprise(normal, square, np.full(LEGS, 3), np.ones(LEGS, dtype=np.bool_))[-1])


def test_one_leg_unlike_the_others_is_surprising_only_where_these_are_alike() -> None:
    assert chance(80.0, ALIKE) < LIMIT
    assert chance(80.0, UNLIKE) > 10 * LIMIT
    assert chance(1e5, UNLIKE) < LIMIT
    assert chance(3.0, ALIKE) > 0.3


def test_a_leg_far_off_others_that_may_or_may_not_be_alike_is_a_fault() -> None:
    """Squares of a real drive of 12 legs whose wheel was nudged at a stop, .02 rad between two readings."""
    square = np.array([6.2, 10.3, 9.0, 0.2, 0.4, 2.1, 412.6, 0.06, 2.2, 1.3, 4.0, 1.6])
    normal = special.chdtrc(3, square)
    found = surprise(normal, square, np.full(12, 3), np.ones(12, dtype=np.bool_))
    assert found[6] < 1e-80
    assert np.all(np.delete(found, 6) > 0.01)


def test_another_faulty_leg_hides_none() -> None:
    others = ALIKE.copy()
    others[-1] = 500.0
    assert chance(200.0, others) < LIMIT


def test_few_legs_say_nothing_of_the_spread() -> None:
    normal = np.array([1e-5, 0.5, 0.4, 0.6])
    square = np.array([25.0, 2.0, 3.0, 2.0])
    np.testing.assert_array_equal(surprise(normal, square, np.full(4, 3), np.ones(4, dtype=np.bool_)), normal)


def test_spread_is_found_where_it_is_clear() -> None:
    assert spread_of(ALIKE) == 0
    assert spread_of(UNLIKE) == 1.6
    assert spread_of(UNLIKE[:5]) == 0


@pytest.mark.parametrize("square", [0.1, 3.0, 30.0])
def test_weight_is_the_expected_inverse_of_the_variance(square: float) -> None:
    spread = SPREADS[1]

    def density(x: float) -> float:
        return float(np.exp(-0.5 * (x / spread) ** 2 - 0.5 * square * np.exp(-x) - 1.5 * x))

    total, _ = integrate.quad(density, -8, 8)
    inverse, _ = integrate.quad(lambda x: density(x) * np.exp(-x), -8, 8)
    weight = spread_weights(np.array([square, square]), np.array([1.0, 0.0]), spread)
    assert weight[0] == pytest.approx(inverse / total, rel=0.01)
    assert weight[1] == 0
    assert spread_weights(np.array([square]), np.ones(1), 0.0)[0] == pytest.approx(1)


@pytest.mark.parametrize("seed", [2, 10])
def test_faultless_drives_with_legs_that_slip_unlike_keep_their_legs(seed: int) -> None:
    """Slips of legs differ by a factor of 2.2 (one standard deviation)."""
    rng = np.random.default_rng([seed, 77])
    faults = hand_made(rng)
    faults = replace(faults, wheels=replace(faults.wheels, slip_spread=0.8))
    seen = imperfect_drive(turtlebot(), make_target(), DriveOptions(stops=14, steps_per_sample=4), faults, rng).seen
    found = estimate([seen], None, EstimateOptions(target=make_target()))
    assert not found.flagged_legs
    off = {"rR": found.rR - turtlebot().rR, "rL": found.rL - turtlebot().rL, "b": found.b - turtlebot().b}
    assert max(abs(value) / found.sigma[name] for name, value in off.items()) < 3.5
