"""Views of boxes with their truth, for the tests of the alignment."""

import numpy as np

from target.box import Box, make_target
from target.projection import Intrinsics, project
from target.render import Look, render, visible_tags

SIZE = (640, 480)
CAMERA = Intrinsics(fu=700.0, fv=700.0, cu=325.0, cv=236.0, kr=-0.1)
PLAIN = Look(noise=2.0, blur_px=0.6)
TARGET = make_target(Box())


def pose(azimuth_deg=20.0, distance=0.7, elevation_deg=12.0, roll_deg=5.0):
    """Return T_cam_box of a camera that looks at the box's middle, so far from its axis and so high."""
    az, el, roll = np.deg2rad((azimuth_deg, elevation_deg, roll_deg))
    middle = np.array([0.0, 0.0, 0.1])
    away = np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])
    z = -away
    x = np.cross(z, (0, 0, 1.0))
    x /= np.linalg.norm(x)
    turn = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
    T = np.eye(4)
    T[:3, :3] = turn @ np.stack([x, np.cross(z, x), z])
    T[:3, 3] = -T[:3, :3] @ (middle + distance * away)
    return T


def truth(T_cam_box, target=TARGET, camera=CAMERA):
    """Return where every tag's corners are, (T, 4, 2) px, and the rows of those wholly in view."""
    uv = project(camera, target.tag_corners @ T_cam_box[:3, :3].T + T_cam_box[:3, 3])
    seen = visible_tags(target, camera, T_cam_box, SIZE, 1.0)
    return uv, np.array([target.row_of(int(i)) for i in seen])


def width_px(corners):
    a, b = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    side = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
    return 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / side


def view(T_cam_box, look=PLAIN, target=TARGET, camera=CAMERA, seed=1):
    return render(target, camera, T_cam_box, SIZE, look, np.random.default_rng(seed))
