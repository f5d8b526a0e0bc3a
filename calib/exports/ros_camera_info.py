"""``camera_info.yaml``: the camera as ROS' camera_calibration writes it and camera_info_manager reads it."""

from dataclasses import dataclass

from boxcal.calib.exports.lens_models import ros_distortion
from boxcal.calib.exports.text import comment, heading, numbers, ros_name, sigma_line, yaml_name
from boxcal.calib.results.calibration import Calibration
from boxcal.target.arrays import Array

_MODELS = {
    "plumb_bob": "k1, k2, p1, p2, k3 in OpenCV's order, of (x/z, y/z); k1 is kr",
    "rational_polynomial": "k1, k2, p1, p2, k3, k4, k5, k6 in OpenCV's order, of (x/z, y/z); k1 is kr",
    "equidistant": "k1, k2, k3, k4 of OpenCV's fisheye, of the angle off the axis",
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rectified:
    """Rectification of one camera of a stereo pair.

    Attributes
    ----------
    R : (3, 3)
        Rotates the camera's points to the pair's common axes.
    P : (3, 4)
        Projection of these; of the second camera ``P[0, 3]`` (of an upright pair ``P[1, 3]``) is less the baseline
        times the focal length.
    """

    R: Array
    P: Array


def camera_info(calibration: Calibration, rectified: Rectified | None = None, name: str = "") -> str:
    """Return the content of ``camera_info.yaml``.

    Without a rectification the projection matrix is the camera matrix, for a monocular camera; ``name`` is the
    camera's, else the robot's.
    """
    c, lens = calibration.camera, ros_distortion(calibration)
    K = [c.fu, 0.0, c.cu, 0.0, c.fv, c.cv, 0.0, 0.0, 1.0]
    R = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    P = [c.fu, 0.0, c.cu, 0.0, 0.0, c.fv, c.cv, 0.0, 0.0, 0.0, 1.0, 0.0]
    if rectified is not None:
        R, P = rectified.R.ravel().tolist(), rectified.P.ravel().tolist()
    width, height = calibration.image_size
    lines = [
        *heading(calibration, "camera intrinsics for ROS (camera_calibration_parsers)"),
        "pixels; pixel (0, 0) is the centre of the top-left pixel, u to the right, v down",
        f"{lens.model}: {_MODELS[lens.model]}",
        sigma_line(calibration, ("fu", "fv", "cu", "cv", "kr")),
    ]
    parts = [
        comment(lines),
        f"image_width: {width}\n",
        f"image_height: {height}\n",
        f"camera_name: {yaml_name(name or ros_name(calibration.robot))}\n",
        _matrix("camera_matrix", 3, 3, K),
        f"distortion_model: {lens.model}\n",
        _matrix("distortion_coefficients", 1, len(lens.coefficients), list(lens.coefficients)),
        _matrix("rectification_matrix", 3, 3, R),
        _matrix("projection_matrix", 3, 4, P),
    ]
    return "".join(parts)


def _matrix(name: str, rows: int, cols: int, data: list[float]) -> str:
    return f"{name}:\n  rows: {rows}\n  cols: {cols}\n  data: {numbers(data)}\n"
