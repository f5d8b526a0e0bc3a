"""Simulated drives: exact kinematics, honest encoders and slip, stops that see the box, ways that keep off it."""

from dataclasses import replace
from math import cos, pi, radians, sin

import numpy as np
import pytest
from scipy.stats import chi2

from boxcal.calib.errors import CalibError
from boxcal.calib.geometry.so3_se3 import inverse, planar, rot_y
from boxcal.calib.simulate.drive import Drive, DriveOptions, exact_correspondences, exact_options, simulate_drive
from boxcal.calib.simulate.kinematics import Arc, arc_path, slipped, wheel_turns, within_arc
from boxcal.calib.simulate.robot import Robot, khepera, mount, paper, random_robot, turtlebot
from boxcal.calib.simulate.route import KeepOut
from boxcal.target.arrays import Array
from boxcal.target.box import Box, Target, make_target
from boxcal.target.camera.camera_model import project

TARGET = make_target()


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def robots() -> list[Robot]:
    return [paper(), khepera(), turtlebot(), *(random_robot(f"r{k}", rng(k)) for k in range(6))]


def roll_out(robot: Robot, drive: Drive) -> list[tuple[float, float, float]]:
    """Follow the wheel samples one by one along circles; the pose at every sample."""
    x, y, th = drive.stop_poses[0]
    poses = [(x, y, th)]
    for k in range(len(drive.t_ns) - 1):
        right = robot.rR * (drive.phi_R[k + 1] - drive.phi_R[k])
        left = robot.rL * (drive.phi_L[k + 1] - drive.phi_L[k])
        turn, ahead = (right - left) / robot.b, (right + left) / 2
        if abs(turn) > 1e-6:
            x += ahead / turn * (sin(th + turn) - sin(th))
            y -= ahead / turn * (cos(th + turn) - cos(th))
        else:
            x += ahead * cos(th + turn / 2)
            y += ahead * sin(th + turn / 2)
        th += turn
        poses.append((x, y, th))
    return poses


def test_arc_path_closes_the_circle_and_matches_the_closed_form() -> None:
    n = 360
    path = arc_path(np.array([1.0, 2.0, 0.3]), np.full(n, 2 * pi * 0.7 / n), np.full(n, 2 * pi / n))
    centre = np.array([1.0, 2.0]) + 0.7 * np.array([-sin(0.3), cos(0.3)])
    np.testing.assert_allclose(np.hypot(*(path[:, :2] - centre).T), 0.7, rtol=1e-12)
    np.testing.assert_allclose(path[-1], (1.0, 2.0, 0.3 + 2 * pi), atol=1e-12)


def test_pose_within_an_arc_is_the_end_of_the_shorter_arc() -> None:
    start = np.array([[0.2, -0.1, 2.0], [0.2, -0.1, 2.0], [0.0, 0.0, 0.0]])
    full = np.array([arc_path(s, np.array([d]), np.array([a]))[-1] for s, (d, a) in zip(start, CASES, strict=True)])
    part = np.array(
        [arc_path(s, np.array([0.3 * d]), np.array([0.3 * a]))[-1] for s, (d, a) in zip(start, CASES, strict=True)]
    )
    np.testing.assert_allclose(within_arc(start, full, np.full(3, 0.3)), part, atol=1e-14)


CASES = ((0.5, 1.1), (-0.4, 0.0), (0.0, -1.3))


def test_wheels_that_turn_without_slip_drive_the_arc() -> None:
    arc = Arc(distance=-0.6, turn=1.4)
    robot = turtlebot()
    right, left = wheel_turns([arc], rR=robot.rR, rL=robot.rL, b=robot.b, max_speed=0.2, step_s=0.02)
    assert (robot.rR * right.sum() + robot.rL * left.sum()) / 2 == pytest.approx(-0.6, rel=1e-12)
    assert (robot.rR * right.sum() - robot.rL * left.sum()) / robot.b == pytest.approx(1.4, rel=1e-12)
    rim = np.maximum(np.abs(robot.rR * right), np.abs(robot.rL * left)) / 0.02
    assert 0.15 < rim.max() <= 0.2 * (1 + 1e-9)
    assert max(rim[0], rim[-1]) < 0.01


@pytest.mark.parametrize("robot", robots(), ids=lambda r: r.name)
def test_exact_samples_reproduce_the_stops_by_arcs(robot: Robot) -> None:
    drive = simulate_drive(robot, TARGET, exact_options(stops=12), rng(5))
    poses = np.array(roll_out(robot, drive))
    at = np.searchsorted(drive.t_ns, drive.stop_t_ns)
    np.testing.assert_allclose(poses[at[:, 0]], drive.stop_poses, atol=1e-12)
    np.testing.assert_allclose(poses[at[:, 1]], drive.stop_poses, atol=1e-12)
    np.testing.assert_allclose(drive.stop_phi[:, 0], drive.phi_R[at[:, 0]], atol=0)


