"""Encoder readings put right, joined, and stops found in them, whatever the driver, the clock and the scale."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from boxcal.detect.log.encoder import Encoder, clean, join
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.detect.stops import StopSettings, find_stops
from boxcal.target.arrays import Array, Ids

seeds = st.integers(0, 2**32 - 1)
T0_NS = 1_700_000_000_000_000_000


def rolled(rng: np.random.Generator, samples: int = 400, fastest: float = 0.2) -> Array:
    """A wheel's angle over a drive: it stands, speeds up, slows down and turns back, at most this much a sample."""
    speed = np.convolve(rng.normal(size=samples), np.ones(25) / 25, mode="same")
    speed[np.convolve(rng.random(samples) < 0.01, np.ones(20), mode="same") > 0] = 0.0
    return np.asarray(np.cumsum(fastest * speed / max(np.abs(speed).max(), 1e-9)) + rng.uniform(-20, 20))


def stamps(rng: np.random.Generator, samples: int) -> Ids:
    return np.asarray(T0_NS + np.cumsum(rng.integers(15_000_000, 25_000_000, samples)))


@given(seeds, st.sampled_from([0.0, 1e-3, 0.00227, 0.05]))
def test_cleaning_leaves_sound_readings_alone(seed: int, step: float) -> None:
    rng = np.random.default_rng(seed)
    phi = rolled(rng)
    phi = np.floor(phi / step) * step if step else phi
    t_ns = stamps(rng, len(phi))
    found = clean(t_ns, phi, "log")
    np.testing.assert_array_equal(found.t_ns, t_ns)
    np.testing.assert_array_equal(found.phi, phi)
    again = clean(found.t_ns, found.phi, "log")
    np.testing.assert_array_equal(again.phi, found.phi)
    assert again.step == found.step


@given(seeds)
def test_order_of_arrival_and_repeated_messages_change_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    phi = rolled(rng)
    t_ns = stamps(rng, len(phi))
    sound = clean(t_ns, phi, "log")
    late = np.argsort(np.arange(len(phi)) + rng.uniform(0, 4, len(phi)), kind="stable")
    twice = np.concatenate([late, late[rng.integers(0, len(phi), 20)]])
    found = clean(t_ns[twice], phi[twice], "log")
    np.testing.assert_array_equal(found.t_ns, sound.t_ns)
    np.testing.assert_array_equal(found.phi, sound.phi)


@given(seeds, st.sampled_from([-np.pi, 0.0]))
def test_angles_modulo_a_turn_give_the_same_travel(seed: int, low: float) -> None:
    rng = np.random.default_rng(seed)
    phi = np.cumsum(np.abs(np.diff(rolled(rng, 600), prepend=0.0)[1:]))  # forward all the time: every turn is filled
    t_ns = stamps(rng, len(phi))
    wrapped = (phi - low) % (2 * np.pi) + low
    found = clean(t_ns, wrapped, "log")
    np.testing.assert_allclose(np.diff(found.phi), np.diff(phi), atol=1e-9)


@given(seeds, st.floats(-100, 100))
def test_an_encoder_that_counts_from_elsewhere_or_backwards_tells_the_same_travel(seed: int, offset: float) -> None:
    rng = np.random.default_rng(seed)
    phi = rolled(rng)
    t_ns = stamps(rng, len(phi))
    sound, shifted, mirrored = (clean(t_ns, p, "log") for p in (phi, phi + offset, -phi))
    np.testing.assert_allclose(np.diff(shifted.phi), np.diff(sound.phi), atol=1e-10)
    np.testing.assert_allclose(mirrored.phi, -sound.phi, atol=1e-12)


def encoder(t_ns: Ids, phi: Array, step: float) -> Encoder:
    return replace(clean(t_ns, phi, "log"), step=step)


@given(seeds)
def test_wheels_on_one_time_base_keep_every_reading_and_their_side(seed: int) -> None:
    """Each wheel with its own stamps: at those its own readings stand; between them, the straight line."""
    rng = np.random.default_rng(seed)
    sides = []
    for step in (0.01, 0.02):
        phi = rolled(rng)
        sides.append(encoder(stamps(rng, len(phi)) + int(rng.integers(0, 10_000_000)), phi, step))
    right, left = sides
    found, swapped = join(right, left, "log"), join(left, right, "log")
    assert np.all(np.diff(found.t_ns) > 0)
    assert found.encoder_steps == (0.01, 0.02) == swapped.encoder_steps[::-1]
    assert np.all(found.covered)
    np.testing.assert_array_equal(found.phi_R, swapped.phi_L)
    np.testing.assert_array_equal(found.phi_L, swapped.phi_R)
    for own, joined in ((right, found.phi_R), (left, found.phi_L)):
        inside = (own.t_ns >= found.t_ns[0]) & (own.t_ns <= found.t_ns[-1])
        at = np.searchsorted(found.t_ns, own.t_ns[inside])
        np.testing.assert_array_equal(found.t_ns[at], own.t_ns[inside])
        np.testing.assert_allclose(joined[at], own.phi[inside], rtol=0, atol=1e-12)
        between = np.interp(found.t_ns - T0_NS, own.t_ns - T0_NS, own.phi)
        np.testing.assert_allclose(joined, between, rtol=0, atol=1e-9)


