"""Faults in a drive are named with time and size, left out, and leave the estimate right."""

from collections.abc import Callable
from dataclasses import replace
from math import radians

import numpy as np
import pytest

from boxcal.calib.geometry.so3_se3 import inverse, planar
from boxcal.calib.likelihood import Estimate, EstimateOptions
from boxcal.calib.likelihood.estimator import estimate, fit
from boxcal.calib.likelihood.leg_outliers import find_slip
from boxcal.calib.likelihood.outliers import LegMemory, flag_legs
from boxcal.calib.simulate.drive import Drive, DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import khepera
from boxcal.calib.uncertainty.cramer_rao import Truth, errors
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.arrays import Array
from boxcal.target.box import make_target

STEP = radians(0.1302)
STOPS = 12


@pytest.fixture(scope="module")
def drive() -> Drive:
    options = DriveOptions(stops=STOPS, slip=3e-4, encoder_step=STEP, steps_per_sample=2)
    return simulate_drive(khepera(), make_target(), options, np.random.default_rng(21))


def seen(drive: Drive, seed: int = 0) -> Correspondences:
    return exact_correspondences(khepera(), make_target(), drive, 0.2, np.random.default_rng(seed))


def worst_error(found: Estimate, drive: Drive) -> float:
    robot = khepera()
    truth = Truth.of(robot, drive.stop_poses, slip=3e-4, encoder_step=STEP)
    return float(np.abs(errors(found, truth) / np.sqrt(np.diag(found.cov))).max())


def with_wheels(data: Correspondences, change: Callable[[Array, Array], tuple[Array, Array]]) -> Correspondences:
    phi_R, phi_L = change(data.wheels.phi_R.copy(), data.wheels.phi_L.copy())
    stops = tuple(
        replace(s, phi_R=float(phi_R[s.first_sample]), phi_L=float(phi_L[s.first_sample])) for s in data.stops
    )
    return replace(data, wheels=WheelSamples(t_ns=data.wheels.t_ns, phi_R=phi_R, phi_L=phi_L), stops=stops)


def test_faultless_drive_has_nothing_named(drive: Drive) -> None:
    found = estimate([seen(drive)])
    assert not found.flagged_legs
    assert not found.flagged_corners
    assert not found.notes
    assert worst_error(found, drive) < 3.5


def test_slip_of_one_wheel_by_3_cm_is_named_with_wheel_size_and_time(drive: Drive) -> None:
    data = seen(drive)
    at = (data.stops[4].last_sample + data.stops[5].first_sample) // 2

    def spin(phi_R: Array, phi_L: Array) -> tuple[Array, Array]:
        phi_R[at:] += round(0.03 / khepera().rR / STEP) * STEP
        return phi_R, phi_L

    found = estimate([with_wheels(data, spin)])
    (leg,) = found.flagged_legs
    assert (leg.drive, leg.leg, leg.next_stop) == (0, 4, 5)
    assert leg.t_start_ns <= data.wheels.t_ns[at] <= leg.t_end_ns
    assert abs(leg.turn_deg) == pytest.approx(np.degrees(0.03 / khepera().b), abs=1)
    assert leg.slip_explains
    assert "slip of the right wheel by 3" in leg.text
    assert worst_error(found, drive) < 3.5


def test_robot_that_was_carried_is_named(drive: Drive) -> None:
    data = seen(drive)
    a, b = data.stops[7].last_sample + 1, data.stops[8].first_sample

    def lift(phi_R: Array, phi_L: Array) -> tuple[Array, Array]:
        third = (b - a) // 3
        for phi in (phi_R, phi_L):
            lost = phi[a + 2 * third] - phi[a + third]
            phi[a + third : a + 2 * third] = phi[a + third]
            phi[a + 2 * third :] -= lost
        return phi_R, phi_L

    found = estimate([with_wheels(data, lift)])
    (leg,) = found.flagged_legs
    assert leg.leg == 7
    assert leg.p_value < 1e-6
    assert "carried" in leg.text or "lifted" in leg.text
    assert worst_error(found, drive) < 3.5


