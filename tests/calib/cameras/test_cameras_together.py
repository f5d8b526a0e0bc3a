"""Several cameras of one robot solved together: what ties them, what the sigmas are, what keeps them apart."""

from dataclasses import replace

import numpy as np
import pytest

from boxcal.calib.diagnosis.catalogue import candidates
from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.camera_pair import between, pair_jacobian
from boxcal.calib.geometry.parameters import WHEELS
from boxcal.calib.geometry.so3_se3 import exp_so3, log_so3, rigid
from boxcal.calib.likelihood.cameras.equations import about
from boxcal.calib.likelihood.cameras.estimates import solve_cameras
from boxcal.calib.likelihood.cameras.maximise import maximised
from boxcal.calib.likelihood.cameras.row import one_row
from boxcal.calib.likelihood.cameras.solve import solved
from boxcal.calib.likelihood.cameras.start import beginning
from boxcal.calib.likelihood.cameras.state import stepped
from boxcal.calib.likelihood.estimator import reported
from boxcal.calib.likelihood.rounds import refit
from boxcal.calib.simulate.more_cameras import with_camera_at, with_images_of
from boxcal.calib.simulate.robot import turtlebot
from tests.calib.cameras.conftest import Rigged, rigged


def pair_error(rig: Rigged) -> tuple[np.ndarray, np.ndarray]:
    both = solve_cameras(rig.found, rig.fits, [[view] for view in rig.views])
    assert not both.apart
    a, b = (e.T_body_cam for e in both.estimates)
    true, is_ = between(*(r.T_body_cam for r in rig.robots)), between(a, b)
    J = pair_jacobian(a, b)
    error = np.concatenate([log_so3(true[:3, :3].T @ is_[:3, :3]), is_[:3, 3] - true[:3, 3]])
    return error, np.sqrt(np.diag(J @ both.mountings @ J.T))


def test_one_camera_solved_as_several_is_as_by_itself(stereo: Rigged) -> None:
    alone = stereo.found[0]
    both = solve_cameras([alone], [stereo.fits[0]], [[stereo.views[0]]])
    found = both.estimates[0]
    sigma = np.sqrt(np.diag(alone.cov))
    assert np.allclose(np.sqrt(np.diag(found.cov)), sigma, rtol=0.02)
    turned = log_so3(alone.T_body_cam[:3, :3].T @ found.T_body_cam[:3, :3])
    off = np.array([found.rR - alone.rR, found.b - alone.b, *turned, *(found.T_body_cam - alone.T_body_cam)[:3, 3]])
    assert np.all(np.abs(off) < 0.03 * sigma[[5, 7, 8, 9, 10, 11, 12, 13]])


def test_cameras_that_never_see_the_box_at_one_stop_are_tied_by_wheels_and_box(front_and_rear: Rigged) -> None:
    assert not set(front_and_rear.kept[0]) & set(front_and_rear.kept[1])
    error, sigma = pair_error(front_and_rear)
    assert np.all(np.abs(error) < 4 * sigma)
    assert np.all(sigma[:3] < np.radians(0.2))
    assert np.all(sigma[3:] < 2e-3)


def test_stereo_pair_is_known_far_better_than_either_camera_on_the_robot(stereo: Rigged) -> None:
    error, sigma = pair_error(stereo)
    assert np.all(np.abs(error) < 4 * sigma)
    assert np.all(sigma[3:5] < 0.2 * min(stereo.found[0].sigma["tx"], stereo.found[0].sigma["ty"]))


def test_wheels_of_both_cameras_are_surer_than_of_the_better_one(front_and_rear: Rigged) -> None:
    both = solve_cameras(front_and_rear.found, front_and_rear.fits, [[view] for view in front_and_rear.views])
    first, second = both.estimates
    assert (first.rR, first.rL, first.b) == (second.rR, second.rL, second.b)
    for name in ("rR", "rL", "b"):
        assert first.sigma[name] < min(found.sigma[name] for found in front_and_rear.found)
        assert abs(getattr(first, name) - getattr(front_and_rear.robots[0], name)) < 4 * first.sigma[name]


