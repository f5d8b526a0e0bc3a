"""Stops from wheel angles: right ones at every rate and encoder, none where the robot creeps."""

import numpy as np
import pytest
from small_logs import STEP, T0_NS, drive

from boxcal.detect.errors import DetectError
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.detect.stops import Stop, StopSettings, find_stops
from boxcal.target.arrays import Array, Ids


def _samples(t_ns: Ids, phi_R: Array, phi_L: Array) -> WheelSamples:
    return WheelSamples(t_ns=t_ns, phi_R=phi_R, phi_L=phi_L)


def _spans(stops: tuple[Stop, ...]) -> Array:
    return np.array([(s.t_start_ns - T0_NS, s.t_end_ns - T0_NS) for s in stops]).reshape(-1, 2) / 1e9


@pytest.mark.parametrize("rate_hz", [5.0, 20.0, 50.0, 1000.0])
@pytest.mark.parametrize("step", [0.0, STEP, 2 * np.pi / 200])
def test_stops_are_found_at_every_rate_and_encoder(rate_hz: float, step: float) -> None:
    t_ns, phi_R, phi_L, true = drive(stops=6, rate_hz=rate_hz, stand=2.0, move=3.0, step=step)
    stops = find_stops(_samples(t_ns, phi_R, phi_L))
    assert len(stops) == 6
    # the first and last encoder step of a smooth move come late and early
    np.testing.assert_allclose(_spans(stops), true, atol=0.22 + 1 / rate_hz + (0.35 if step > 0.01 else 0))
    for stop in stops:
        middle = np.searchsorted(t_ns, (stop.t_start_ns + stop.t_end_ns) // 2)
        assert stop.phi_R == pytest.approx(phi_R[middle], abs=0.001)
        assert stop.phi_L == pytest.approx(phi_L[middle], abs=0.001)
        assert t_ns[stop.first_sample] == stop.t_start_ns
        assert t_ns[stop.last_sample] == stop.t_end_ns


def test_an_encoder_that_flickers_by_one_step_stands() -> None:
    t_ns, phi_R, phi_L, true = drive(stops=5, stand=2.0)
    flicker = STEP * np.random.default_rng(0).integers(0, 2, t_ns.size)
    stops = find_stops(_samples(t_ns, phi_R + flicker, phi_L))
    assert len(stops) == 5
    np.testing.assert_allclose(_spans(stops), true, atol=0.3)


def test_one_wheel_that_turns_is_no_stop() -> None:
    t_ns, phi_R, phi_L, _ = drive(stops=3, stand=2.0)
    turning = phi_L + np.floor(2.0 * (t_ns - T0_NS) / 1e9 / STEP) * STEP
    assert find_stops(_samples(t_ns, phi_R, turning)) == ()


@pytest.mark.parametrize("speed", [0.002, 0.005, 0.01, 0.05, 0.3])
@pytest.mark.parametrize("step", [0.0, STEP, 2 * np.pi / 64])
def test_creep_is_no_stop_however_slow_and_coarse(speed: float, step: float) -> None:
    t = np.linspace(0, max(60, 40 * max(step, 0.003) / speed), 20_000)
    phi = speed * t
    phi = np.floor(phi / step) * step if step else phi
    stops = find_stops(_samples(T0_NS + np.round(t * 1e9).astype(np.int64), phi, phi))
    assert stops == ()


def test_a_stop_that_ends_in_creep_is_kept_without_the_creep() -> None:
    t = np.arange(0, 12, 0.02)
    phi = np.where(t < 3, 2 * t, 6.0) + np.where(t > 6, 0.02 * (t - 6), 0) + np.where(t > 8, 2 * (t - 8), 0)
    phi = np.floor(phi / STEP) * STEP
    (stop,) = find_stops(_samples(T0_NS + np.round(t * 1e9).astype(np.int64), phi, phi))
    np.testing.assert_allclose(_spans((stop,)), [[3.0, 6.1]], atol=0.15)


def test_gaps_in_the_samples_neither_make_nor_break_stops() -> None:
    t_ns, phi_R, phi_L, _ = drive(stops=4, stand=2.0, move=2.0)
    t = (t_ns - T0_NS) / 1e9
    keep = ~(((t > 0.5) & (t < 1.5)) | ((t > 5.5) & (t < 8.2)))
    stops = find_stops(_samples(t_ns[keep], phi_R[keep], phi_L[keep]))
    np.testing.assert_allclose(_spans(stops), [[0, 2], [4, 5.5], [8.2, 10], [12, 14]], atol=0.25)


def test_a_stop_split_by_a_glitch_is_one_stop() -> None:
    t_ns, phi_R, phi_L, true = drive(stops=4, stand=2.0)
    glitch = np.zeros(t_ns.size)
    glitch[40:43] = 2 * STEP
    stops = find_stops(_samples(t_ns, phi_R + glitch, phi_L))
    assert len(stops) == 4
    np.testing.assert_allclose(_spans(stops)[0], true[0], atol=0.3)


def test_short_stands_are_left_out_and_settings_say_how_short() -> None:
    t_ns, phi_R, phi_L, _ = drive(stops=4, stand=0.3, move=2.0)
    samples = _samples(t_ns, phi_R, phi_L)
    assert len(find_stops(samples, StopSettings(min_stand=0.8))) == 0
    assert len(find_stops(samples, StopSettings(min_stand=0.2))) == 4


def test_no_samples_have_no_stops_and_settings_are_checked() -> None:
    empty = np.zeros(0)
    assert find_stops(_samples(np.zeros(0, dtype=np.int64), empty, empty)) == ()
    with pytest.raises(DetectError, match=r"min_stand is nan, a positive number is needed"):
        StopSettings(min_stand=float("nan"))


def test_a_long_log_is_searched_in_seconds() -> None:
    t_ns, phi_R, phi_L, _ = drive(stops=100, rate_hz=1000, stand=2.0, move=3.0)
    assert len(find_stops(_samples(t_ns, phi_R, phi_L))) == 100
