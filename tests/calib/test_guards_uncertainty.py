"""What the reported covariances mean, against samples drawn from them and against many seeded drives."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest
from scipy import stats

from boxcal.calib.four_steps.procedure import solve_four_steps
from boxcal.calib.geometry.parameters import MOUNTING, ORDER
from boxcal.calib.geometry.so3_se3 import exp_se3, exp_so3, log_so3
from boxcal.calib.likelihood import Estimate, EstimateOptions
from boxcal.calib.likelihood.estimator import estimate, fit, fit_cameras
from boxcal.calib.likelihood.initial_guess import camera_start
from boxcal.calib.likelihood.summary import reported_cov
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import khepera
from boxcal.calib.uncertainty.convergence import grow
from boxcal.calib.uncertainty.cramer_rao import Truth, errors
from boxcal.calib.uncertainty.cross_validation import HeldOut, _predict
from boxcal.calib.uncertainty.propagation import ground_uncertainty
from boxcal.detect.correspondences import Correspondences
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from boxcal.target.camera.camera_model import CameraModel, project, unproject
from boxcal.target.camera.distortion import CameraKind

TARGET = make_target()
SIZE = (640, 480)


def drive(seed: int, stops: int, step_deg: float = 0.1302, slip: float = 3e-4) -> tuple[Correspondences, Truth]:
    """A drive of the Khepera, and its truth."""
    robot, rng = khepera(), np.random.default_rng([seed, stops])
    options = DriveOptions(
        stops=stops, slip=slip, encoder_step=radians(step_deg), joint_period_s=0.08, steps_per_sample=2
    )
    driven = simulate_drive(robot, TARGET, options, rng)
    truth = Truth.of(robot, driven.stop_poses, slip=slip, encoder_step=radians(step_deg))
    return exact_correspondences(robot, TARGET, driven, 0.2, rng), truth


@pytest.fixture(scope="module")
def found() -> Estimate:
    """An estimate from few stops, whose parameters are strongly correlated."""
    return estimate([drive(31, 5)[0]])


@pytest.mark.parametrize("stops", [4, 8])
def test_smooth_errors_of_corners_are_considered_as_they_move_the_answer(stops: int) -> None:
    """The poses of stops take up nearly all of them: what is left is small, and wrong if that is not exact."""
    share, (data, _) = 0.08, drive(5, stops)
    options = EstimateOptions(slip=3e-4, noise_scale=1.0, rigid_floor=True, find_faults=False, systematic_share=0.0)
    base, considered = fit([data], None, options), fit([data], None, replace(options, systematic_share=share))
    uv_px = np.concatenate([stop.uv_px for stop in data.stops])
    x, y = ((uv_px - uv_px.mean(axis=0)) / np.abs(uv_px - uv_px.mean(axis=0)).max()).T
    found = np.zeros(14)
    for axis, field in ((0, x), (0, x**3), (0, x * y**2), (1, y), (1, y**3), (1, x**2 * y)):
        shift = np.zeros_like(uv_px)
        shift[:, axis] = share * base.problem.sigma_px * field / np.sqrt(np.mean(field**2))
        ends = np.cumsum([len(stop.uv_px) for stop in data.stops])[:-1]
        parts = np.split(shift, ends)
        stops_now = tuple(replace(s, uv_px=s.uv_px + d) for s, d in zip(data.stops, parts, strict=True))
        moved = fit([replace(data, stops=stops_now)], None, options).state
        turned = log_so3(base.state.T_body_cam[:3, :3].T @ moved.T_body_cam[:3, :3])
        shifted = base.state.T_body_cam[:3, :3].T @ (moved.T_body_cam[:3, 3] - base.state.T_body_cam[:3, 3])
        lens, wheels = moved.lens[:5] - base.state.lens[:5], moved.wheels - base.state.wheels
        found += np.concatenate([lens, wheels, turned, shifted]) ** 2
    added = np.diag(considered.cov - base.cov)[:14]
    np.testing.assert_allclose(np.sqrt(added), np.sqrt(found), rtol=0.2)


def sampled_pixels(found: Estimate, uv_px: Array, distance: float, draws: int) -> Array:
    """Variances (u plus v) of where points that look at these pixels appear, from calibrations drawn from ``cov_all``.

    Written down from the documentation of ``Estimate`` alone: what is drawn is added to the camera, turns
    ``R_body_cam`` from the right, and is added to ``t_body_cam``; the points stand still in the body's frame.
    """
    camera, R, t = found.camera, found.T_body_cam[:3, :3], found.T_body_cam[:3, 3]
    rays = np.column_stack([unproject(camera, uv_px), np.ones(len(uv_px))])
    np.testing.assert_allclose(project(camera, rays), uv_px, atol=1e-6)
    p_body = distance * rays / np.linalg.norm(rays, axis=1)[:, None] @ R.T + t
    names = ("fu", "fv", "cu", "cv", *camera.names)
    columns = [found.names.index(name) for name in (*names, "rx", "ry", "rz", "tx", "ty", "tz")]
    cov = found.cov_all[np.ix_(columns, columns)]
    # Drawn a hundredth as large: projection is linear there, which the covariance of the projection assumes.
    changes = np.random.default_rng(1).multivariate_normal(np.zeros(len(cov)), cov * 1e-4, draws, method="cholesky")
    pixels = []
    for change in changes:
        lens, rotation, translation = np.split(change, [len(names), len(names) + 3])
        changed = CameraModel.from_values(camera.kind, camera.values + lens)
        pixels.append(project(changed, (p_body - t - translation) @ R @ exp_so3(rotation)))
    return np.asarray(np.sum(np.var(pixels, axis=0), axis=1) * 1e4)


@pytest.mark.parametrize("kind", [CameraKind.RADIAL, CameraKind.BROWN])
def test_projection_uncertainty_is_that_of_sampled_calibrations(kind: CameraKind) -> None:
    """4000 draws know a variance of two coordinates to 1/sqrt(2000) at worst; four of these are allowed."""
    found = estimate([drive(31, 5)[0]], None, EstimateOptions(lens=kind))
    tell = ground_uncertainty(found, SIZE, 0.7).projection
    u, v = np.meshgrid(np.linspace(0, 639, 16), np.linspace(0, 479, 12))
    grid = np.stack([u.ravel(), v.ravel()], axis=1)
    variance = sampled_pixels(found, grid, 0.7, 4000)
    assert tell.mean_px**2 == pytest.approx(np.mean(variance), rel=4 / np.sqrt(2000))
    at_worst = np.flatnonzero(np.all(np.isclose(grid, tell.worst_at_px), axis=1))
    assert tell.worst_px**2 == pytest.approx(float(variance[at_worst[0]]), rel=4 / np.sqrt(2000))


def test_reported_covariance_of_the_extrinsics_is_that_of_samples() -> None:
    """The solver's unknown xi moves the camera to ``T exp(xi)``: what that does to R and t is reported."""
    solved = fit([drive(32, 6)[0]])
    T = solved.state.T_body_cam
    cov = reported_cov(solved.cov, solved.state, np.zeros(len(solved.cov), dtype=np.bool_))
    draws = 20_000
    xi = np.random.default_rng(2).multivariate_normal(np.zeros(6), solved.cov[MOUNTING, MOUNTING], draws)
    T_new = np.array([T @ exp_se3(x) for x in xi])
    change = np.array([[*log_so3(T[:3, :3].T @ new[:3, :3]), *(new[:3, 3] - T[:3, 3])] for new in T_new])
    whiten = np.linalg.inv(np.linalg.cholesky(cov[MOUNTING, MOUNTING]))
    # Whitened samples have the identity for a covariance, each entry of it known to 1/sqrt(draws).
    np.testing.assert_allclose(np.cov((change @ whiten.T).T), np.eye(6), atol=6 / np.sqrt(draws))


