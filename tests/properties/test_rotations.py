"""Angles, rotations and rigid motions: identities that hold for all of them."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from boxcal.calib.geometry.euler import quaternion, roll_pitch_yaw
from boxcal.calib.geometry.so3_se3 import (
    euler_zyz,
    exp_se3,
    exp_so3,
    hat,
    inverse,
    log_so3,
    nearest_rotation,
    right_jacobian,
    rigid,
    rot_y,
    rot_z,
    vee,
    wrap,
)
from boxcal.target.arrays import Array

angles = st.floats(-1e4, 1e4)
directions = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.1)
lengths = st.one_of(
    st.floats(0, np.pi - 1e-6),
    st.floats(0, 1e-3),  # where series take over from quotients
    st.sampled_from([0.0, 1e-12, 1e-8, 9.99e-5, 1.001e-4, np.pi / 2, np.pi - 1e-7]),
)
rotation_vectors = st.builds(lambda v, length: v / np.linalg.norm(v) * length, directions, lengths)
rotations = rotation_vectors.map(exp_so3)
translations = st.tuples(*[st.floats(-10, 10)] * 3).map(np.array)
motions = st.builds(rigid, rotations, translations)


def close(a: Array, b: Array, tolerance: float = 1e-12) -> None:
    np.testing.assert_allclose(a, b, rtol=0, atol=tolerance)


@given(angles, st.integers(-1000, 1000))
def test_wrapped_angles_lie_in_one_turn_and_differ_by_whole_turns(angle: float, turns: int) -> None:
    wrapped = float(wrap(angle))
    assert -np.pi <= wrapped < np.pi
    whole = (angle - wrapped) / (2 * np.pi)
    assert abs(whole - round(whole)) < 1e-9
    close(np.exp(1j * wrap(angle + 2 * np.pi * turns)), np.exp(1j * angle), 1e-8)
    assert float(wrap(wrapped)) == wrapped or abs(wrapped) > np.pi - 1e-12


@given(rotation_vectors)
def test_logarithm_undoes_exponential(w: Array) -> None:
    """Within half a turn; near it the axis comes from the symmetric part, where half of the digits are left."""
    close(log_so3(exp_so3(w)), w, 1e-12 if np.linalg.norm(w) < 2.5 else 1e-8)


@given(rotation_vectors)
def test_exponential_is_a_rotation_about_its_own_axis(w: Array) -> None:
    R = exp_so3(w)
    close(R @ R.T, np.eye(3))
    assert np.linalg.det(R) > 0
    close(R @ w, w, 1e-11)
    close(exp_so3(-w), R.T)
    close(exp_so3(w / 2) @ exp_so3(w / 2), R)


@given(rotations, rotation_vectors)
def test_a_rotation_turns_the_axes_of_another(R: Array, w: Array) -> None:
    """The adjoint of SO(3): turned to the other side, a right perturbation becomes a left one about ``R w``."""
    close(R @ exp_so3(w), exp_so3(R @ w) @ R, 1e-11)
    close(R @ hat(w) @ R.T, hat(R @ w), 1e-11)
    close(vee(hat(w)), w)


@given(rotation_vectors, directions)
def test_right_jacobian_is_the_derivative_of_the_exponential(w: Array, d: Array) -> None:
    step = 1e-5
    there, back = exp_so3(w + step * d), exp_so3(w - step * d)
    numeric = log_so3(back.T @ there) / (2 * step)
    close(right_jacobian(w) @ d, numeric, 1e-6)


@given(motions, motions, translations)
def test_rigid_motions_compose_and_invert(T: Array, other: Array, p: Array) -> None:
    close(inverse(T) @ T, np.eye(4), 1e-11)
    close(inverse(T @ other), inverse(other) @ inverse(T), 1e-10)
    close(inverse(np.array([T, other]))[1], inverse(other))
    moved = T @ [*p, 1.0]
    close(moved[:3], T[:3, :3] @ p + T[:3, 3], 1e-10)


@given(motions, rotation_vectors, translations)
def test_a_right_perturbation_moves_a_frame_along_its_own_axes(T: Array, w: Array, t: Array) -> None:
    T_new = T @ exp_se3(np.concatenate([w, t]))
    close(T_new[:3, 3] - T[:3, 3], T[:3, :3] @ t, 1e-10)
    close(log_so3(T[:3, :3].T @ T_new[:3, :3]), w, 1e-7)


@given(st.floats(-3.1, 3.1), st.floats(1e-3, np.pi - 1e-3), st.floats(-3.1, 3.1))
def test_euler_angles_zyz_come_back(a1: float, a2: float, a3: float) -> None:
    close(np.array(euler_zyz(rot_z(a1) @ rot_y(a2) @ rot_z(a3))), np.array([a1, a2, a3]), 1e-9)


@given(rotations)
def test_euler_angles_make_the_rotation_again(R: Array) -> None:
    a1, a2, a3 = euler_zyz(R)
    assert 0 <= a2 <= np.pi
    close(rot_z(a1) @ rot_y(a2) @ rot_z(a3), R, 1e-8)
    roll, pitch, yaw = roll_pitch_yaw(R)
    assert abs(pitch) <= np.pi / 2 + 1e-12
    close(rot_z(yaw) @ rot_y(pitch) @ exp_so3(np.array([roll, 0, 0])), R, 1e-9)


@given(rotations)
def test_quaternions_are_of_length_one_and_make_the_rotation_again(R: Array) -> None:
    x, y, z, w = quaternion(R)
    assert w >= 0
    v = np.array([x, y, z])
    close(np.array(v @ v + w * w), np.array(1.0))
    close(np.eye(3) + 2 * w * hat(v) + 2 * hat(v) @ hat(v), R, 1e-9)


@given(rotations, st.tuples(*[st.floats(-1, 1)] * 9))
def test_nearest_rotation_is_a_rotation_and_leaves_rotations_alone(R: Array, noise: tuple[float, ...]) -> None:
    close(nearest_rotation(R), R)
    M = R + 0.1 * np.reshape(noise, (3, 3))
    near = nearest_rotation(M)
    close(near @ near.T, np.eye(3))
    assert np.linalg.det(near) > 0
    # No rotation a little further on is nearer.
    for axis in np.eye(3):
        for step in (-1e-3, 1e-3):
            assert np.linalg.norm(M - near @ exp_so3(step * axis)) >= np.linalg.norm(M - near) - 1e-12
