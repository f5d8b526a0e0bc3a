"""Views of boxes with their truth, for the tests of the alignment."""

from dataclasses import replace

import cv2
import numpy as np

from boxcal.detect.alignment.registration.align import align
from boxcal.detect.alignment.registration.parameters import KURTOSIS
from boxcal.detect.alignment.registration.tag_batch import Batch, Frame
from boxcal.detect.alignment.tag_patterns import target_patterns
from boxcal.detect.image.response_curve import response_table
from boxcal.target.box import Box, make_target
from boxcal.target.camera.camera_model import CameraModel, project
from boxcal.target.render.renderer import SensorModel, render, visible_tags

SIZE = (640, 480)
FINER = 3
CAMERA = CameraModel(fu=700.0, fv=700.0, cu=325.0, cv=236.0, kr=-0.1)
PLAIN = SensorModel(noise=2.0, psf_px=0.6)
TARGET = make_target(Box())
PATTERNS = target_patterns(TARGET)
LENS = np.array([325.0, 236.0, 0.012, 0.001, 1 / 320, 0.002, 0.05, 0.01, 0.0, 0.0])
BENT = np.array([340.0, 220.0, 0.5, 0.1, 1 / 320, 0.02, -0.1, 0.02, 0.0, 0.0])


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


def view(T_cam_box, sensor=PLAIN, target=TARGET, camera=CAMERA, seed=1):
    return render(target, camera, T_cam_box, SIZE, sensor, np.random.default_rng(seed))


def some_tags(azimuth_deg, response="linear", side=1, lens=LENS, *, roll_deg=5.0, near=2.5):
    """Return three tags of a view, all parameters off their best by some per cent."""
    T = pose(azimuth_deg, roll_deg=roll_deg)
    uv, seen = truth(T)
    rows = seen[::12][:3]
    frame = Frame(
        grey=(view(T, replace(PLAIN, srgb=response == "srgb")) / np.float32(255)),
        response=response_table(response),
        lens=lens,
    )
    tags = align(frame, PATTERNS, rows, uv[rows] + 0.1, iterations=4)
    theta = tags.theta.copy()
    theta[:, KURTOSIS] = 0.3
    theta[:, :8] *= 1.002
    low, high = uv[rows].min(axis=1).astype(int) - 4, uv[rows].max(axis=1).astype(int) + 5
    boxes = np.stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]], axis=1).astype(np.int64)
    stride = np.tile(np.array([[1, 1, 1], [5, 3, 1]])[0 if side == 1 else 1], (3, 1))
    return Batch(
        frame=frame,
        cells=PATTERNS.cells,
        rows=rows,
        theta=theta,
        normalisation=tags.normalisation,
        bounding_boxes=boxes,
        margin=np.full(3, 0.8),
        stride=stride,
        near=np.full(3, near),
    )


def bled(spread, camera, T):
    """Return a view in which black has grown by that share of a third of a pixel."""
    size = (640 * FINER, 480 * FINER)
    fine = replace(
        camera,
        fu=camera.fu * FINER,
        fv=camera.fv * FINER,
        cu=(camera.cu + 0.5) * FINER - 0.5,
        cv=(camera.cv + 0.5) * FINER - 0.5,
    )
    image = render(TARGET, fine, T, size, SensorModel(psf_px=0.6 * FINER))
    grown = (1 - spread) * image + spread * cv2.erode(image, np.ones((3, 3), np.uint8))
    return np.rint(cv2.resize(grown, (640, 480), interpolation=cv2.INTER_AREA)).astype(np.uint8)
