from typing import Any

import numpy as np

from boxcal.calib.four_steps.backend import backend, loops, reference
from boxcal.calib.four_steps.compiled import damped_step, reprojection_sums
from boxcal.calib.four_steps.compiled.compilation import compile_all
from boxcal.calib.four_steps.procedure import solve_four_steps
from boxcal.calib.geometry.so3_se3 import exp_se3
from boxcal.calib.simulate.drive import DriveOptions, exact_correspondences, simulate_drive
from boxcal.calib.simulate.robot import khepera
from boxcal.target.box import make_target

COMPILED, REFERENCE = loops(), reference()


def views(rng):
    """Three views of landmarks at random, the last of one landmark."""
    starts = np.array([0, 20, 29, 30])
    poses = exp_se3(np.concatenate([rng.normal(0, 0.2, (3, 3)), rng.normal((0, 0, 0.6), 0.05, (3, 3))], axis=1))
    values = np.array([500.0, 510.0, 320.0, 240.0, -0.2])
    return [values, poses, rng.normal(0, 0.1, (30, 3)), rng.uniform(0, 480, (30, 2)), starts]


def test_plain_install_runs_compiled_sums():
    assert backend() == COMPILED != REFERENCE


def test_compiled_sums_are_the_reference():
    given = views(np.random.default_rng(1))
    ours, expected = COMPILED.reprojection_sums(*given), REFERENCE.reprojection_sums(*given)
    assert np.all(np.isfinite(expected))
    for mine, theirs in zip(ours, expected, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-11, atol=1e-12 * np.abs(theirs).max())


def test_compiled_step_is_the_reference():
    """With a small step, and with one so large that no series holds."""
    given = views(np.random.default_rng(4))
    sums, poses = REFERENCE.reprojection_sums(*given)[:2], given[1][:2]
    for lam, size in ((0.0, 1.0), (1e-3, 1.0), (10.0, 1e-7)):
        scaled = sums.copy()
        scaled[:, :11, 11] *= size
        steps = [compute.damped_step(scaled, lam, poses) for compute in (COMPILED, REFERENCE)]
        for mine, theirs in zip(*steps, strict=True):
            np.testing.assert_allclose(mine, theirs, rtol=1e-8, atol=1e-11 * np.abs(theirs).max())


def test_a_landmark_behind_the_camera_costs_without_bound():
    given = views(np.random.default_rng(2))
    given[1][1, 2, 3] = -0.6
    for compute in (COMPILED, REFERENCE):
        np.testing.assert_array_equal(np.isinf(compute.reprojection_sums(*given)[:, 11, 11]), [False, True, False])


def test_derivatives_are_what_errors_change_by():
    """By the camera's values, and by a motion of the camera from the left."""
    given = views(np.random.default_rng(3))
    step = 1e-6

    def squares(k, sign):
        values, poses, *rest = given
        change = sign * step * np.eye(11)[k]
        moved = exp_se3(change[5:]) @ poses
        return REFERENCE.reprojection_sums(values + change[:5], moved, *rest)[:, 11, 11]

    slopes = np.array([(squares(k, -1) - squares(k, 1)) / (4 * step) for k in range(11)])
    at = REFERENCE.reprojection_sums(*given)[:, :11, 11].T
    np.testing.assert_allclose(slopes, at, rtol=1e-5, atol=1e-6 * np.abs(at).max())


def test_nothing_is_compiled_in_use_beyond_what_is_prepared():
    compile_all()
    drive = simulate_drive(khepera(), make_target(), DriveOptions(stops=8, slip=3e-4), np.random.default_rng(1))
    solve_four_steps(exact_correspondences(khepera(), make_target(), drive, 0.2, np.random.default_rng(2)))
    kernels: tuple[Any, ...] = (reprojection_sums.fill_sums, damped_step.fill_step)
    assert [len(k.signatures) for k in kernels] == [1, 1]
