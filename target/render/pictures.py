"""Images of the assembled box, for README, docs and whoever builds it."""

from collections.abc import Mapping
from math import cos, radians, sin

import cv2
import numpy as np
from numpy.typing import NDArray

from boxcal.target.arrays import Array
from boxcal.target.box import FACES, Target
from boxcal.target.cad.numbers import T_box_lid_number, lid_number_height, strokes
from boxcal.target.camera.camera_model import CameraModel, project
from boxcal.target.render.renderer import SensorModel, encode_jpeg, render

LOOK = SensorModel(srgb=True, psf_px=0.5, vignetting=0.15, supersample=6, gain=1.05)
_QUALITY = 90
_NUMBER_GREY = 70


def box_pictures(target: Target) -> Mapping[str, bytes]:
    """Return images of the box as JPEG: file name -> content.

    ``box.jpg`` shows it from above a corner, ``robot.jpg`` as a camera 0.15 m above the floor sees it, ``around.jpg``
    from all four corners. The number of each face stands on the lid beside it.
    """
    reach = 1.6 * float(np.linalg.norm([target.box.width, target.box.depth, target.box.height]))
    low = min(0.15, target.box.height)
    return {
        "box.jpg": encode_jpeg(_seen(target, 38, 30, reach, (1280, 960)), _QUALITY),
        "robot.jpg": encode_jpeg(_seen(target, 12, 0, 1.3 * reach, (1280, 720), eye_height=low), _QUALITY),
        "around.jpg": encode_jpeg(_around(target, reach), _QUALITY),
    }


def _around(target: Target, reach: float) -> NDArray[np.uint8]:
    """Return four views, one above each upright edge, in a 2 x 2 sheet."""
    views = [_seen(target, 45 + 90 * face, 28, reach, (640, 480)) for face in range(FACES)]
    return np.asarray(np.vstack([np.hstack(views[:2]), np.hstack(views[2:])]))


def _seen(  # noqa: PLR0917 - where from, in the order in which one says it
    target: Target,
    azimuth_deg: float,
    elevation_deg: float,
    reach: float,
    size: tuple[int, int],
    eye_height: float | None = None,
) -> NDArray[np.uint8]:
    """Return the view of the box from a direction (azimuth from +x to +y) at a distance, m, with its numbers."""
    middle = np.array([0.0, 0.0, target.box.height / 2])
    a, e = radians(azimuth_deg), radians(elevation_deg)
    eye = middle + reach * np.array([cos(a) * cos(e), sin(a) * cos(e), sin(e)])
    if eye_height is not None:
        eye[2] = eye_height
    T_cam_box = looking(eye, middle)
    focal = 1.15 * size[0]
    camera = CameraModel(fu=focal, fv=focal, cu=(size[0] - 1) / 2, cv=(size[1] - 1) / 2, kr=0.0)
    picture = render(target, camera, T_cam_box, size, LOOK)
    if eye[2] > target.box.height:
        _draw_numbers(picture, target, camera, T_cam_box)
    return picture


def looking(eye: Array, at: Array) -> Array:
    """Return the pose T_cam_box (4, 4), m, of an upright camera at ``eye`` (3,) that looks at ``at`` (3,)."""
    z = (at - eye) / np.linalg.norm(at - eye)
    x = np.cross(z, (0.0, 0.0, 1.0))
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3] = np.stack([x, np.cross(z, x), z])
    T[:3, 3] = -T[:3, :3] @ eye
    return T


def _draw_numbers(picture: NDArray[np.uint8], target: Target, camera: CameraModel, T_cam_box: Array) -> None:
    """Draw the lid's numbers into an image, twice as tall as they are engraved."""
    height, fraction = 2 * lid_number_height(target.box), 6
    for face in range(FACES):
        T = T_cam_box @ T_box_lid_number(target.box, face)
        for line in strokes(face, height):
            p_cam = line @ T[:3, :2].T + T[:3, 3]
            uv_px = np.rint(project(camera, p_cam) * 2**fraction).astype(np.int32)
            cv2.polylines(picture, [uv_px], False, _NUMBER_GREY, 2, cv2.LINE_AA, fraction)