def test_gradient_of_all_cameras_is_the_derivative_of_the_residuals(front_and_rear: Rigged) -> None:
    start = beginning(front_and_rear.fits, [[view] for view in front_and_rear.views])
    n, P, q = len(start.robot.problem.names), len(start.robot.problem.drive), 3 + len(start.robot.parts)
    here = about(start.robot, start.state, start.levels.scales)
    rng = np.random.default_rng(1)
    unit = np.where([name[-2:] in {"fu", "fv", "cu", "cv"} for name in start.robot.problem.names], 10.0, 1.0)
    d = 1e-6 * rng.standard_normal(n) * unit, 1e-6 * rng.standard_normal((P, 5)), 1e-6 * rng.standard_normal((P, q))
    after, before = (
        about(start.robot, stepped(start.robot, start.state, *(sign * part for part in d)), start.levels.scales)
        for sign in (1, -1)
    )
    for c, own in enumerate(here.cameras):
        corners = own.corners
        group, stop = corners.group, corners.group_stop[corners.group]
        moved = (
            np.einsum("lmn,n->lm", corners.J_shared[group], d[0])
            + np.einsum("lmk,lk->lm", corners.J_pose[group], d[1][stop, :3])
            + np.einsum("lmq,lq->lm", corners.J_local[group], d[2][stop])
        )
        predicted = -np.einsum("lim,lm->li", corners.jacobian, moved)
        change = (after.cameras[c].corners.residual - before.cameras[c].corners.residual) / 2
        assert np.allclose(change, predicted, atol=1e-6 * np.abs(predicted).max())


def test_transform_of_a_pair_has_the_derivative_of_its_extrinsics() -> None:
    rng = np.random.default_rng(3)
    T_a, T_b = (rigid(exp_so3(rng.standard_normal(3)), rng.standard_normal(3)) for _ in range(2))
    J, step = pair_jacobian(T_a, T_b), 1e-6

    def moved(d: np.ndarray) -> np.ndarray:
        ends = [rigid(T[:3, :3] @ exp_so3(part[:3]), T[:3, 3] + part[3:]) for T, part in ((T_a, d[:6]), (T_b, d[6:]))]
        T, T_0 = between(*ends), between(T_a, T_b)
        return np.concatenate([log_so3(T_0[:3, :3].T @ T[:3, :3]), T[:3, 3] - T_0[:3, 3]])

    for k, d in enumerate(step * np.eye(12)):
        assert np.allclose((moved(d) - moved(-d)) / (2 * step), J[:, k], atol=1e-8)


def test_cameras_of_another_drive_are_found_to_disagree(front_and_rear: Rigged) -> None:
    wider = replace(front_and_rear.fits[1], at=_with_wheels(front_and_rear.fits[1], 1.01))
    both = solve_cameras(front_and_rear.found, [front_and_rear.fits[0], wider], [[v] for v in front_and_rear.views])
    assert "by itself gives another" in both.doubt
    assert not solve_cameras(front_and_rear.found, front_and_rear.fits, [[v] for v in front_and_rear.views]).doubt


def _with_wheels(fit, factor):
    return replace(fit.at, state=replace(fit.state, wheels=fit.state.wheels * factor))


def test_correspondences_of_other_recordings_are_refused(front_and_rear: Rigged) -> None:
    first, second = front_and_rear.views
    other = replace(second, wheels=replace(second.wheels, t_ns=second.wheels.t_ns + 1))
    with pytest.raises(CalibError, match="different wheel samples"):
        one_row([[first], [other]], [[range(len(first.stops))], [range(len(second.stops))]])


def test_stops_of_all_cameras_stand_in_one_row_in_time(front_and_rear: Rigged) -> None:
    row = one_row([[view] for view in front_and_rear.views], [[range(len(v.stops))] for v in front_and_rear.views])
    assert [tuple(places) for places in row.places] == list(front_and_rear.kept)
    assert len(row.drives[0].stops) == len(front_and_rear.drive.stop_poses)


