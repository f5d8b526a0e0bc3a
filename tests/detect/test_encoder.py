"""Encoder readings put right: step, wraps, resets, two wheels on one time base."""

import numpy as np
import pytest
from small_logs import STEP, T0_NS, drive

from boxcal.detect.errors import DetectError
from boxcal.detect.log.encoder import Encoder, clean, join
from boxcal.detect.log.encoder_step import encoder_step
from boxcal.target.arrays import Array


@pytest.mark.parametrize("step", [STEP, 2 * np.pi / 64, 2 * np.pi / 4096])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_an_encoders_step_is_read_off_its_angles(step: float, dtype: type) -> None:
    phi = drive(step=step)[1].astype(dtype).astype(np.float64)
    assert encoder_step(phi) == pytest.approx(step, rel=1e-5 if dtype is np.float32 else 1e-9)


def test_a_continuous_joint_has_no_step() -> None:
    rng = np.random.default_rng(0)
    assert encoder_step(drive(step=0)[1] + 1e-5 * rng.normal(size=drive()[1].size)) < 1e-4
    assert encoder_step(np.zeros(100)) == 0


def _wrapped(phi: Array, period: float, low: float) -> Array:
    return np.asarray(np.mod(phi - low, period) + low)


@pytest.mark.parametrize(
    ("period", "low"), [(2 * np.pi, 0.0), (2 * np.pi, -np.pi), (STEP * 2**10, 0.0), (STEP * 2**12, -STEP * 2**11)]
)
def test_angles_modulo_a_turn_or_a_counters_range_are_unwrapped(period: float, low: float) -> None:
    t_ns, phi, _, _ = drive(stops=8)
    step = STEP if period != 2 * np.pi else 0.0
    phi = phi if step else drive(stops=8, step=0)[1]
    encoder = clean(t_ns, _wrapped(phi, period, low), "a")
    np.testing.assert_allclose(encoder.phi - encoder.phi[0], phi - phi[0], atol=1e-6)


def test_angles_that_do_not_wrap_are_left_alone() -> None:
    t_ns, phi, _, _ = drive(stops=8)
    np.testing.assert_array_equal(clean(t_ns, phi, "a").phi, phi)
    fast = np.cumsum(np.full(100, 4.0))
    np.testing.assert_array_equal(clean(np.arange(1, 101) * 10**9, fast, "a").phi, fast)


def test_a_reset_in_motion_costs_the_travel_across_it_and_nothing_else() -> None:
    t_ns, phi, _, _ = drive()
    after = t_ns > T0_NS + 3.5e9
    encoder = clean(t_ns, np.where(after, phi - 10, phi), "who")
    at = int(np.argmax(after))
    assert np.flatnonzero(~encoder.covered).tolist() == [at]
    np.testing.assert_allclose(np.diff(encoder.phi)[at:], np.diff(phi)[at:], atol=1e-9)
    assert encoder.notes == ("its counter was set anew 1 time, first at 1700000003.520 s",)


def test_a_reset_at_rest_costs_nothing() -> None:
    t_ns, phi, _, true = drive()
    encoder = clean(t_ns, np.where(t_ns > T0_NS + 1e9 * true[1].mean(), phi - 10, phi), "who")
    assert np.all(encoder.covered)
    np.testing.assert_allclose(encoder.phi, phi, atol=1e-9)


@pytest.mark.parametrize("size", [0.05, 0.1, -0.3, 1000.0])
@pytest.mark.parametrize("step", [STEP, 0.0])
def test_single_strays_are_dropped_and_counted(size: float, step: float) -> None:
    t_ns, phi, _, _ = drive(step=step, stand=2.0)
    stray = phi.copy()
    stray[[60, 250]] += size  # at rest
    encoder = clean(t_ns, stray, "who")
    assert encoder.notes == ("2 stray readings dropped",)
    np.testing.assert_array_equal(encoder.phi, np.delete(phi, [60, 250]))


def test_motion_is_no_stray() -> None:
    t_ns, phi, _, _ = drive(rate_hz=10.0, stand=1.0, move=0.6)
    np.testing.assert_array_equal(clean(t_ns, phi, "a").phi, phi)


@pytest.mark.parametrize("range_steps", [2**16, 3000, 1000])
def test_counters_of_any_range_are_unwrapped(range_steps: int) -> None:
    t_ns, phi, _, _ = drive(stops=8, step=0)
    counts = np.floor(phi * 3000 / (2 * np.pi) * (1 if range_steps < 2**16 else 12))
    encoder = clean(t_ns, np.mod(counts, range_steps), "a", (2.0**16,))
    np.testing.assert_allclose(np.diff(encoder.phi), np.diff(counts), atol=1e-6)
    assert np.all(encoder.covered)


def test_a_single_wrap_at_an_odd_range_costs_its_leg_only() -> None:
    t_ns, phi, _, _ = drive(stops=8, step=0)
    counts = np.floor(phi * 3000 / (2 * np.pi))
    encoder = clean(t_ns, np.mod(counts, 9000), "a")
    right = np.isclose(np.diff(encoder.phi), np.diff(counts))
    np.testing.assert_array_equal(right, encoder.covered[1:])
    assert np.sum(~right) == 1


def test_readings_missing_in_motion_are_no_known_travel_and_at_rest_they_are() -> None:
    t_ns, phi, _, _ = drive(stops=4, stand=2.0, move=2.0)
    t = (t_ns - T0_NS) / 1e9
    for first, last, known in ((2.5, 3.6, False), (4.3, 5.8, True)):
        kept = (t < first) | (t > last)
        covered = clean(t_ns[kept], phi[kept], "a").covered
        assert np.sum(~covered) == (0 if known else 1)
        assert covered[np.argmax(t[kept] > last)] == known


def test_an_unreasonable_angle_and_too_few_times_are_refused() -> None:
    with pytest.raises(DetectError, match=r"who: position 1e\+300, angles in rad are needed"):
        clean(np.arange(1, 4), np.array([0, 1e300, 0]), "who")
    with pytest.raises(DetectError, match=r"who: 1 positions with 1 different header stamp"):
        clean(np.array([5]), np.array([1.0]), "who")


def test_of_repeated_stamps_the_last_reading_stays() -> None:
    encoder = clean(np.array([3, 2, 2, 5]), np.array([0.3, 0.1, 0.2, 0.5]), "who")
    np.testing.assert_array_equal(encoder.t_ns, [2, 3, 5])
    np.testing.assert_array_equal(encoder.phi, [0.2, 0.3, 0.5])


def test_wheels_that_do_not_overlap_in_time_are_refused() -> None:
    def at(start: int) -> Encoder:
        return Encoder(
            t_ns=np.arange(start, start + 10) * 10**9, phi=np.zeros(10), step=0.0, covered=np.ones(10, dtype=np.bool_)
        )

    with pytest.raises(DetectError, match=r"who: the right wheel was read from 0.000 to 9.000 s and the left from 50"):
        join(at(0), at(50), "who")