def test_every_sigma_of_wheels_and_extrinsics_holds_over_seeded_drives() -> None:
    """40 drives of 6 stops: each parameter's mean squared normalised error, and that of all together.

    Chi-square at 1e-4 in all: a sigma that is wrong by a half for one parameter does not pass.
    """
    runs = 40
    errors_of, square = [], 0.0
    for seed in range(runs):
        data, truth = drive(seed, 6)
        one = estimate([data], None, EstimateOptions(systematic_share=0.0))  # corners' noise is white
        e = errors(one, truth)
        errors_of.append(e / np.sqrt(np.diag(one.cov)))
        square += float(e @ np.linalg.solve(one.cov, e))
    each = np.sum(np.square(errors_of), axis=0)
    low, high = stats.chi2.ppf([1e-4 / 28, 1 - 1e-4 / 28], runs)
    assert np.all((low < each) & (each < high)), dict(zip(ORDER, (each / runs).round(2), strict=True))
    low, high = stats.chi2.ppf([5e-5, 1 - 5e-5], 14 * runs)
    assert low < square < high


def held_out(seed: int, slip: float, stops: tuple[int, ...]) -> list[HeldOut]:
    """Stops of a drive of 10 with an encoder of 3 deg, predicted without them; the noise levels are known."""
    drives, step = [drive(seed, 10, 3.0, slip)[0]], radians(3.0)
    options = EstimateOptions(slip=slip, noise_scale=1.0, encoder_step=step, systematic_share=0.0)
    cameras = camera_start(drives, None)
    others = tuple(k for k in range(10) if k not in stops)
    fitted = fit_cameras(drives, cameras.only([others]), options, step)
    return [_predict(fitted, drives, 0, stop - 1, stop) for stop in stops]