def test_arcs_keep_the_error_of_coarse_sampling_under_a_micrometre() -> None:
    robot = khepera()
    for seed in range(5):
        drive = simulate_drive(robot, TARGET, DriveOptions(stops=8, slip=0, encoder_step=0), rng(seed))
        poses = np.array(roll_out(robot, drive))
        error = np.abs(poses[np.searchsorted(drive.t_ns, drive.stop_t_ns[:, 0])] - drive.stop_poses).max()
        assert error < 1e-6


def test_truth_of_the_camera_is_the_stop_and_the_mounting() -> None:
    drive = simulate_drive(khepera(), TARGET, DriveOptions(stops=5), rng(3))
    for pose, T_box_cam in zip(drive.stop_poses, drive.T_box_cam, strict=True):
        np.testing.assert_allclose(planar(*pose) @ khepera().T_body_cam, T_box_cam, atol=1e-15)
    np.testing.assert_allclose(drive.pose_at(drive.stop_t_ns.mean(axis=1).astype(np.int64)), drive.stop_poses)
    middle = (drive.path_t_ns[1000:2000] + drive.path_t_ns[1001:2001]) // 2
    poses = drive.pose_at(middle)
    assert np.all(np.abs(poses - (drive.path[1000:2000] + drive.path[1001:2001]) / 2) < 1e-6)


def test_encoder_reads_multiples_of_its_step_just_below_the_true_angle() -> None:
    options = DriveOptions(stops=6, steps_per_sample=1)
    read, true = (
        simulate_drive(turtlebot(), TARGET, replace(options, encoder_step=step), rng(2))
        for step in (options.encoder_step, 0)
    )
    for reading, angle in ((read.phi_R, true.phi_R), (read.phi_L, true.phi_L)):
        behind = (angle - reading) / options.encoder_step
        assert behind.min() > -1e-9
        assert 0.9 < behind.max() < 1 + 1e-9
        ticks = reading / options.encoder_step
        np.testing.assert_allclose(ticks, np.rint(ticks), atol=1e-6)


def test_slip_has_the_variance_asked_for_however_finely_cut() -> None:
    slip, distance = 0.003, 2.5
    for steps in (1, 40):
        errors = slipped(np.full((4000, steps), -distance / steps), slip, rng(steps)).sum(axis=1) + distance
        statistic = float(np.sum(errors**2)) / (slip**2 * distance)
        assert chi2.ppf(1e-4, 4000) < statistic < chi2.ppf(1 - 1e-4, 4000)


def test_slip_of_a_whole_drive_has_the_variance_asked_for() -> None:
    slip, robot = 0.001, paper()
    options = DriveOptions(stops=8, slip=slip, encoder_step=0, steps_per_sample=1)
    statistic, freedom = 0.0, 0
    for seed in range(12):
        drive = simulate_drive(robot, TARGET, options, rng(seed))
        turn = np.diff(drive.path[:, 2])
        middle = drive.path[:-1, 2] + turn / 2
        step = np.diff(drive.path[:, :2], axis=0)
        ahead = (step[:, 0] * np.cos(middle) + step[:, 1] * np.sin(middle)) / np.sinc(turn / (2 * pi))
        for sign, r, phi in ((1, robot.rR, drive.phi_R), (-1, robot.rL, drive.phi_L)):
            rolled = r * np.diff(phi)
            moved = ahead + sign * robot.b / 2 * turn
            for (_, leave), (arrive, _) in zip(drive.stop_t_ns, drive.stop_t_ns[1:], strict=False):
                a, b = np.searchsorted(drive.t_ns, (leave, arrive))
                statistic += float((moved - rolled)[a:b].sum()) ** 2 / (slip**2 * np.abs(rolled[a:b]).sum())
                freedom += 1
    assert freedom == 12 * 7 * 2
    assert chi2.ppf(1e-4, freedom) < statistic < chi2.ppf(1 - 1e-4, freedom)


