"""What the likelihood assumes of noise, against sampled noise; where it starts; what it says about a faulty leg."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from boxcal.calib.four_steps.procedure import solve_four_steps
from boxcal.calib.geometry.diff_drive import Legs
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.estimator import estimate, fit
from boxcal.calib.likelihood.initial_guess import camera_start, first_states
from boxcal.calib.likelihood.leg_model import leg_model
from boxcal.calib.likelihood.leg_residuals import leg_covariance
from boxcal.calib.likelihood.problem import build_problem
from boxcal.calib.likelihood.slip_profile import _SPREAD, _SPREAD_WEIGHT
from boxcal.calib.likelihood.wheel_path import wheel_path
from boxcal.calib.results.build import closed_form, refined
from boxcal.calib.results.calibration import Provenance
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, exact_options, simulate_drive
from boxcal.calib.simulate.robot import khepera
from boxcal.detect.correspondences import Correspondences, StopObservation
from boxcal.detect.log.wheel_samples import WheelSamples
from boxcal.target.arrays import Array
from boxcal.target.box import make_target

TARGET = make_target()
NOWHERE = Provenance(version="0", command="", created="")
STEP = radians(0.1302)
WHEELS = np.array([0.0215, 0.0207, 0.0893])


def leg_of(dphi: Array) -> Legs:
    return Legs(dphi_R=dphi[:, 0], dphi_L=dphi[:, 1], ends=(0, len(dphi)))


def displacements(dphi: Array) -> Array:
    """Where a leg of these wheel angles ends, (3,): x, y, heading; composed arc by arc."""
    x = y = th = 0.0
    for dR, dL in dphi:
        ds, dth = (WHEELS[0] * dR + WHEELS[1] * dL) / 2, (WHEELS[0] * dR - WHEELS[1] * dL) / WHEELS[2]
        chord = ds * np.sinc(dth / 2 / np.pi)
        x, y, th = x + chord * np.cos(th + dth / 2), y + chord * np.sin(th + dth / 2), th + dth
    return np.array([x, y, th])


def curvy(samples: int) -> Array:
    """Wheel angles of a leg that turns left, drives on and turns right, (S, 2) rad."""
    turn = np.concatenate([np.full(samples // 3, 0.9), np.full(samples // 3, 0.1), np.full(samples // 3, -0.6)])
    return np.stack([0.5 + turn, 0.5 - turn + 0.05 * np.sin(np.arange(len(turn)))], axis=1)


def unlike_identity(samples: Array, cov: Array) -> float:
    """The largest entry by which the covariance of samples, whitened by a predicted one, differs from the identity."""
    root = np.linalg.cholesky(cov)
    return float(np.abs(np.cov(np.linalg.solve(root, samples.T)) - np.eye(len(cov))).max())


def test_quantisation_on_the_way_has_the_covariance_of_sampled_readings() -> None:
    """Readings between the ends err uniformly within a step of 3 deg: what that does to where the leg ends.

    2000 draws know each entry of a whitened covariance to sqrt(2/2000); five of these are allowed.
    """
    dphi, step, draws = curvy(15), radians(3.0), 2000
    rng = np.random.default_rng(1)
    sampled = []
    for _ in range(draws):
        error = np.concatenate(
            [np.zeros((1, 2)), rng.uniform(-step / 2, step / 2, (len(dphi) - 1, 2)), np.zeros((1, 2))]
        )
        sampled.append(displacements(dphi + np.diff(error, axis=0)) - displacements(dphi))
    none = np.zeros((1, 2))
    predicted = step**2 * leg_model(wheel_path([leg_of(dphi)]), WHEELS, none, none).quantisation[0]
    plane = np.array(sampled)[:, :2]  # the heading at the end is that of the readings at the ends
    assert unlike_identity(plane, predicted[:2, :2]) < 5 * np.sqrt(2 / draws)
    np.testing.assert_allclose(predicted[2], 0, atol=1e-15)


def test_legs_covariance_holds_slip_and_quantisation() -> None:
    """Slip is drawn for each sample, with a variance in proportion to the distance that the wheel rolled."""
    data = exact_correspondences(
        khepera(), TARGET, simulate_drive(khepera(), TARGET, exact_options(4), np.random.default_rng(3))
    )
    problem = build_problem([data], [(0, 1, 2, 3)], EstimateOptions(), radians(3.0))
    dphi, draws, slip = curvy(15), 2000, 0.0005
    none, rng, sampled = np.zeros((1, 2)), np.random.default_rng(2), []
    for _ in range(draws):
        slipped = slip * np.sqrt(np.abs(dphi) * WHEELS[:2]) * rng.normal(size=dphi.shape) / WHEELS[:2]
        reading = np.concatenate([none, rng.uniform(-0.5, 0.5, (len(dphi) - 1, 2)) * problem.step, none])
        sampled.append(displacements(dphi + slipped + np.diff(reading, axis=0)) - displacements(dphi))
    model = leg_model(wheel_path([leg_of(dphi)]), WHEELS, none, none)
    predicted = leg_covariance(problem, model, np.array(slip))[0]
    assert unlike_identity(np.array(sampled), predicted) < 5 * np.sqrt(2 / draws)
    without = slip**2 * model.slip[0]
    assert unlike_identity(np.array(sampled), without) > 5 * np.sqrt(2 / draws)  # so that a missing part is seen


def only(stop: StopObservation, rows: Array) -> StopObservation:
    """The stop with some of its corners."""
    names = ("landmark_ids", "p_box", "faces", "uv_px", "cov_px2")
    return replace(stop, **{name: getattr(stop, name)[rows] for name in names})


def small_drive(seed: int, stops: int, corners: int, sigma_px: float) -> Correspondences:
    """A drive whose stops show only some of the corners, so that the solution takes many of the degrees of freedom."""
    rng = np.random.default_rng([seed, stops])
    options = DriveOptions(stops=stops, slip=3e-4, encoder_step=STEP, steps_per_sample=2)
    data = exact_correspondences(khepera(), TARGET, simulate_drive(khepera(), TARGET, options, rng), sigma_px, rng)
    some = []
    for stop in data.stops:
        tags = rng.permutation(np.unique(stop.landmark_ids // 4))[: corners // 4]
        rows = np.isin(stop.landmark_ids // 4, tags)
        some.append(only(stop, rows))
    return replace(data, stops=tuple(some))


def test_noise_scale_is_unbiased_where_few_corners_are_left_over() -> None:
    """Restricted likelihood: 6 stops of 12 corners leave 144 numbers, of which camera and poses take about 40.

    The mean of the squared noise scale over 25 drives is 1 within four of its standard errors, sqrt(2 / 100 / 25);
    uncorrected it would be 100/144.
    """
    runs = 25
    squares = [estimate([small_drive(seed, 6, 12, 0.2)]).noise.pixel_factor ** 2 for seed in range(runs)]
    assert np.mean(squares) == pytest.approx(1, abs=4 * np.sqrt(2 / 100 / runs))


def test_covariance_over_levels_of_slip_is_that_of_their_mixture() -> None:
    """Mean and covariance of a mixture of normal distributions, from its raw moments (law of total covariance)."""
    rng = np.random.default_rng(5)
    options = DriveOptions(stops=4, slip=5e-3, encoder_step=STEP, steps_per_sample=2)
    data = exact_correspondences(khepera(), TARGET, simulate_drive(khepera(), TARGET, options, rng), 0.2, rng)
    profile = fit([data]).profile
    s, w = profile.solution, profile.weight
    unit = np.sqrt(np.diag(s.cov[int(np.argmax(w))]))
    # The solutions at different levels differ little here; taken a sigma apart, what they differ by shows.
    apart = replace(s, d_shared=s.d_shared + np.linspace(-1, 1, len(w))[:, None] * unit)
    mean, *_, cov = replace(profile, solution=apart).averaged()
    second = sum(p * (C + np.outer(m, m)) for p, C, m in zip(w, apart.cov, apart.d_shared, strict=True))
    scale = np.outer(unit, unit)
    np.testing.assert_allclose(mean / unit, np.sum(w[:, None] * apart.d_shared, axis=0) / unit, atol=1e-9)
    np.testing.assert_allclose(cov / scale, (second - np.outer(mean, mean)) / scale, atol=1e-9)
    assert w.sum() == pytest.approx(1, abs=1e-12)


def test_little_slip_is_known_to_the_factor_that_is_stated() -> None:
    """Probabilities of levels sum to 1; the middle is likeliest; their spread is a factor of 1.65."""
    assert _SPREAD_WEIGHT.sum() == pytest.approx(1, abs=1e-12)
    assert np.argmax(_SPREAD_WEIGHT) == len(_SPREAD) // 2
    assert pytest.approx(0, abs=1e-12) == _SPREAD_WEIGHT @ _SPREAD
    assert np.sqrt(_SPREAD_WEIGHT @ _SPREAD**2) == pytest.approx(np.log(1.65), abs=0.06)  # cut off at a factor of e


def test_the_start_stands_where_an_exact_drive_stood() -> None:
    """Camera and wheels of the start come from closed forms; the stops must follow from them, headings included."""
    robot = khepera()
    drive = simulate_drive(robot, TARGET, exact_options(8), np.random.default_rng(4))
    data = exact_correspondences(robot, TARGET, drive)
    cameras = camera_start([data], None)
    problem = build_problem([data], cameras.kept, EstimateOptions(), 0.0)
    state = first_states(problem, [data], cameras)[0]
    np.testing.assert_allclose(state.wheels, [robot.rR, robot.rL, robot.b], rtol=1e-6)
    np.testing.assert_allclose(state.T_body_cam, robot.T_body_cam, atol=1e-6)
    np.testing.assert_allclose(state.poses[:, :2], drive.stop_poses[:, :2], atol=1e-6)
    turned = state.poses[:, 2] - drive.stop_poses[:, 2]
    np.testing.assert_allclose(np.exp(1j * turned), 1, atol=1e-6)
    yaw = np.arctan2(robot.T_body_cam[1, 2], robot.T_body_cam[0, 2])
    assert abs(yaw) > 0.01  # a camera that looks straight ahead would hide the mounting's sign


def with_pushed_left_wheel(data: Correspondences, leg: int, angle: float) -> Correspondences:
    """The drive with an angle added to the left wheel from the middle of a leg on."""
    at = (data.stops[leg].last_sample + data.stops[leg + 1].first_sample) // 2
    phi_L = data.wheels.phi_L.copy()
    phi_L[at:] += angle
    stops = tuple(replace(s, phi_L=float(phi_L[s.first_sample])) for s in data.stops)
    return replace(data, wheels=WheelSamples(t_ns=data.wheels.t_ns, phi_R=data.wheels.phi_R, phi_L=phi_L), stops=stops)


def test_a_faulty_leg_lasts_from_one_stop_s_end_to_the_next_one_s_start() -> None:
    options = DriveOptions(stops=9, slip=3e-4, encoder_step=STEP, steps_per_sample=2, stand_s=(2.0, 3.0))
    rng = np.random.default_rng(6)
    data = exact_correspondences(khepera(), TARGET, simulate_drive(khepera(), TARGET, options, rng), 0.2, rng)
    (leg,) = estimate([with_pushed_left_wheel(data, 4, round(1.5 / STEP) * STEP)]).flagged_legs
    assert (leg.leg, leg.next_stop) == (4, 5)
    assert leg.t_start_ns == data.stops[4].t_end_ns > data.stops[4].t_start_ns
    assert leg.t_end_ns == data.stops[5].t_start_ns < data.stops[5].t_end_ns
    start = data.wheels.t_ns[0]
    assert f"({(leg.t_start_ns - start) / 1e9:.1f} to {(leg.t_end_ns - start) / 1e9:.1f} s)" in leg.text


@pytest.mark.parametrize("method", ["closed form", "likelihood"])
def test_reprojection_rms_is_that_of_all_corners_together(method: str) -> None:
    """Computed anew from the correspondences, where the stops show very different numbers of corners."""
    options = DriveOptions(stops=7, slip=3e-4, encoder_step=STEP, steps_per_sample=2)
    rng = np.random.default_rng(7)
    data = exact_correspondences(khepera(), TARGET, simulate_drive(khepera(), TARGET, options, rng), 0.3, rng)
    some = []
    for j, s in enumerate(data.stops):
        rows = np.arange(len(s.landmark_ids)) < (16 if j % 2 else 200)
        noise = (3.0 if j == 1 else 0.0) * rng.normal(size=s.uv_px.shape)  # one stop of few corners is much worse
        cov = s.cov_px2 * (100 if j == 1 else 1)
        some.append(only(replace(s, uv_px=s.uv_px + noise, cov_px2=cov), rows))
    data = replace(data, stops=tuple(some))
    steps = solve_four_steps(data)
    found = estimate([data], steps, EstimateOptions(find_faults=False))
    result = (
        closed_form("r", [data], [steps], NOWHERE)
        if method == "closed form"
        else refined("r", [data], [steps], found, NOWHERE)
    )
    squares = []
    for stop, seen in zip(result.stops, data.stops, strict=True):
        p_cam = (seen.p_box - stop.T_box_cam[:3, 3]) @ stop.T_box_cam[:3, :3]
        xy, k = p_cam[:, :2] / p_cam[:, 2:], result.camera
        bent = xy * (1 + k.kr * np.sum(xy**2, axis=1, keepdims=True))
        uv = bent * (k.fu, k.fv) + (k.cu, k.cv)
        square = np.sum((uv - seen.uv_px) ** 2, axis=1)
        assert stop.reprojection_rms_px == pytest.approx(np.sqrt(np.mean(square)), rel=1e-9)
        squares.append(square)
    rms = float(np.sqrt(np.mean(np.concatenate(squares))))
    assert result.quality.reprojection_rms_px == pytest.approx(rms, rel=1e-9)
    assert rms > 1.1 * np.mean([stop.reprojection_rms_px for stop in result.stops][::2])
