"""The four steps return what went in, and refuse what cannot be determined."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from boxcal.calib.errors import CalibError
from boxcal.calib.four_steps.camera_mode import CameraMode
from boxcal.calib.four_steps.procedure import FourSteps, solve_four_steps, solve_motion
from boxcal.calib.four_steps.step1_camera import calibrate_camera, located
from boxcal.calib.four_steps.step2_heading import solve_heading
from boxcal.calib.four_steps.step3_axis import find_axis
from boxcal.calib.four_steps.step4_mounting import solve_mounting
from boxcal.calib.geometry.so3_se3 import euler_zyz, planar, rigid, rot_y, rot_z
from boxcal.detect.correspondences import Correspondences, load_correspondences
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraModel

LOOKS = {  # yaw to the left, pitch down, roll; deg
    "ahead": (0.0, 0.0, 0.0),
    "ahead and tilted": (3.0, 14.0, -1.2),
    "up and rolled": (-20.0, -8.0, 30.0),
    "to the left": (90.0, 5.0, 0.0),
    "to the right": (-90.0, 10.0, 2.0),
    "backwards": (180.0, 7.0, 0.5),
}


def wrong(found: FourSteps, drive: Any) -> dict[str, float]:
    """Relative errors of wheels; absolute ones (rad, m) of the mounting."""
    w, m = drive.wheels, found.mounting
    return {
        "rR": abs(m.rR / w.rR - 1),
        "rL": abs(m.rL / w.rL - 1),
        "b": abs(m.b / w.b - 1),
        "T_body_cam": float(np.abs(found.T_body_cam - drive.T_body_cam).max()),
    }


@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.parametrize("rounds", [0.9, 2.0], ids=["once", "twice"])
def test_steps_2_to_4_return_every_parameter_from_exact_poses(exact: Any, look: str, rounds: float) -> None:
    rng = np.random.default_rng(3)
    drive = exact.through(exact.around(14, rounds, LOOKS[look][0], rng), exact.mounting(*LOOKS[look]))
    found = solve_motion(drive.camera_step(), drive.legs)
    assert max(wrong(found, drive).values()) < 1e-10
    assert found.mounting.null_ratio < 1e-10
    assert found.mounting.rank_ratio > 0.01
    assert found.heading.rms < 1e-12


@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.parametrize("rounds", [0.9, 2.0], ids=["once", "twice"])
def test_all_four_steps_return_every_parameter_from_exact_correspondences(exact: Any, look: str, rounds: float) -> None:
    rng = np.random.default_rng(4)
    drive = exact.through(exact.around(12, rounds, LOOKS[look][0], rng), exact.mounting(*LOOKS[look]))
    found = solve_four_steps(drive.correspondences())
    assert max(wrong(found, drive).values()) < 1e-6
    for name in ("fu", "fv", "cu", "cv"):
        assert getattr(found.camera.camera, name) == pytest.approx(getattr(exact.camera, name), rel=1e-6)
    assert found.camera.camera.kr == pytest.approx(exact.camera.kr, abs=1e-6)


def test_stops_nearly_half_a_turn_apart_are_no_special_case(exact: Any) -> None:
    poses = np.array([[0.7, 0.1, np.pi], [-0.6, 0.05, 1e-7], [0.65, -0.1, np.pi - 1e-5], [0.05, 0.7, -np.pi / 2]])
    drive = exact.through(poses, exact.mounting(2.0, 8.0, 1.0))
    assert max(wrong(solve_motion(drive.camera_step(), drive.legs), drive).values()) < 1e-10
    assert max(wrong(solve_four_steps(drive.correspondences()), drive).values()) < 1e-6


def test_whole_turns_on_the_spot_between_stops_are_counted(exact: Any) -> None:
    poses = exact.around(9, 1.0, 0.0, np.random.default_rng(5))
    drive = exact.through(poses, exact.mounting(0.0, 10.0), spins=(0, 1, 0, -2, 0, 3, 0, 0))
    assert max(wrong(solve_motion(drive.camera_step(), drive.legs), drive).values()) < 1e-10


@pytest.mark.parametrize("seed", range(20))
def test_three_stops_are_enough(exact: Any, seed: int) -> None:
    rng = np.random.default_rng(seed)
    arcs = np.array([[rng.uniform(8, 14), rng.uniform(2, 6)], [rng.uniform(3, 8), rng.uniform(8, 15)]])
    drive = exact.arcs(arcs, (0.6, 0.0, 2.0), exact.mounting(*rng.uniform(-10, 10, 3)))
    assert max(wrong(solve_motion(drive.camera_step(), drive.legs), drive).values()) < 1e-9


def test_a_camera_under_the_floor_of_the_body_keeps_its_sign(exact: Any) -> None:
    drive = exact.through(
        exact.around(8, 1.0, 0.0, np.random.default_rng(1)), exact.mounting(0, 0, 175.0, t=(0.1, 0.0, 0.3))
    )
    assert max(wrong(solve_motion(drive.camera_step(), drive.legs), drive).values()) < 1e-10


@pytest.mark.parametrize("down", [True, False])
def test_a_camera_looking_straight_down_or_up_is_solved_and_said(exact: Any, down: bool) -> None:
    T = rigid(rot_z(0.4) @ rot_y(np.pi if down else 0.0), np.array([0.05, 0.02, 0.3]))
    drive = exact.through(exact.around(8, 1.0, 0.0, np.random.default_rng(2)), T)
    found = solve_motion(drive.camera_step(), drive.legs)
    assert max(wrong(found, drive).values()) < 1e-10
    assert "straight" in found.notes[0]


def test_noise_costs_little_with_each_mode_of_step_1(exact: Any) -> None:
    drive = exact.through(exact.around(20, 1.6, 0.0, np.random.default_rng(6)), exact.mounting(2.0, 9.0, 1.0))
    seen = drive.correspondences(0.1, np.random.default_rng(7))
    joint = solve_four_steps(seen)
    assert 0.09 * np.sqrt(2) < joint.camera.rms_px < 0.105 * np.sqrt(2)
    assert max(wrong(joint, drive)[k] for k in ("rR", "rL", "b")) < 0.01
    alone = solve_four_steps(seen, CameraMode.PER_STOP)
    assert alone.camera.camera != joint.camera.camera
    assert alone.camera.camera.fu == pytest.approx(exact.camera.fu, rel=0.01)
    assert max(wrong(alone, drive)[k] for k in ("rR", "rL", "b")) < 0.05


def test_per_stop_mode_leaves_out_and_names_stops_that_see_one_face(exact: Any) -> None:
    poses = exact.around(8, 0.9, 0.0, np.random.default_rng(6))
    poses[3] = (0.7, 0.0, np.pi)
    drive = exact.through(poses, exact.mounting(0.0, 5.0))
    step = calibrate_camera(drive.correspondences().stops, (640, 480), CameraMode.PER_STOP)
    assert 3 not in step.kept
    assert any(note.startswith("stop 4:") and "one plane" in note for note in step.notes)
    found = solve_four_steps(drive.correspondences(), CameraMode.PER_STOP)
    assert max(wrong(found, drive).values()) < 1e-6


def _refusal(drive: Any) -> str:
    with pytest.raises(CalibError) as error:
        solve_motion(drive.camera_step(), drive.legs)
    return str(error.value)


def test_pure_translation_is_refused_with_the_largest_turn(exact: Any) -> None:
    poses = np.array([[0.9, 0.0, np.pi], [0.8, 0.0, np.pi], [0.6, 0.0, np.pi], [0.5, 0.0, np.pi]])
    message = _refusal(exact.through(poses, exact.mounting(0.0, 5.0)))
    assert "largest turn between stops is 0.0 deg" in message
    assert "10 deg" in message
    assert "translation" in message


def test_a_turn_just_below_the_limit_is_refused_and_just_above_taken(exact: Any) -> None:
    for turn_deg, refused in ((9.8, True), (10.2, False)):
        poses = np.array([planar(0.6, 0.0, th) for th in np.radians([0.0, turn_deg])])
        if refused:
            with pytest.raises(CalibError, match=r"largest turn between stops is 9\.8 deg"):
                find_axis(np.linalg.inv(poses @ exact.mounting(0.0, 5.0)))
        else:
            assert find_axis(np.linalg.inv(poses @ exact.mounting(0.0, 5.0))).a2 > 0


def test_pure_rotation_on_the_spot_is_refused_by_its_own_message(exact: Any) -> None:
    turns = np.array([0.4, 0.7, -0.5, 1.0, 0.3])[:, None]
    arcs = turns * np.array([1 / exact.wheels.rR, -1 / exact.wheels.rL]) * exact.wheels.b / 2
    message = _refusal(exact.arcs(arcs, (0.6, 0.0, 2.8), exact.mounting(0.0, 5.0)))
    assert "turned on the spot" in message
    assert "drive forward" in message


def test_identical_turns_are_refused_by_their_own_message(exact: Any) -> None:
    message = _refusal(exact.arcs(np.tile([9.0, 6.0], (6, 1)), (0.6, 0.0, 2.0), exact.mounting(0.0, 5.0)))
    assert "all turns are alike" in message
    assert "condition number" in message


def test_nearly_identical_turns_with_noise_are_refused(exact: Any) -> None:
    rng = np.random.default_rng(8)
    arcs = np.tile([9.0, 6.0], (6, 1)) * (1 + 1e-4 * rng.normal(size=(6, 2)))
    drive = exact.arcs(arcs, (0.6, 0.0, 2.0), exact.mounting(0.0, 5.0))
    noisy = np.array([rigid(rot_z(1e-3 * rng.normal()), np.zeros(3)) for _ in drive.T_box_body])
    axis = find_axis(np.linalg.inv(drive.T_box_body @ noisy @ drive.T_body_cam))
    i, j = np.triu_indices(7, 1)
    phi = np.stack([drive.legs.phi_R, drive.legs.phi_L], axis=1)
    with pytest.raises(CalibError, match="all turns are alike"):
        solve_heading(-axis.theta[i, j], phi[j] - phi[i], moves=6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d[:, ::-1], "left and right wheel joints are swapped"),
        (lambda d: d * [1, -1], "the sign of the left wheel is reversed"),
        (lambda d: d * [-1, 1], "the sign of the right wheel is reversed"),
    ],
    ids=["swapped", "left reversed", "right reversed"],
)
def test_wheels_swapped_or_reversed_are_named(exact: Any, change: Any, words: str) -> None:
    drive = exact.through(exact.around(12, 1.3, 0.0, np.random.default_rng(9)), exact.mounting(0.0, 5.0))
    legs = type(drive.legs)(
        dphi_R=np.ascontiguousarray(change(drive.dphi)[:, 0]),
        dphi_L=np.ascontiguousarray(change(drive.dphi)[:, 1]),
        ends=drive.ends,
    )
    with pytest.raises(CalibError, match=words):
        solve_motion(drive.camera_step(), legs)


def test_two_stops_are_refused(exact: Any) -> None:
    drive = exact.through(exact.around(2, 0.5, 0.0, np.random.default_rng(1)), exact.mounting(0.0, 5.0))
    with pytest.raises(CalibError, match="2 usable stops, at least 3"):
        solve_four_steps(drive.correspondences())


def test_wheels_that_have_nothing_to_do_with_the_images_are_refused(exact: Any) -> None:
    rng = np.random.default_rng(10)
    drive = exact.through(exact.around(12, 1.3, 0.0, rng), exact.mounting(0.0, 5.0))
    other = exact.through(exact.around(12, 1.3, 0.0, rng)[::-1].copy(), exact.mounting(0.0, 5.0))
    with pytest.raises(CalibError, match=r"too much to tell the wheels apart|do not agree"):
        solve_motion(drive.camera_step(), other.legs)


def test_faces_seen_straight_on_only_do_not_give_a_focal_length(exact: Any) -> None:
    poses = np.array([[0.7, 0.0, np.pi], [0.8, 0.0, np.pi], [0.9, 0.0, np.pi]])
    seen = exact.through(poses, exact.mounting(0.0, 0.0, t=(0.0, 0.0, 0.1))).correspondences()
    with pytest.raises(CalibError, match="two faces of the box"):
        calibrate_camera(seen.stops, seen.image_size)


def test_a_saved_drive_calibrates_alike(exact: Any, tmp_path: Path) -> None:
    drive = exact.through(exact.around(6, 0.9, 0.0, np.random.default_rng(2)), exact.mounting(1.0, 5.0))
    seen: Correspondences = drive.correspondences(0.1, np.random.default_rng(0))
    seen.save(tmp_path / "drive.npz")
    a, b = solve_four_steps(seen), solve_four_steps(load_correspondences(tmp_path / "drive.npz"))
    assert np.array_equal(a.T_body_cam, b.T_body_cam)
    assert a.mounting.rL == b.mounting.rL


def test_euler_angles_give_their_rotation_back() -> None:
    rng = np.random.default_rng(0)
    for a1, a2, a3 in rng.uniform([-3, 0.01, -3], [3, 3.1, 3], (50, 3)):
        assert euler_zyz(rot_z(a1) @ rot_y(a2) @ rot_z(a3)) == pytest.approx((a1, a2, a3), abs=1e-12)


def _censi(path: Path) -> Array:
    """Rows of wheel rates and scan matches: phi_R, phi_L travelled (rad), sensor x, y (m), theta (rad)."""
    text, decoder, at, rows = path.read_text(), json.JSONDecoder(), 0, []
    while text[at:].strip():
        at += len(text[at:]) - len(text[at:].lstrip())
        row, at = decoder.raw_decode(text, at)
        rows.append((row["T"] * row["phi_r"], row["T"] * row["phi_l"], *row["sm"]))
    return np.array(rows)


def _planar_sensor(rows: Array) -> tuple[Array, Array, Array]:
    """Steps 2 and 4 for consecutive pairs of a planar sensor: the solution, and each pair's two residuals."""
    phi, xy, turn = rows[:, :2], rows[:, 2:4], rows[:, 4]
    heading = solve_heading(turn, phi, moves=len(rows))
    rolled = phi @ (heading.aR, heading.aL)
    m = 0.5 * (phi[:, 1] - heading.aR / heading.aL * phi[:, 0]) * np.sinc(rolled / 2 / np.pi)
    beta = m[:, None] * np.stack([np.cos(rolled / 2), np.sin(rolled / 2)], axis=1)
    c, s = np.cos(turn), np.sin(turn)
    u = -np.stack([c * xy[:, 0] + s * xy[:, 1], -s * xy[:, 0] + c * xy[:, 1]], axis=1)
    step = solve_mounting(beta=beta, theta=-turn, u=u, aR=heading.aR, aL=heading.aL)
    moved = step.rL * beta + np.stack(
        [(c - 1) * step.tx - s * step.ty, s * step.tx + (c - 1) * step.ty], axis=1
    )  # of the sensor, in the body's axes
    expected = moved @ np.array([[np.cos(step.a1), -np.sin(step.a1)], [np.sin(step.a1), np.cos(step.a1)]])
    found = np.array([step.rL, step.rR, step.b, step.tx, step.ty, step.a1])
    return found, np.linalg.norm(expected - xy, axis=1), np.abs(turn - rolled)


