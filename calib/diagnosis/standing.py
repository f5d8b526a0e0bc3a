"""Attitude of the box on the floor (upright, upside down, on its side, raised), estimated from camera poses."""

from enum import StrEnum

import numpy as np

from boxcal.calib.four_steps.step3_axis import MIN_TURN_DEG
from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.likelihood.finding import Finding
from boxcal.target.arrays import Array
from boxcal.target.box import FACES, Target


class Standing(StrEnum):
    """Attitude of the box as far as the images show it; UNCLEAR where the camera itself lies on its side."""

    UPRIGHT = "upright"
    UNCLEAR = "unclear"
    UPSIDE_DOWN = "upside down"
    ON_SIDE = "on its side"


_CLEAR = 0.5
_ENOUGH = 6
"""Stops that an axis must rest on."""
_ONE_AXIS = 0.1
"""Turns are about one axis if they leave it in place to this, root mean square (6 deg)."""


def vertical_in_box(T_cam_box: Array) -> tuple[Array, float]:
    """Return the axis that the robot turned about, in frame ``box`` (3,), up to its sign, and how far turns move it.

    The robot turns about the floor's vertical only: ``R_box_cam n_cam`` is the same at every stop.

    Parameters
    ----------
    T_cam_box : (P, 4, 4), m
        The camera's poses.
    """
    R = T_cam_box[:, :3, :3]
    i, j = np.triu_indices(len(R), 1)
    relative = np.swapaxes(R[j], 1, 2) @ R[i]  # R_box(j)_box(i), as the camera sees the box turn
    relative = relative.reshape(-1, 3, 3)
    _, singular, Vt = np.linalg.svd((relative - np.eye(3)).reshape(-1, 3), full_matrices=False)
    return Vt[-1], float(singular[-1] / np.sqrt(len(relative)))


def largest_turn(T_cam_box: Array) -> float:
    """Return the largest angle between two of the poses (P, 4, 4), rad."""
    flat = T_cam_box[:, :3, :3].reshape(-1, 9)
    return float(np.arccos(np.clip((np.min(flat @ flat.T) - 1) / 2, -1, 1)))


def how_it_stands(T_cam_box: Array) -> Standing:
    """Return whether the box lies on its side, stands upside down under upright cameras, or stands upright.

    Upside down: the images' upward direction points down in the box's frame, at every stop. A camera mounted upside
    down looks the same; the wheels tell these apart (:mod:`boxcal.calib.diagnosis.wheel_signs`).
    """
    axis, moved = vertical_in_box(T_cam_box)
    if largest_turn(T_cam_box) < np.radians(MIN_TURN_DEG):  # noise has an axis, too
        moved = np.inf
    if abs(axis[2]) < np.cos(np.radians(45)) and moved < _ONE_AXIS and len(T_cam_box) >= _ENOUGH:
        return Standing.ON_SIDE
    up = float(np.median(-inverse(T_cam_box)[:, 2, 1]))  # z in the box of the image's upward direction
    if abs(up) < _CLEAR:
        return Standing.UNCLEAR
    return Standing.UPSIDE_DOWN if up < 0 else Standing.UPRIGHT


def side_finding(T_cam_box: Array, target: Target) -> Finding:
    """Return what is said of a box that lies on its side."""
    axis, _ = vertical_in_box(T_cam_box)
    normals = np.array([target.T_box_face(f)[:3, 2] for f in range(FACES)])
    camera = inverse(T_cam_box)[:, :3, 3].mean(axis=0)
    down = -axis if axis @ camera > 0 else axis
    face = int(np.argmax(normals @ down))
    return Finding(
        cause="box-on-side",
        text=f"the box lies on its side, face {face} down: the axis that the robot turned about lies flat in its frame",
        advice="Stand the box upright on the robot's floor and drive again.",
        blocks=True,
    )


def upside_down(target: Target) -> Array:
    """Return the pose of the box's frame, upside down, in that of the box that stands there, (4, 4), m."""
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[2, 3] = target.box.height
    return T


def below_floor(T_box_cam: Array) -> Finding | None:
    """Return what is said of cameras (P, 4, 4) below the floor that the box stands on; None if none is."""
    height = float(np.median(T_box_cam[:, 2, 3]))
    if height >= 0:
        return None
    return Finding(
        cause="below-floor",
        text=f"the camera is {-height * 1e3:.0f} mm below the floor that the box stands on: the box stands on "
        "something at least that high, or it is another box",
        advice="Stand the box on the floor that the robot drives on, or give the target.json of the box that was used.",
        blocks=True,
        size=-height * 1e3,
        unit="mm",
    )


def below_axle(height: float, radius: float) -> Finding | None:
    """Return what is said of a camera that is lower than the wheels' axle (both m); None if it is not."""
    if not 0 <= height < radius:
        return None
    return Finding(
        cause="box-raised",
        text=f"the camera would be {height * 1e3:.0f} mm above the floor, lower than the wheels' axle "
        f"({radius * 1e3:.0f} mm): the box may stand on something",
        advice="Stand the box on the floor that the robot drives on; only the camera's height depends on it.",
        size=height * 1e3,
        unit="mm",
    )