def test_a_camera_of_four_times_the_pixels_is_solved_with_the_first() -> None:
    robot, right = turtlebot(), np.eye(4)
    right[0, 3] = 0.06
    larger = with_images_of(with_camera_at(robot, robot.T_body_cam @ right), (2560, 1920))
    both = rigged((robot, larger))
    assert max(stop.uv_px[:, 0].max() for stop in both.views[1].stops) > 2 * both.views[0].image_size[0]
    together = solve_cameras(both.found, both.fits, [[v] for v in both.views])
    assert not together.apart
    a, b = together.estimates
    J = pair_jacobian(a.T_body_cam, b.T_body_cam)
    sigma = np.sqrt(np.diag(J @ together.mountings @ J.T))[3:]
    error = between(a.T_body_cam, b.T_body_cam)[:3, 3] - right[:3, 3]
    assert np.all(np.abs(error) < 3 * sigma)
    assert np.all(sigma < 5e-4)


def test_cause_in_the_wheels_that_one_camera_shows_is_in_the_solution_of_all(front_and_rear: Rigged) -> None:
    cause = next(c for c in candidates(front_and_rear.fits[0]) if c.family == "backlash")
    fits = (refit(front_and_rear.fits[0], [cause]), front_and_rear.fits[1])
    found = [reported(f, [view], f.options) for f, view in zip(fits, front_and_rear.views, strict=True)]
    both = solve_cameras(found, fits, [[view] for view in front_and_rear.views])
    assert not both.apart
    first, second = both.estimates
    assert first.b == second.b
    for name in cause.names:
        value = first.values[first.names.index(name)]
        assert abs(value) < 4 * first.extra_sigma[name]  # there is none in this drive
        assert value == second.values[second.names.index(name)]
        assert first.extra_sigma[name] == second.extra_sigma[name]


def test_cause_in_the_pictures_keeps_cameras_apart_with_an_upper_bound(stereo: Rigged) -> None:
    cause = next(c for c in candidates(stereo.fits[0]) if c.family == "camera-knocked")
    fits = (refit(stereo.fits[0], [cause]), stereo.fits[1])
    drives = [[view] for view in stereo.views]
    alone, together = solve_cameras(stereo.found, fits, drives), solve_cameras(stereo.found, stereo.fits, drives)
    assert "something happened to a camera" in alone.apart
    assert [e.b for e in alone.estimates] == [found.b for found in stereo.found]
    J = pair_jacobian(*(e.T_body_cam for e in together.estimates))
    bound, sigma = (np.diag(J @ c.mountings @ J.T) for c in (alone, together))
    assert np.all(bound > sigma)


def test_smooth_errors_of_one_camera_are_considered_as_they_move_the_answer(front_and_rear: Rigged) -> None:
    share, start = 0.08, beginning(front_and_rear.fits, [[view] for view in front_and_rear.views])
    options = front_and_rear.fits[0].options
    with_them, without = (
        solved(start.robot, start.state, start.levels, start.legs, replace(options, systematic_share=s))
        for s in (share, 0.0)
    )
    considered = np.diag(with_them.cov - without.cov)[WHEELS]
    found = np.zeros(3)
    base = maximised(without.robot, without.found.state, without.levels, without.legs)
    for number, part in enumerate(without.robot.parts):
        size = share * without.levels.scales[number] * part.problem.sigma_px
        centred = part.problem.uv_px - part.problem.uv_px.mean(axis=0)
        x, y = (centred / np.abs(centred).max()).T
        for axis, field in ((0, x), (0, x**3), (0, x * y**2), (1, y), (1, y**3), (1, x**2 * y)):
            uv = part.problem.uv_px.copy()
            uv[:, axis] += size * field / np.sqrt(np.mean(field**2))
            parts = list(without.robot.parts)
            parts[number] = replace(part, problem=replace(part.problem, uv_px=uv))
            moved = maximised(replace(without.robot, parts=tuple(parts)), base.state, without.levels, without.legs)
            found += np.square(moved.state.body.wheels - base.state.body.wheels)
    assert np.allclose(np.sqrt(considered), np.sqrt(found), rtol=0.1)
