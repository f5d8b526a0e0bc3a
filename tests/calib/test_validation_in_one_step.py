"""Stops that are held out are predicted after one round from the estimate of all stops, as if solved anew."""

from dataclasses import replace

import numpy as np
import pytest

from boxcal.calib.likelihood import EstimateOptions
from boxcal.calib.likelihood.estimator import estimate, fit_cameras, step_of
from boxcal.calib.likelihood.initial_guess import camera_start
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import khepera
from boxcal.calib.uncertainty.cross_validation import _predict, validate
from boxcal.target.box import make_target


def test_a_stop_held_out_is_predicted_as_by_a_solution_of_its_own():
    rng = np.random.default_rng(12)
    target = make_target()
    drive = simulate_drive(khepera(), target, DriveOptions(stops=9, slip=5e-4), rng)
    seen = exact_correspondences(khepera(), target, drive, 0.1, rng)
    first = seen.stops[2]
    off = first.uv_px.copy()
    off[0] += 5.0  # left out by the estimate, and so by the solutions from its parts
    stops = (*seen.stops[:2], replace(first, uv_px=off), *seen.stops[3:])
    drives, options = [replace(seen, stops=stops)], EstimateOptions(target=target)
    found = estimate(drives, None, options)
    assert len(found.flagged_corners) == 1
    held_out = {s.stop: s for s in validate(drives, None, options, found).stops}
    assert sorted(held_out) == list(range(1, 9))
    cameras = camera_start(drives, None)
    for stop in (4, 7):
        kept = (tuple(k for k in range(9) if k != stop),)
        anew = _predict(
            fit_cameras(drives, cameras.only(kept), options, step_of(drives, options)), drives, 0, stop - 1, stop
        )
        np.testing.assert_allclose(held_out[stop].error, anew.error, atol=0.05 * anew.sigma.min())
        np.testing.assert_allclose(held_out[stop].sigma, anew.sigma, rtol=0.08)
        assert held_out[stop].chi_square == pytest.approx(anew.chi_square, rel=0.15, abs=0.05)