@pytest.mark.parametrize(
    ("slip", "drives", "stops"),
    [(1e-5, 100, (5,)), (1e-3, 50, (5,))],
    ids=["readings dominate", "slip dominates"],
)
def test_held_out_stops_are_covered_by_their_predictions(slip: float, drives: int, stops: tuple[int, ...]) -> None:
    """150 stops predicted from calibrations made without them: chi-square at 1e-5.

    One stop a drive, since predictions of one drive share the errors of its calibration.
    Encoders are coarse, so that every part of the covariance counts: calibration, wheel readings, the pose before, what
    these share, slip and camera.
    """
    held = [stop for seed in range(drives) for stop in held_out(seed, slip, stops)]
    low, high = stats.chi2.ppf([5e-6, 1 - 5e-6], 3 * len(held))
    assert low < sum(s.chi_square for s in held) < high
    each = np.sum(np.square([s.error / s.sigma for s in held]), axis=0)
    low, high = stats.chi2.ppf([5e-6 / 3, 1 - 5e-6 / 3], len(held))
    assert np.all((low < each) & (each < high)), each / len(held)


def test_convergence_over_stops_shows_what_the_first_stops_alone_give() -> None:
    """Noise levels are those of all stops."""
    data, _ = drive(33, 8)
    steps, options = solve_four_steps(data), EstimateOptions()
    final = estimate([data], steps, options)
    points = grow(data, steps, final, options)
    assert [p.stops for p in points][-1] == 8
    noise = final.components
    known = replace(options, find_faults=False, slip=noise.slip, noise_scale=noise.noise_scale)
    for point in points[:-1]:
        alone = estimate([replace(data, stops=data.stops[: point.stops])], None, known)
        at = dict(zip(ORDER, point.values, strict=True))
        told = dict(zip(ORDER, point.sigma, strict=True))
        assert all(told[name] == pytest.approx(alone.sigma[name], rel=0.02) for name in ("fu", "b", "tx", "rz"))
        # What lean and print are taken to be differs a little: the levels of all stops, or of these.
        near = {name: 0.05 * sigma for name, sigma in zip(ORDER, point.sigma, strict=True)}
        assert at["fu"] == pytest.approx(alone.camera.fu, abs=near["fu"])
        assert at["b"] == pytest.approx(alone.b, abs=near["b"])
        assert at["tx"] == pytest.approx(alone.T_body_cam[0, 3], abs=near["tx"])
        turned = final.T_body_cam[:3, :3] @ exp_so3(np.array([at["rx"], at["ry"], at["rz"]]))
        off = log_so3(alone.T_body_cam[:3, :3].T @ turned)
        for name, value in zip(("rx", "ry", "rz"), off, strict=True):
            assert value == pytest.approx(0, abs=near[name]), name
    start = dict(zip(ORDER, points[0].values, strict=True))
    assert abs(start["rz"]) > 0.5 * points[-1].sigma[ORDER.index("rz")]  # so that a wrong sign would be seen
    assert points[-1].values[8:11] == pytest.approx((0, 0, 0), abs=1e-12)