def test_box_pushed_by_5_mm_is_named_with_its_displacement(drive: Drive) -> None:
    half = STOPS // 2
    T_old_new = planar(0.003, -0.004, radians(0.3))
    T_box_cam = drive.T_box_cam.copy()
    T_box_cam[half:] = inverse(T_old_new) @ T_box_cam[half:]
    found = estimate([seen(replace(drive, T_box_cam=T_box_cam))])
    (leg,) = found.flagged_legs
    assert leg.leg == half - 1
    assert np.hypot(leg.box_moved_mm[0] - 3, leg.box_moved_mm[1] + 4) < 2
    assert leg.box_turned_deg == pytest.approx(0.3, abs=0.3)
    assert f"all {STOPS - half} stops after it agree" in leg.text
    assert worst_error(found, drive) < 3.5


def test_wrong_corners_are_named_one_by_one(drive: Drive) -> None:
    data, rng = seen(drive), np.random.default_rng(5)
    wrong: set[tuple[int, int]] = set()
    stops = []
    for j, stop in enumerate(data.stops):
        rows = np.flatnonzero(rng.random(len(stop.uv_px)) < 0.02)
        uv = stop.uv_px.copy()
        uv[rows] += rng.choice([-1, 1], (len(rows), 2)) * rng.uniform(3, 20, (len(rows), 2))
        wrong |= {(j, int(i)) for i in stop.landmark_ids[rows]}
        stops.append(replace(stop, uv_px=uv))
    found = estimate([replace(data, stops=tuple(stops))])
    assert {(c.stop, c.landmark_id) for c in found.flagged_corners} == wrong
    assert worst_error(found, drive) < 3.5
    assert any(f"{len(wrong)} of " in note for note in found.notes)


def test_stop_whose_corners_are_mostly_wrong_is_pointed_out_not_thinned(drive: Drive) -> None:
    data = seen(drive)
    stop = data.stops[3]
    uv = stop.uv_px.copy()
    uv += np.random.default_rng(1).normal(size=uv.shape) * 4
    found = estimate([replace(data, stops=(*data.stops[:3], replace(stop, uv_px=uv), *data.stops[4:]))])
    assert any(note.startswith("stop 4: more than half") for note in found.notes)
    assert not [c for c in found.flagged_corners if c.stop == 3]


def test_a_leg_that_stays_does_not_take_the_place_of_a_second_bad_one(drive: Drive) -> None:
    found = fit([seen(drive)], None, EstimateOptions(find_faults=False))
    p_value = np.full(STOPS - 1, 0.5)
    p_value[[3, 7]] = 1e-9, 1e-6
    tests = replace(found.tests, p_value=p_value)
    stay = np.arange(STOPS - 1) == 3
    for flagged, out in ((None, 3), (stay, 7), (np.zeros(0, dtype=np.bool_), 3)):
        legs = flag_legs(found.problem, tests, found.weights, 0.01, flagged)
        assert np.flatnonzero(legs == 0).tolist() == [out]
    memory = LegMemory()
    for worst in (3, 0, 3, 0):  # left out and let in again, twice
        legs = np.ones(STOPS - 1)
        legs[worst] = 0 if worst else 1
        memory.settled(legs)
    assert np.flatnonzero(memory.stay).tolist() == [3]


def test_find_slip_recovers_a_slip_of_either_wheel_or_both() -> None:
    wheels = np.array([0.03, 0.029, 0.1])
    turn, ahead = np.tile([0.05, -0.05], (40, 1)), np.tile([0.08, 0.08], (60, 1))
    dphi = np.concatenate([turn, ahead, -0.5 * turn, ahead])

    def end(travel: Array) -> Array:
        u = travel * wheels[:2]
        dth = (u[:, 0] - u[:, 1]) / wheels[2]
        th = np.cumsum(dth) - dth / 2
        step = u.mean(axis=1) * np.sinc(dth / 2 / np.pi)
        return np.array([np.sum(step * np.cos(th)), np.sum(step * np.sin(th)), np.sum(dth)])

    for right, left in ((0.03, 0.0), (0.0, -0.02), (0.02, 0.02)):
        read = dphi.copy()
        read = np.insert(read, 70, [right / wheels[0], left / wheels[1]], axis=0)
        slip = find_slip(read, wheels, end(read) - end(dphi), np.diag([1e-8, 1e-8, 1e-8]))
        assert slip.simple
        assert (slip.right, slip.left) == pytest.approx((right, left), abs=1.5e-3)
    moved = find_slip(dphi, wheels, np.array([0.2, -0.3, 0.0]), np.diag([1e-8, 1e-8, 1e-8]))
    assert not moved.simple or moved.chance > 0.01
