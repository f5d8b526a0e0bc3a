"""Errors of corners that their covariances leave out are a variance component of their own."""

from dataclasses import replace

import numpy as np
import pytest

from boxcal.calib.calibrate import calibrate
from boxcal.calib.check_drive.by_box import check_drive
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.corner_floor import corner_floor, with_floor
from boxcal.calib.likelihood.estimator import estimate, fit
from boxcal.calib.likelihood.fit import log_noise
from boxcal.calib.planning.drive_information import information_of, solved_by_calibration, solved_by_estimate
from boxcal.calib.results.json_format import calibration_bytes, load_calibration
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import khepera
from boxcal.target.box import make_target

TARGET = make_target()


def seen(rng, floor_px=0.0, wrong=0):
    """A drive whose corners are told to .004 to .04 px, as of large and small tags, and err by a floor besides."""
    drive = simulate_drive(khepera(), TARGET, DriveOptions(stops=10, slip=3e-4), rng)
    exact = exact_correspondences(khepera(), TARGET, drive, 1e-9, rng)
    stops = []
    for k, stop in enumerate(exact.stops):
        told = np.exp(rng.uniform(np.log(0.004), np.log(0.04), len(stop.uv_px)))
        off = rng.normal(size=stop.uv_px.shape) * np.hypot(told, floor_px)[:, None]
        if k == 0 and wrong:
            off[:wrong] += 1.0
        cov = told[:, None, None] ** 2 * np.eye(2)
        stops.append(replace(stop, uv_px=stop.uv_px + off, cov_px2=cov))
    return replace(exact, stops=tuple(stops))


@pytest.mark.parametrize(("floor_px", "wrong"), [(0.01, 0), (0.05, 0), (0.01, 20)])
def test_floor_is_found_beside_the_corners_own_sigmas_whatever_some_corners_show(floor_px, wrong):
    found = estimate([seen(np.random.default_rng(2), floor_px, wrong)], None, EstimateOptions(target=TARGET))
    assert found.components.corner_floor * found.components.noise_scale == pytest.approx(floor_px, rel=0.15)
    assert found.components.noise_scale == pytest.approx(1.0, abs=0.2)
    assert wrong <= len(found.flagged_corners) <= wrong + 2


def test_no_floor_is_found_where_there_is_none():
    found = estimate([seen(np.random.default_rng(3))], None, EstimateOptions(target=TARGET))
    assert found.components.corner_floor == 0.0
    assert found.noise.pixel_factor == pytest.approx(1.0, abs=0.04)


def test_corners_that_are_all_alike_have_a_scale_and_no_floor():
    rng = np.random.default_rng(4)
    drive = simulate_drive(khepera(), TARGET, DriveOptions(stops=8, slip=3e-4), rng)
    exact = exact_correspondences(khepera(), TARGET, drive, 0.2, rng)
    solution = fit([exact], None, EstimateOptions())
    assert corner_floor(solution.problem, solution.at) == 0.0


def test_a_floor_is_part_of_the_reported_noise():
    drive = seen(np.random.default_rng(5), 0.02)
    solution = fit([drive], None, EstimateOptions(target=TARGET))
    told = np.sqrt(np.mean(np.trace(solution.problem.stated_px2, axis1=1, axis2=2)) / 2)
    found = estimate([drive], None, EstimateOptions(target=TARGET))
    assert found.noise.pixel_px == pytest.approx(np.hypot(told, 0.02), rel=0.05)
    assert found.noise.pixel_factor == pytest.approx(np.hypot(told, 0.02) / told, rel=0.05)
    assert with_floor(solution.problem, 0.0).sigma_px < solution.problem.sigma_px


def test_errors_that_are_no_numbers_or_zero_show_no_floor():
    solution = fit([seen(np.random.default_rng(2), 0.02)], None, EstimateOptions(target=TARGET))
    assert corner_floor(solution.problem, solution.at) > 0
    for value in (0.0, np.nan):
        none = replace(solution.at.corners, residual=np.full_like(solution.at.residual_px, value))
        assert corner_floor(solution.problem, replace(solution.at, corners=none)) == 0.0


def test_log_noise_does_not_depend_on_how_many_px_corners_are_known_to():
    solution = fit([seen(np.random.default_rng(2), 0.02)], None, EstimateOptions(target=TARGET))
    problem = solution.problem
    coarse = with_floor(replace(problem, stated_px2=100 * problem.stated_px2), 10 * problem.floor_px)
    assert log_noise(replace(solution, problem=coarse)) == pytest.approx(log_noise(solution), rel=1e-9)
    told = replace(solution, problem=with_floor(problem, 0.0))
    scale = np.log(solution.components.noise_scale)
    assert log_noise(told) == pytest.approx(2 * np.count_nonzero(solution.weights.corners) * scale, rel=1e-9)


def test_a_floor_counts_wherever_a_calibration_is_used(tmp_path):
    drive = seen(np.random.default_rng(5), 0.03)
    found = calibrate(drive, TARGET)
    (tmp_path / "calibration.json").write_bytes(calibration_bytes(found))
    detail = load_calibration(tmp_path / "calibration.json").detail
    told = np.array([0.004, 0.04])[:, None, None] ** 2 * np.eye(2)
    sigma = np.sqrt(detail.corner_cov_px2(told)[:, 0, 0])
    np.testing.assert_allclose(sigma, np.hypot([0.004, 0.04], 0.03), rtol=0.1)
    options = EstimateOptions(target=TARGET, systematic_share=0.0)
    estimated = estimate([drive], None, options)
    for solved in (solved_by_estimate(estimated), solved_by_calibration(found, [drive])):
        known = information_of(solved, [drive], TARGET)
        cov = np.linalg.inv(known.chain)
        rows = [known.names.index(name) for name in ("fu", "cu", "rx")]
        expected = [estimated.sigma[name] for name in ("fu", "cu", "rx")]
        np.testing.assert_allclose(np.sqrt(np.diag(cov)[rows]), expected, rtol=0.05)


def test_a_check_drive_allows_for_the_floor():
    found = calibrate(seen(np.random.default_rng(5), 0.03), TARGET)
    legs = check_drive(found, seen(np.random.default_rng(6), 0.03))
    assert np.mean([leg.corner_rms for leg in legs]) == pytest.approx(1.0, abs=0.1)
