"""Where the four steps fail, the likelihood is started otherwise, and a refusal says what was tried."""

import time
from dataclasses import replace
from math import radians

import numpy as np
import pytest

from boxcal.calib.calibrate import calibrate
from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.procedure import solve_four_steps
from boxcal.calib.four_steps.step1_camera import calibrate_camera
from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.estimator import estimate
from boxcal.calib.likelihood.robust_steps import robust_steps
from boxcal.calib.results.verdict import Level
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import khepera
from boxcal.target.box import make_target

TARGET = make_target()
OF_A_PICTURE = ("landmark_ids", "uv_px", "p_box", "faces", "cov_px2")


def seen(seed, stops, slip):
    rng = np.random.default_rng(seed)
    options = DriveOptions(stops=stops, slip=slip, encoder_step=radians(0.13), steps_per_sample=4)
    return exact_correspondences(khepera(), TARGET, simulate_drive(khepera(), TARGET, options, rng), 0.2, rng)


def shuffled(drive, seed):
    """Pictures and wheels of different drives, as it were."""
    order = np.random.default_rng(seed).permutation(len(drive.stops))
    stops = [
        replace(stop, **{field: getattr(drive.stops[k], field) for field in OF_A_PICTURE})
        for stop, k in zip(drive.stops, order, strict=True)
    ]
    return replace(drive, stops=tuple(stops))


def test_a_drive_of_strong_slip_that_the_four_steps_refuse_is_calibrated_with_large_sigmas():
    drive = seen(8, 16, 0.012)
    with pytest.raises(CalibError, match="swapped"):
        solve_four_steps(drive)
    found = calibrate(drive, TARGET)
    robot = khepera()
    sigma = np.sqrt(np.diag(found.detail.covariance.matrix))[5:8]
    error = np.array([found.wheels.rR - robot.rR, found.wheels.rL - robot.rL, found.wheels.b - robot.b])
    assert np.all(np.abs(error) < 3.5 * sigma)
    noise = found.detail.noise
    assert abs(noise.slip - 0.012) < 3 * noise.slip_sigma
    assert noise.slip_sigma < 0.005
    assert found.verdict.level is not Level.GOOD
    assert any("started from consecutive stops" in note and "fit no wheels" in note for note in found.notes)


def test_consecutive_stops_alone_give_the_four_steps_figures():
    drive = seen(1, 12, 2e-4)
    steps = solve_four_steps(drive)
    robust = robust_steps(drive, calibrate_camera(drive.stops, drive.image_size), "for once")
    assert robust.mounting.b == pytest.approx(steps.mounting.b, rel=0.02)
    np.testing.assert_allclose(robust.T_body_cam, steps.T_body_cam, atol=0.01)
    assert robust.heading.rms < radians(1.0)
    assert robust.mounting.rms < 0.01
    assert "for once" in robust.notes[-1]
    assert np.isfinite(estimate([drive], robust, EstimateOptions(target=TARGET)).cov).all()


@pytest.mark.parametrize("seed", [1, 4, 8])
def test_pictures_of_another_drive_are_refused_or_redo_in_bounded_time_and_what_was_tried_is_said(seed):
    begun = time.process_time()
    try:
        found = calibrate(shuffled(seen(seed, 11, 3e-4), seed), TARGET)
    except CalibError as refused:
        said = str(refused)
    else:
        assert found.verdict.level is Level.REDO
        said = next(note for note in found.notes if "started from" in note)
    assert "consecutive stops" in said
    assert "\n" not in said
    assert time.process_time() - begun < 20.0
