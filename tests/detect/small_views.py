"""Rendered views of the default box for the tests of detect."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from boxcal.target.arrays import Array
from boxcal.target.box import Target, make_target
from boxcal.target.camera.camera_model import CameraModel, project
from boxcal.target.render.renderer import SensorModel, render

SIZE = (480, 360)
CAMERA = CameraModel(fu=420.0, fv=423.0, cu=238.4, cv=181.7, kr=-0.1)
TARGET = make_target()


def T_cam_box(angle_deg: float, distance: float = 0.55, height: float = 0.14) -> Array:
    """Return the box's pose before a camera that looks at its middle from a direction (0: face 0's normal)."""
    angle = np.radians(angle_deg)
    centre = np.array([distance * np.cos(angle), distance * np.sin(angle), height])
    z = np.array([0.0, 0.0, 0.1]) - centre
    z /= np.linalg.norm(z)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(z, x), z])
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, -R @ centre
    return T


def true_corners(ids: NDArray[np.int64], T: Array, target: Target = TARGET) -> Array:
    """Return where tags' corners are seen, (N, 4, 2) px."""
    p_box = target.tag_corners[[target.row_of(int(i)) for i in ids]]
    return project(CAMERA, p_box @ T[:3, :3].T + T[:3, 3])


def true_landmarks(landmark_ids: NDArray[np.int64], T: Array) -> Array:
    """Return where landmarks of the default box are seen, (L, 2) px."""
    return project(CAMERA, TARGET.p_box(landmark_ids) @ T[:3, :3].T + T[:3, 3])


@lru_cache(maxsize=32)
def view(
    angle_deg: float,
    *,
    srgb: bool = True,
    noise: float = 1.5,
    psf_px: float = 0.6,
    seed: int = 0,
    target: Target = TARGET,
    distance: float = 0.55,
) -> NDArray[np.uint8]:
    sensor = SensorModel(noise=noise, psf_px=psf_px, srgb=srgb)
    image = render(target, CAMERA, T_cam_box(angle_deg, distance), SIZE, sensor, np.random.default_rng(seed))
    image.setflags(write=False)
    return image
