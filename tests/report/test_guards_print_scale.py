"""The print scale's sigma where few corners are left over, against its scatter over drawn noise."""

from dataclasses import replace

import numpy as np
import pytest

from boxcal.calib.assessment.print_scale import find_print_scale
from boxcal.calib.four_steps.procedure import solve_four_steps
from boxcal.calib.results.build import closed_form
from boxcal.calib.results.calibration import Provenance
from boxcal.calib.results.stop_residuals import stops_seen
from boxcal.calib.simulate.drive import exact_correspondences, exact_options, simulate_drive
from boxcal.calib.simulate.robot import khepera
from boxcal.target.box import make_target

TARGET = make_target()
SIGMA_PX = 0.001


def test_print_scale_counts_each_stop_s_pose_as_six_numbers_taken() -> None:
    """Of 16 corners a stop 32 numbers are seen and 6 taken by its pose: the noise is what is left over the 26.

    The variance of the scales over 1500 draws is known to sqrt(2 / 1500); four of these are allowed, where counting
    all 32 would be off by a fifth and more.
    """
    rng, draws = np.random.default_rng(1), 1500
    drive = simulate_drive(khepera(), TARGET, exact_options(6), rng)
    data = exact_correspondences(khepera(), TARGET, drive)
    steps = solve_four_steps(data)
    exact = closed_form("r", [data], [steps], Provenance(version="0", command="", created=""))
    seen = []
    for stop in stops_seen(exact, [data], TARGET):
        used = np.zeros(len(stop.used), dtype=np.bool_)
        used[rng.permutation(len(used))[:16]] = True
        cov = np.tile(np.eye(2) * SIGMA_PX**2, (len(used), 1, 1))
        seen.append(replace(stop, used=used, view=replace(stop.view, cov_px2=cov)))
    values, variances = [], []
    for _ in range(draws):
        noisy = [replace(s, error_px=SIGMA_PX * rng.normal(size=s.error_px.shape)) for s in seen]
        found = find_print_scale(exact, noisy, TARGET)
        assert found is not None
        values.append((found.x, found.y))
        variances.append((found.sigma_x**2, found.sigma_y**2))
    ratio = np.mean(variances, axis=0) / np.var(values, axis=0)
    assert ratio == pytest.approx([1, 1], abs=4 * np.sqrt(2 / draws))