def test_real_khepera_data_return_the_published_calibration(shared_data: Path) -> None:
    """Censi et al. 2013: their recipe solves, drops the worst 1 % by position and by angle, four times over."""
    rows = _censi(shared_data / "censi" / "lstraight.tuple")
    for _ in range(4):
        _, off, turned = _planar_sensor(rows)
        rows = rows[(off <= np.quantile(off, 0.99)) & (turned <= np.quantile(turned, 0.99))]
    found, _, _ = _planar_sensor(rows)
    published = json.loads((shared_data / "censi" / "lstraight_results.json").read_text())
    assert found[0] == pytest.approx(published["l_diam"] / 2, rel=1e-4)
    assert found[1] == pytest.approx(published["r_diam"] / 2, rel=1e-4)
    assert found[2] == pytest.approx(published["axle"], rel=1e-4)
    assert found[3] == pytest.approx(published["l_x"], abs=0.03e-3)
    assert found[4] == pytest.approx(published["l_y"], abs=0.03e-3)
    assert found[5] == pytest.approx(published["l_theta"], abs=np.radians(0.01))


def test_landmarks_too_close_together_for_a_pose_are_said(exact: Any) -> None:
    """OpenCV's solver refuses them by an exception of its own."""
    rng = np.random.default_rng(4)
    drive = exact.through(exact.around(4, 0.5, 0.0, rng), exact.mounting(*LOOKS["ahead"])).correspondences()
    near = [replace(stop, uv_px=100 + 1e-3 * stop.uv_px) for stop in drive.stops]
    with pytest.raises(CalibError, match="no camera pose explains"):
        located(CameraModel(fu=500.0, fv=500.0, cu=320.0, cv=240.0, kr=0.0), near)
