"""Slip's mean and standard deviation from a few levels of slip and jitter."""

import numpy as np
import pytest

from boxcal.calib.likelihood.moving.grid import Axis, mean_and_sigma

_QUIET = 1e-5


def _levels() -> tuple[np.ndarray, np.ndarray]:
    """Return 7 levels of slip, a third apart, each with 5 of jitter, (35,) both."""
    u = np.log(4e-4**2) + np.arange(-3, 4) * np.log(1.35**2)
    slip = Axis(quiet=_QUIET, least=1e-6, coarse=np.exp(u / 2), fine=7).closer(np.exp(u / 2), np.ones(7))
    return np.repeat(slip, 5), np.tile(np.geomspace(1e-4, 1e-2, 5), 7)


@pytest.mark.parametrize("spread", [0.005, 0.02, 0.1, 0.3])
@pytest.mark.parametrize("off", [0.0, 0.1, -0.14])
def test_slip_that_is_known_better_than_levels_are_apart_keeps_its_sigma(spread: float, off: float) -> None:
    slip, jitter = _levels()
    middle = 4e-4 * np.exp(off)
    log_likelihood = -0.5 * (np.log(slip / middle) / spread) ** 2 - 0.5 * (np.log(jitter / 1e-3) / 0.3) ** 2
    mean, sigma = mean_and_sigma(slip, log_likelihood)
    assert mean == pytest.approx(middle * np.exp(spread**2 / 2), rel=0.03 * spread + 1e-3)
    assert sigma == pytest.approx(middle * np.exp(spread**2 / 2) * np.sqrt(np.expm1(spread**2)), rel=0.04)


@pytest.mark.parametrize(
    ("slip_mm", "log_likelihood", "mean_mm"),
    [
        (
            (0.0175, 0.1323, 0.2345, 0.3697, 0.5611, 0.8386, 1.2450),
            (-3555.4, -87.4, -7.1, 0.6, -14.5, -41.7, -76.9),
            (0.30, 0.36),
        ),
        (
            (0.0129, 0.1508, 0.2441, 0.3461, 0.4671, 0.6156, 0.8009),
            (-1128.5, -7.3, 0.3, -7.1, -20.5, -37.9, -58.5),
            (0.22, 0.27),
        ),
    ],
)
def test_levels_far_from_what_is_probable_do_not_matter(
    slip_mm: tuple[float, ...], log_likelihood: tuple[float, ...], mean_mm: tuple[float, float]
) -> None:
    """Likelihoods of simulated drives, slip .3 mm: that of far too little slip falls without end."""
    mean, sigma = mean_and_sigma(1e-3 * np.array(slip_mm), np.array(log_likelihood))
    assert mean_mm[0] < 1e3 * mean < mean_mm[1]
    assert 0.015 < 1e3 * sigma < 0.05


def test_levels_that_rounding_hides_are_passed_over() -> None:
    slip, jitter = _levels()
    log_likelihood = -0.5 * (np.log(slip / 4e-4) / 0.1) ** 2 - 0.5 * (np.log(jitter / 1e-3) / 0.3) ** 2
    log_likelihood[:5] = -np.inf
    assert mean_and_sigma(slip, log_likelihood)[1] == pytest.approx(4e-5, rel=0.04)
    log_likelihood[: 6 * 5] = -np.inf
    assert mean_and_sigma(slip, log_likelihood) == (slip[-1], 0.0)


def test_slip_that_was_given_has_no_sigma() -> None:
    assert mean_and_sigma(np.full(5, 3e-4), np.linspace(-3, 0, 5)) == (pytest.approx(3e-4), 0.0)
