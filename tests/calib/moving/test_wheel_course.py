"""How the wheels turn around a moment, as it is told by their readings."""

import numpy as np

from boxcal.calib.likelihood.moving.course import rates_after, turned, wheel_course
from boxcal.detect.log.wheel_samples import WheelSamples

STEP_NS = 20_000_000
AT_NS = np.array([807_000_000, 1_313_000_000])
AFTER = AT_NS // STEP_NS + 1


def _angle(t_s: np.ndarray) -> np.ndarray:
    return np.stack([0.3 + 4 * t_s - 3 * t_s**2 + 5 * t_s**3, -2 + t_s + 2 * t_s**3], axis=-1)


def _samples(step: float = 0.0, gap: int | None = None) -> WheelSamples:
    t_ns = np.arange(100) * STEP_NS
    phi = _angle(t_ns / 1e9)
    if step:
        phi = np.floor(phi / step) * step
    covered = np.ones(100, dtype=np.bool_)
    if gap is not None:
        covered[gap] = False
    return WheelSamples(
        t_ns=t_ns, phi_R=phi[:, 0].copy(), phi_L=phi[:, 1].copy(), covered=covered, encoder_steps=(step, step)
    )


def test_a_cubic_course_is_told_exactly() -> None:
    course, t = wheel_course(_samples(), AT_NS, AFTER), AT_NS / 1e9
    np.testing.assert_allclose(course[:, 0, 0], 4 - 6 * t + 15 * t**2, rtol=1e-9)
    np.testing.assert_allclose(course[:, 1, 1], 12 * t, rtol=1e-8)
    np.testing.assert_allclose(course[:, 2, 0], 30.0, rtol=1e-7)
    for since in (-0.02, 0.013):
        later = np.full(2, since)
        np.testing.assert_allclose(turned(course, later), _angle(t + since) - _angle(t), rtol=0, atol=1e-10)
        slope = (turned(course, later + 1e-5) - turned(course, later - 1e-5)) / 2e-5
        np.testing.assert_allclose(rates_after(course, later), slope, rtol=1e-8)


def test_rounded_readings_tell_what_turns_within_a_frame_to_a_tenth_of_their_step() -> None:
    step = 2.3e-3
    course, t = wheel_course(_samples(step), AT_NS, AFTER), AT_NS / 1e9
    for since in (-0.01, 0.01):
        off = turned(course, np.full(2, since)) - (_angle(t + since) - _angle(t))
        assert np.abs(off).max() < step / 10


def test_across_a_gap_only_the_nearest_readings_are_taken() -> None:
    samples = _samples(gap=int(AFTER[0]) + 2)
    course = wheel_course(samples, AT_NS, AFTER)
    between = (samples.phi_R[AFTER[0]] - samples.phi_R[AFTER[0] - 1]) / (STEP_NS / 1e9)
    np.testing.assert_allclose(course[0, 0, 0], between, rtol=1e-12)
    assert not course[0, 1:].any()
    assert course[1, 1:].any()
