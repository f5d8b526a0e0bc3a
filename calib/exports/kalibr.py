"""``camchain.yaml``: the camera as Kalibr describes a chain of one."""

from boxcal.calib.exports.lens_models import kalibr_distortion
from boxcal.calib.exports.names import Names
from boxcal.calib.exports.text import comment, heading, number, numbers, sigma_line
from boxcal.calib.geometry.so3_se3 import inverse, nearest_rotation, rigid
from boxcal.calib.results.calibration import Calibration


def camchain(calibration: Calibration, names: Names | None = None) -> str | None:
    """Return the file, or None where Kalibr has no such lens model.

    Every key on its top level is a camera to Kalibr, so all stands in ``cam0``. ``T_cam_body`` stands where a camera
    with an IMU has ``T_cam_imu``, and has its direction.
    """
    lens = kalibr_distortion(calibration)
    if lens is None:
        return None
    c = calibration.camera
    T = calibration.T_body_cam
    T_cam_body = inverse(rigid(nearest_rotation(T[:3, :3]), T[:3, 3]))
    lines = [
        *heading(calibration, "camera chain for Kalibr"),
        "intrinsics [fu, fv, pu, pv], px; pixel (0, 0) is the centre of the top-left pixel; radtan is k1, k2, p1, p2",
        "T_cam_body, m: maps points of the body (on the floor below the middle of the axle, x forward, y left, z up)",
        "to the camera (x right, y down, z forward), the direction of Kalibr's T_cam_imu",
        sigma_line(calibration, ("fu", "fv", "cu", "cv", "kr", "rx", "ry", "rz", "tx", "ty", "tz")),
    ]
    rows = "".join(f"  - {numbers(row)}\n" for row in T_cam_body.tolist())
    return comment(lines) + (
        "cam0:\n"
        "  cam_overlaps: []\n"
        "  camera_model: pinhole\n"
        f"  distortion_coeffs: {numbers(lens.coefficients)}\n"
        f"  distortion_model: {lens.model}\n"
        f"  intrinsics: [{number(c.fu)}, {number(c.fv)}, {number(c.cu)}, {number(c.cv)}]\n"
        f"  resolution: [{calibration.image_size[0]}, {calibration.image_size[1]}]\n"
        f'  rostopic: "{(names or Names()).topic}"\n'
        f"  T_cam_body:\n{rows}"
    )


def camchain_missing(calibration: Calibration) -> str | None:
    """Return why there is no camera chain; None where there is one."""
    if kalibr_distortion(calibration) is not None:
        return None
    lines = [
        *heading(calibration, "no camera chain for Kalibr"),
        "Kalibr's models (radtan: k1, k2, p1, p2; equidistant) have no place for all coefficients of the model that",
        f"the images ask for ({calibration.camera.kind}). Calibrate with --lens radial or --lens fisheye if Kalibr's",
        "file is needed, or read the camera from camera_info.yaml.",
    ]
    return "\n".join(lines) + "\n"
