"""The estimator on simulated drives: exact, noisy, over several drives, with priors."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import solve_four_steps
from boxcal.calib.geometry.parameters import ORDER
from boxcal.calib.geometry.so3_se3 import exp_so3, rigid
from boxcal.calib.likelihood import Estimate, EstimateOptions
from boxcal.calib.likelihood.estimator import estimate
from boxcal.calib.simulate.drive import Drive, DriveOptions, exact_correspondences, exact_options, simulate_drive
from boxcal.calib.simulate.robot import Robot, khepera, turtlebot
from boxcal.calib.uncertainty.cramer_rao import Truth, cramer_rao, errors
from boxcal.calib.uncertainty.cross_validation import validate
from boxcal.calib.uncertainty.propagation import ground_uncertainty
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array
from boxcal.target.box import make_target

TARGET = make_target()
STEP = radians(0.1302)


def noisy(
    robot: Robot, seed: int, stops: int = 12, slip: float = 3e-4, sigma_px: float = 0.2
) -> tuple[Correspondences, Truth, Drive]:
    rng = np.random.default_rng(seed)
    options = DriveOptions(stops=stops, slip=slip, encoder_step=STEP, steps_per_sample=2)
    drive = simulate_drive(robot, TARGET, options, rng)
    return exact_correspondences(robot, TARGET, drive, sigma_px, rng), truth_of(robot, (drive,), slip), drive


def truth_of(robot: Robot, drives: tuple[Drive, ...], slip: float) -> Truth:
    return Truth.of(robot, *(d.stop_poses for d in drives), slip=slip, encoder_step=STEP)


def normalised(found: Estimate, truth: Truth) -> Array:
    return errors(found, truth) / np.sqrt(np.diag(found.cov))


def test_exact_drive_is_recovered_and_its_noise_levels_end_at_their_floors() -> None:
    robot = khepera()
    drive = simulate_drive(robot, TARGET, exact_options(8), np.random.default_rng(0))
    data = exact_correspondences(robot, TARGET, drive)
    found = estimate([data], solve_four_steps(data))
    assert np.abs(errors(found, truth_of(robot, (drive,), 0.0))[5:]).max() < 1e-9
    assert found.noise.pixel_px == pytest.approx(1e-5)
    assert found.noise.slip < 1e-6
    assert found.noise.encoder_step == 0
    assert not found.flagged_legs
    assert not found.flagged_corners


@pytest.mark.parametrize(("robot", "seed"), [(khepera(), 1), (turtlebot(), 2)])
def test_noisy_drive_is_recovered_within_predicted_sigmas(robot: Robot, seed: int) -> None:
    data, truth, drive = noisy(robot, seed)
    found = estimate([data], solve_four_steps(data))
    z = normalised(found, truth)
    assert np.abs(z).max() < 3.5
    assert 0.4 < np.sqrt(np.mean(z**2)) < 1.7
    assert found.noise.encoder_step == pytest.approx(STEP, rel=1e-6)
    assert found.noise.pixel_factor == pytest.approx(1, abs=4 * found.noise.pixel_factor_sigma)
    assert found.noise.slip == pytest.approx(3e-4, abs=3.5 * found.noise.slip_sigma)
    off = found.drives[0].T_box_body[:, :2, 3] - drive.stop_poses[:, :2]
    poses = off / np.sqrt(found.drives[0].pose_cov[:, [0, 1], [0, 1]])
    assert np.sqrt(np.mean(poses**2)) < 2.5


def test_start_may_be_left_out_or_shared() -> None:
    data, _, _ = noisy(khepera(), 3)
    with_start, without = estimate([data], solve_four_steps(data)), estimate([data])
    assert with_start.rR == pytest.approx(without.rR, abs=0.01 * without.sigma["rR"])


def test_understated_corner_covariance_is_made_up_by_the_pixel_factor() -> None:
    data, truth, _ = noisy(khepera(), 4)
    claimed = replace(data, stops=tuple(replace(s, cov_px2=s.cov_px2 / 9) for s in data.stops))
    honest, found = estimate([data]), estimate([claimed])
    assert found.noise.pixel_factor == pytest.approx(3 * honest.noise.pixel_factor, rel=1e-3)
    assert found.sigma["fu"] == pytest.approx(honest.sigma["fu"], rel=1e-2)
    assert np.abs(normalised(found, truth)).max() < 3.5


def test_two_drives_of_one_robot_know_more_than_either() -> None:
    robot = khepera()
    first, _, drive_1 = noisy(robot, 5, stops=8)
    second, _, drive_2 = noisy(robot, 6, stops=8)
    both = estimate([first, second])
    alone = estimate([first])
    truth = truth_of(robot, (drive_1, drive_2), 3e-4)
    assert np.abs(normalised(both, truth)).max() < 3.5
    assert all(both.sigma[name] < 0.95 * alone.sigma[name] for name in ("fu", "rR", "b", "rz", "tx"))
    assert [len(d.stops) for d in both.drives] == [8, 8]
    assert np.all(np.sqrt(np.diag(cramer_rao([first, second], truth))) < 1.4 * np.sqrt(np.diag(both.cov)))


def test_floor_tilt_is_found_and_does_not_spoil_the_mounting() -> None:
    robot, tilt = khepera(), np.radians([0.6, -0.4, 0.0])
    rng = np.random.default_rng(7)
    options = DriveOptions(stops=12, slip=3e-4, encoder_step=STEP, steps_per_sample=2)
    drive = simulate_drive(robot, TARGET, options, rng)
    tilted = replace(drive, T_box_cam=rigid(exp_so3(tilt), np.zeros(3)) @ drive.T_box_cam)
    data = exact_correspondences(robot, TARGET, tilted, 0.2, rng)
    found = estimate([data])
    assert np.abs((found.drives[0].tilt - tilt[:2]) / found.drives[0].tilt_sigma).max() < 3.5
    assert np.abs(normalised(found, truth_of(robot, (drive,), 3e-4))).max() < 3.5
    without = estimate([data], None, EstimateOptions(tilt_sigma=0.0, rigid_floor=True))
    assert without.noise.pixel_factor > 1.2  # the model without tilt does not fit
    assert "tilt_x" not in without.names


def test_reported_covariance_has_the_documented_order_and_is_positive() -> None:
    found = estimate([noisy(khepera(), 8)[0]])
    assert tuple(found.sigma) == ORDER == found.names[:14]
    assert found.cov.shape == (14, 14)
    assert np.all(np.linalg.eigvalsh(found.correlation) > 0)
    assert np.allclose(np.diag(found.correlation), 1)
    assert found.correlation[5, 6] > 0.5  # both radii scale with the size of all distances


def test_covariance_of_fixed_levels_is_the_bound_at_the_solution() -> None:
    data, truth, _ = noisy(khepera(), 9)
    options = EstimateOptions(slip=3e-4, noise_scale=1.0, encoder_step=STEP, rigid_floor=True, systematic_share=0.0)
    found = estimate([data], None, options)
    ratio = np.sqrt(np.diag(found.cov) / np.diag(cramer_rao([data], truth, options)))
    np.testing.assert_allclose(ratio, 1, atol=0.05)
    assert found.noise.slip_sigma == 0
    assert found.noise.pixel_factor_sigma == 0


def test_ground_uncertainty_follows_from_the_wheels_covariance() -> None:
    found = estimate([noisy(khepera(), 10)[0]])
    ground = ground_uncertainty(found, (640, 480), 0.5)
    J = np.array([10 / found.rR, -10 / found.rL, 0.0]) / found.b
    assert ground.straight.heading == pytest.approx(np.sqrt(J @ found.cov[5:8, 5:8] @ J), rel=0.01)
    assert ground.straight.across == pytest.approx(5 * ground.straight.heading, rel=0.05)
    assert ground.straight.heading_slip == pytest.approx(found.noise.slip * np.sqrt(20) / found.b, rel=0.05)
    K = 2 * np.pi * np.array([0.5 / found.rR, 0.5 / found.rL, -1 / found.b])
    assert ground.turn.heading == pytest.approx(np.sqrt(K @ found.cov[5:8, 5:8] @ K), rel=0.01)
    assert 0 < ground.projection.mean_px <= ground.projection.worst_px


def test_held_out_stops_are_predicted_within_their_sigmas() -> None:
    result = validate([noisy(khepera(), 11, stops=10)[0]])
    assert len(result.stops) == 9
    assert 0.5 < result.normalised < 1.6
    assert result.position_rms < 0.02
    assert all(0.2 < s.corner_rms_px < 0.4 for s in result.stops)


def test_too_few_stops_and_absurd_options_are_refused_with_what_to_do() -> None:
    data, _, _ = noisy(khepera(), 12, stops=3)
    short = replace(data, stops=data.stops[:2])
    with pytest.raises(CalibError, match="2 usable stops, at least 3"):
        estimate([short])
    with pytest.raises(CalibError, match="at least one"):
        estimate([])
    with pytest.raises(CalibError, match="one for each, or one for all"):
        estimate([data], [solve_four_steps(data)] * 2)
    with pytest.raises(CalibError, match="false_alarm is 0"):
        EstimateOptions(false_alarm=0)
    with pytest.raises(CalibError, match="tilt_sigma is -1"):
        EstimateOptions(tilt_sigma=-1)