@given(seeds)
def test_travel_that_one_wheel_does_not_know_is_unknown_for_both(seed: int) -> None:
    """A joined sample is covered if no unknown stretch of either wheel reaches into the time since the one before."""
    rng = np.random.default_rng(seed)
    sides = []
    for _ in range(2):
        phi = rolled(rng, 60)
        one = encoder(stamps(rng, len(phi)) + int(rng.integers(0, 10_000_000)), phi, 0.0)
        covered = np.concatenate([[True], rng.random(len(one.phi) - 1) < 0.9])
        sides.append(replace(one, covered=covered))
    right, left = sides
    found = join(right, left, "log")
    for k in range(1, len(found.t_ns)):
        unknown = [
            e.t_ns[j - 1] < found.t_ns[k] and found.t_ns[k - 1] < e.t_ns[j]
            for e in sides
            for j in np.flatnonzero(~e.covered)
        ]
        assert found.covered[k] == (not any(unknown)), k


@given(seeds)
def test_one_time_base_for_both_wheels_is_kept(seed: int) -> None:
    rng = np.random.default_rng(seed)
    phi = rolled(rng)
    t_ns = stamps(rng, len(phi))
    found = join(encoder(t_ns, phi, 0.0), encoder(t_ns, -phi, 0.0), "log")
    np.testing.assert_array_equal(found.t_ns, t_ns)
    np.testing.assert_array_equal(found.phi_R, -found.phi_L)


def stop_and_go(seed: int) -> WheelSamples:
    """Stands of 0.6 to 3 s with moves of 0.5 to 2 s between them, at 50 Hz, both wheels at their own speed."""
    rng = np.random.default_rng(seed)
    speed = []
    for _ in range(6):
        speed.append(np.zeros((int(rng.integers(30, 150)), 2)))
        count = int(rng.integers(25, 100))
        shape = np.sin(np.linspace(0, np.pi, count))[:, None]
        speed.append(shape * rng.uniform(1, 6, 2) * rng.choice([-1, 1], 2) / 50)
    speed.append(np.zeros((int(rng.integers(30, 150)), 2)))
    phi = np.cumsum(np.concatenate(speed), axis=0)
    t_ns = T0_NS + 20_000_000 * np.arange(len(phi))
    return WheelSamples(t_ns=t_ns, phi_R=phi[:, 0], phi_L=phi[:, 1], encoder_steps=(0.0, 0.0))


def rows(samples: WheelSamples, settings: StopSettings) -> list[tuple[int, int]]:
    return [(s.first_sample, s.last_sample) for s in find_stops(samples, settings)]


@given(seeds, st.sampled_from([2, 3, 10]))
def test_a_drive_in_slow_motion_has_the_same_stops(seed: int, slower: int) -> None:
    samples = stop_and_go(seed)
    slow = replace(samples, t_ns=T0_NS + slower * (samples.t_ns - T0_NS))
    assert rows(samples, StopSettings()) == rows(slow, StopSettings(min_stand=slower * StopSettings().min_stand))
    assert len(rows(samples, StopSettings())) == 7


@given(seeds, st.sampled_from([0.25, 4.0]))
def test_wheels_of_another_size_have_the_same_stops(seed: int, larger: float) -> None:
    samples = stop_and_go(seed)
    scaled = replace(samples, phi_R=larger * samples.phi_R, phi_L=larger * samples.phi_L)
    assert rows(samples, StopSettings()) == rows(scaled, StopSettings(max_angle=larger * StopSettings().max_angle))


@given(seeds, st.integers(-(10**17), 10**17), st.floats(-50, 50))
def test_when_and_where_the_counters_began_does_not_matter(seed: int, later_ns: int, offset: float) -> None:
    samples = stop_and_go(seed)
    other = replace(samples, t_ns=samples.t_ns + later_ns, phi_R=samples.phi_R + offset, phi_L=-samples.phi_L)
    there, here = find_stops(other), find_stops(samples)
    assert [s.first_sample for s in there] == [s.first_sample for s in here]
    for a, b in zip(there, here, strict=True):
        assert a.t_start_ns - b.t_start_ns == later_ns
        assert a.phi_R - b.phi_R == pytest.approx(offset, abs=1e-9)
        assert a.phi_L == pytest.approx(-b.phi_L, abs=1e-9)