@pytest.mark.parametrize("robot", robots(), ids=lambda r: r.name)
def test_every_stop_reads_twenty_tags_of_a_face_and_most_two_faces(robot: Robot) -> None:
    drive = simulate_drive(robot, TARGET, DriveOptions(stops=12), rng(7))
    seen = exact_correspondences(robot, TARGET, drive)
    faces = np.array([np.bincount(TARGET.tag_faces[s.landmark_ids[::4] // 4], minlength=4) for s in seen.stops])
    assert faces.max(axis=1).min() >= 20
    assert np.sum(np.sort(faces, axis=1)[:, -2] > 0) >= 6
    assert np.all(faces.sum(axis=0) > 0)


@pytest.mark.parametrize("robot", robots(), ids=lambda r: r.name)
def test_way_keeps_the_robot_off_the_box(robot: Robot) -> None:
    for seed in range(3):
        drive = simulate_drive(robot, TARGET, DriveOptions(stops=9), rng(seed))
        x, y = np.abs(drive.path[:, :2]).T
        off = np.hypot(np.maximum(x - 0.125, 0), np.maximum(y - 0.125, 0))
        assert off.min() > 0.15 + robot.b / 2 - 0.005


def test_drive_turns_both_ways_and_goes_forwards_and_backwards() -> None:
    drive = simulate_drive(turtlebot(), TARGET, exact_options(stops=20), rng(0))
    ahead = turtlebot().rR * np.diff(drive.phi_R) + turtlebot().rL * np.diff(drive.phi_L)
    turn = turtlebot().rR * np.diff(drive.phi_R) - turtlebot().rL * np.diff(drive.phi_L)
    spot = np.abs(turn[np.abs(ahead) < 1e-12])
    assert ahead[ahead > 0].sum() > 1
    assert ahead[ahead < 0].sum() < -0.2
    assert turn[turn > 0].sum() > 0.2
    assert turn[turn < 0].sum() < -0.2
    assert spot.sum() > 0.2


def test_wheels_stand_still_at_stops_and_nowhere_else_for_long() -> None:
    drive = simulate_drive(khepera(), TARGET, DriveOptions(stops=8), rng(4))
    for t_start, t_end in drive.stop_t_ns:
        at = (drive.t_ns >= t_start) & (drive.t_ns <= t_end)
        assert 1.19e9 <= t_end - t_start <= 2.01e9
        assert np.ptp(drive.phi_R[at]) == 0
        assert np.ptp(drive.phi_L[at]) == 0
    moving = np.concatenate([[True], (np.diff(drive.phi_R) != 0) | (np.diff(drive.phi_L) != 0), [True]])
    longest = sorted(np.diff(np.flatnonzero(moving)))[::-1]
    assert longest[7] > 55
    assert longest[8] < 20


def test_explicit_stops_are_reached_by_straights_and_turns() -> None:
    stops = np.array([[0.6, 0.0, pi], [0.0, 0.7, -pi / 2], [-0.7, 0.1, 0.0], [-0.7, 0.1, 0.9]])
    drive = simulate_drive(paper(), TARGET, exact_options(), rng(0), stops)
    np.testing.assert_allclose(drive.stop_poses, stops, atol=1e-12)


def test_explicit_headings_hold_as_numbers_so_a_robot_can_spin() -> None:
    stops = np.array([[0.6, 0.0, 0.0], [0.6, 0.0, 4 * pi + 0.2], [0.6, 0.0, 0.1]])
    robot = paper()
    drive = simulate_drive(robot, TARGET, exact_options(), rng(0), stops)
    np.testing.assert_allclose(drive.stop_poses[:, 2], stops[:, 2], atol=1e-12)
    np.testing.assert_allclose(np.diff(drive.stop_phi[:, 0]), np.diff(stops[:, 2]) * robot.b / 2 / robot.rR, rtol=1e-12)


def test_pure_translation_turns_both_wheels_alike() -> None:
    stops = np.array([[x, 0.0, pi] for x in (0.5, 0.8, 0.6)])
    drive = simulate_drive(paper(), TARGET, exact_options(), rng(0), stops)
    np.testing.assert_allclose(np.diff(drive.phi_R), np.diff(drive.phi_L), atol=1e-13)
    np.testing.assert_allclose(np.diff(drive.stop_phi[:, 0]) * 0.03, (-0.3, 0.2), atol=1e-12)


def test_circling_twice_winds_the_heading_up() -> None:
    angle = np.linspace(0, 4 * pi, 17)
    stops = np.stack([0.6 * np.cos(angle), 0.6 * np.sin(angle), angle + pi], axis=1)
    drive = simulate_drive(paper(), TARGET, exact_options(), rng(0), stops)
    np.testing.assert_allclose(drive.stop_poses, stops, atol=1e-12)
    assert KeepOut.around(TARGET.box, 0).off_box(drive.path[:, :2]).min() > 0.18


@pytest.mark.parametrize(
    ("stops", "message"),
    [(((0.2, 0.0, 0.0),), "off the box"), (((np.nan, 0.0, 0.0),), "finite"), (((1.0, 0.0),), "x, y, heading")],
)
def test_impossible_explicit_stops_are_refused(stops: tuple[tuple[float, ...], ...], message: str) -> None:
    with pytest.raises(CalibError, match=message):
        simulate_drive(paper(), TARGET, exact_options(), rng(0), np.array(stops))


def test_camera_that_cannot_see_the_box_is_refused_with_a_remedy() -> None:
    up = replace(turtlebot(), T_body_cam=mount(pitch=radians(-80), z=0.2))
    with pytest.raises(CalibError, match=r"turtlebot: no place found .* tilt the camera"):
        simulate_drive(up, TARGET, DriveOptions(stops=3), rng(0))


def test_same_seed_gives_the_same_drive_and_another_a_different_one() -> None:
    a, b, c = (simulate_drive(paper(), TARGET, DriveOptions(stops=4), rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(a.path, b.path)
    np.testing.assert_array_equal(a.phi_R, b.phi_R)
    assert np.abs(a.stop_poses - c.stop_poses).max() > 0.01


def test_exact_correspondences_are_the_projected_landmarks() -> None:
    robot = random_robot("r", rng(8))
    drive = simulate_drive(robot, TARGET, exact_options(stops=5), rng(8))
    seen = exact_correspondences(robot, TARGET, drive)
    assert (seen.robot, seen.image_size, len(seen.wheels)) == ("r", (640, 480), len(drive.t_ns))
    for j, stop in enumerate(seen.stops):
        T_cam_box = inverse(drive.T_box_cam[j])
        np.testing.assert_array_equal(stop.p_box, TARGET.p_box(stop.landmark_ids))
        p_cam = stop.p_box @ T_cam_box[:3, :3].T + T_cam_box[:3, 3]
        np.testing.assert_allclose(stop.uv_px, project(robot.camera, p_cam), atol=1e-9)
        assert np.all(np.diff(stop.landmark_ids) > 0)
        assert (stop.t_start_ns, stop.t_end_ns) == tuple(drive.stop_t_ns[j])
        assert np.all(np.linalg.eigvalsh(stop.cov_px2) > 0)
    turned = sum(len(seen.leg(j)[0]) for j in range(4))
    assert turned > 100


def test_pixel_noise_has_the_sigma_asked_for() -> None:
    robot = paper()
    drive = simulate_drive(robot, TARGET, exact_options(stops=20), rng(1))
    exact, noisy = exact_correspondences(robot, TARGET, drive), exact_correspondences(robot, TARGET, drive, 0.3, rng(2))
    errors = np.concatenate([(n.uv_px - e.uv_px).ravel() for n, e in zip(noisy.stops, exact.stops, strict=True)])
    assert chi2.ppf(1e-4, errors.size) < np.sum(errors**2) / 0.09 < chi2.ppf(1 - 1e-4, errors.size)
    np.testing.assert_allclose(noisy.stops[0].cov_px2, np.broadcast_to(0.09 * np.eye(2), noisy.stops[0].cov_px2.shape))
    with pytest.raises(CalibError, match="pass rng"):
        exact_correspondences(robot, TARGET, drive, 0.3)


def test_paper_robot_has_the_papers_figures() -> None:
    robot = paper()
    assert (robot.rR, robot.rL, robot.b) == (0.03, 0.03, 0.08)
    np.testing.assert_allclose(robot.T_body_cam[:3, :3], rot_y(1.396))
    assert robot.T_body_cam[:3, 3].tolist() == [0.03, 0, 0]


def axis(T: Array, column: int) -> list[float]:
    return [round(float(v), 6) + 0.0 for v in T[:3, column]]


def test_mount_turns_left_then_down_then_clockwise() -> None:
    assert (axis(mount(), 2), axis(mount(), 0)) == ([1, 0, 0], [0, -1, 0])
    assert axis(mount(yaw=pi / 2), 2) == [0, 1, 0]
    assert axis(mount(pitch=pi / 2), 2) == [0, 0, -1]
    assert axis(mount(roll=pi / 2), 0) == [0, 0, -1]


def small_target() -> Target:
    return make_target(Box(width=0.12, depth=0.12, height=0.12, columns=3, rows=3))


def test_other_boxes_are_circled_too() -> None:
    target = small_target()
    drive = simulate_drive(turtlebot(), target, DriveOptions(stops=8), rng(0))
    seen = exact_correspondences(turtlebot(), target, drive)
    assert min(len(s.landmark_ids) for s in seen.stops) >= 4 * 6
