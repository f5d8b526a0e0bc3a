"""What the four steps promise in detail: standard errors, the rule for alike wheels, the mean of cameras, legs."""

from typing import Any

import numpy as np
import pytest

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.camera_mode import CameraMode
from boxcal.calib.four_steps.procedure import solve_motion
from boxcal.calib.four_steps.step1_camera import calibrate_camera
from boxcal.calib.four_steps.step2_heading import MAX_RELATIVE_SIGMA, solve_heading, unwrap_turns
from boxcal.calib.geometry.diff_drive import Legs, legs_between, stop_pairs, unit_path
from boxcal.calib.geometry.so3_se3 import inverse, wrap
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.arrays import Array


def nearly_straight(relative_sigma: float, sigma: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Turns seen and wheel angles of all pairs of 12 stops, where aR's true standard error is this share of aR.

    Headings err by sigma (rad) at each stop. With phi_R = c + d and phi_L = c - d the turn is aR + aL times c plus
    aR - aL times d; the second is badly determined, with the standard error ``sigma / |d|`` of a straight line's slope
    over the centred d, and aR takes half of it.
    """
    a, stops = 0.25, 12
    c = np.linspace(0, 60, stops)
    d = rng.normal(size=stops)
    d -= np.polyval(np.polyfit(c, d, 1), c)
    d *= sigma / 2 / (relative_sigma * a) / np.linalg.norm(d)
    heading = 2 * a * d + sigma * rng.normal(size=stops)
    phi = np.stack([c + d, c - d], axis=1)
    i, j = np.triu_indices(stops, 1)
    return wrap(heading[j] - heading[i]), phi[j] - phi[i]


def test_standard_error_of_step_2_counts_independent_moves_not_pairs() -> None:
    """A pair is no measurement of its own: of 66 pairs of 12 stops only 11 moves are independent.

    The estimated error's own spread is 1/sqrt(2 * 10), so at 1.8 times the limit nearly all drives must be refused and
    at 0.4 times none; had all pairs counted, the first would look like 0.73 times the limit.
    """
    rng = np.random.default_rng(1)
    refused = {1.8: 0, 0.4: 0}
    for times_limit in refused:
        for _ in range(20):
            try:
                solve_heading(*nearly_straight(times_limit * MAX_RELATIVE_SIGMA, np.radians(0.5), rng), moves=11)
            except CalibError:
                refused[times_limit] += 1
    assert refused[1.8] >= 15
    assert refused[0.4] == 0


@pytest.mark.parametrize(("log_ratio", "alike"), [(0.17, True), (0.23, False)])
def test_three_stops_take_the_winding_of_alike_wheels_before_that_of_less_turning(
    log_ratio: float, alike: bool
) -> None:
    """Any winding fits three stops exactly: of wheels up to exp(0.2) = 1.22 apart the turn may be the larger one.

    Both moves turned by more than a whole turn. Seen modulo a turn they may have been of half a turn at most, which
    wheels explain whose radii are by exp(0.4) or more apart.
    """
    mean = 0.25
    aR, aL = mean * np.exp(log_ratio / 2), -mean * np.exp(-log_ratio / 2)
    moves = np.array([[24.0, -8.0], [-11.0, 30.0]])
    phi = np.vstack([moves, moves.sum(axis=0)])
    true = phi @ (aR, aL)
    found = unwrap_turns(wrap(true), phi)
    fit = np.linalg.lstsq(phi, found, rcond=None)[0]
    np.testing.assert_allclose(phi @ fit, found, atol=1e-9)
    if alike:
        np.testing.assert_allclose(found, true, atol=1e-9)
    else:
        assert np.abs(found).sum() < np.abs(true).sum() - 1


def test_camera_of_the_paper_is_the_mean_of_the_stops_own_cameras(exact: Any) -> None:
    drive = exact.through(exact.around(9, 0.9, 0.0, np.random.default_rng(6)), exact.mounting(2.0, 9.0, 1.0))
    seen = drive.correspondences(0.3, np.random.default_rng(8)).stops
    together = calibrate_camera(seen, (640, 480), CameraMode.PER_STOP)
    alone = [calibrate_camera((seen[j],), (640, 480), CameraMode.PER_STOP).camera for j in together.kept]
    assert len(alone) >= 5
    for name in ("fu", "fv", "cu", "cv", "kr"):
        values = [getattr(camera, name) for camera in alone]
        assert getattr(together.camera, name) == pytest.approx(np.mean(values), rel=1e-12)
        assert abs(np.mean(values) - np.median(values)) > 1e-6 * np.ptp(values)  # so that the two can be told apart


def stop(first: int, last: int, phi: Array) -> StopObservation:
    none = np.zeros(0)
    return StopObservation(
        t_start_ns=first, t_end_ns=last, first_sample=first, last_sample=last, phi_R=float(phi[0]), phi_L=float(phi[1]),
        landmark_ids=none.astype(np.int64), p_box=none.reshape(0, 3), uv_px=none.reshape(0, 2),
        cov_px2=none.reshape(0, 2, 2), frames=0,
    )  # fmt: skip


def test_a_leg_holds_both_stops_angles_and_every_sample_between_them() -> None:
    phi = np.stack([np.arange(12.0) ** 2, 100 - np.arange(12.0) ** 3], axis=1)
    drive = Correspondences(
        robot="r", image_size=(640, 480),
        wheels=WheelSamples(t_ns=np.arange(12), phi_R=phi[:, 0], phi_L=phi[:, 1]),
        stops=(stop(0, 2, phi[1] + 0.25), stop(7, 9, phi[8] - 0.25), stop(10, 11, phi[10])),
    )  # fmt: skip
    for wheel in (0, 1):
        whole = drive.leg(0)[wheel]
        np.testing.assert_array_equal(whole, [phi[1, wheel] + 0.25, *phi[3:7, wheel], phi[8, wheel] - 0.25])
        np.testing.assert_array_equal(drive.leg(1)[wheel], [phi[8, wheel] - 0.25, phi[10, wheel]])
    legs = legs_between(drive)
    assert legs.ends == (0, 5, 6)
    np.testing.assert_allclose(legs.phi_R, [0, phi[8, 0] - phi[1, 0] - 0.5, phi[10, 0] - phi[1, 0] - 0.25], rtol=1e-12)
    through = legs_between(drive, (0, 2))  # the middle stop driven through
    assert through.ends == (0, 6)
    np.testing.assert_allclose(through.phi_L[1], phi[10, 1] - phi[1, 1] - 0.25, rtol=1e-12)


def test_what_step_4_says_of_its_fit_is_what_its_solution_leaves(exact: Any) -> None:
    """The residual is how far wheels and camera disagree on where the body went, root mean square over the pairs."""
    drive = exact.through(exact.around(8, 1.2, 3.0, np.random.default_rng(9)), exact.mounting(3.0, 9.0, 1.0))
    slip = 1 + 0.01 * np.random.default_rng(10).normal(size=drive.dphi.shape)
    legs = Legs(dphi_R=drive.dphi[:, 0] * slip[:, 0], dphi_L=drive.dphi[:, 1] * slip[:, 1], ends=drive.ends)
    found = solve_motion(drive.camera_step(), legs)
    step, T_cam_box = found.mounting, drive.T_cam_box
    xy, heading = unit_path(legs, found.heading.aR, found.heading.aL)
    square = []
    for i, j in zip(*np.triu_indices(len(T_cam_box), 1), strict=True):
        seen = found.T_body_cam @ T_cam_box[j] @ inverse(T_cam_box[i]) @ inverse(found.T_body_cam)  # bodyj from bodyi
        c, s = np.cos(heading[i]), np.sin(heading[i])
        beta = np.array([[c, s], [-s, c]]) @ (xy[j] - xy[i])
        back = float(found.axis.theta[i, j])
        rolled = -np.array([[np.cos(back), -np.sin(back)], [np.sin(back), np.cos(back)]]) @ beta * step.rL
        square.append(np.sum((rolled - seen[:2, 3]) ** 2))
    assert step.rms == pytest.approx(np.sqrt(np.mean(square)), rel=1e-6)
    assert step.rank_ratio == pytest.approx(step.singular_values[3] / step.singular_values[2], rel=1e-12)
    assert step.null_ratio == pytest.approx(step.singular_values[4] / step.singular_values[3], rel=1e-12)
    assert 0 < step.null_ratio < step.rank_ratio < 1
    assert step.rms > 1e-4


def test_three_stops_name_no_swapped_wheels_since_any_number_of_whole_turns_fits_them() -> None:
    phi = np.array([[33.456, 13.177], [-1.198, 18.665]])
    with pytest.raises(CalibError, match="3 stops do not determine how the wheels roll"):
        solve_heading(wrap(phi @ (0.173, -0.178)), phi, 2)


def test_pairs_of_many_stops_grow_with_their_number_not_its_square():
    i, j = stop_pairs(20)
    np.testing.assert_array_equal((i, j), np.triu_indices(20, 1))
    i, j = stop_pairs(500)
    gaps = j - i
    assert len(i) < 20 * 500
    assert np.count_nonzero(gaps == 1) == 499
    assert gaps.max() == 499
    largest = np.unique(gaps)
    assert np.all(largest[1:] <= 2 * largest[:-1])
