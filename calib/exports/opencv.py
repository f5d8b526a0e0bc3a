"""``opencv_camera.yaml``: camera and extrinsics as OpenCV's FileStorage reads them."""

import cv2
import numpy as np

from boxcal.calib.exports.text import heading, ros_name, sigma_line
from boxcal.calib.results.calibration import Calibration
from boxcal.target.camera.distortion import CameraKind


def opencv_yaml(calibration: Calibration) -> str:
    """Return the file; ``T_body_cam`` maps camera points to the robot's body, m."""
    c = calibration.camera
    distortion = (*c.distortion, 0.0, 0.0, 0.0, 0.0) if c.kind is CameraKind.RADIAL else c.distortion
    fisheye = c.kind is CameraKind.FISHEYE
    lines = [
        *heading(calibration, "camera for OpenCV (FileStorage)"),
        "pixels; pixel (0, 0) is the centre of the top-left pixel, u to the right, v down",
        f"for {'cv::fisheye::projectPoints' if fisheye else 'cv::projectPoints'}; T_body_cam: m, body x forward, z up",
        sigma_line(calibration, ("fu", "fv", "cu", "cv", "kr")),
    ]
    file = cv2.FileStorage("boxcal.yaml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for line in lines:
        file.writeComment(line)
    file.write("camera_name", ros_name(calibration.robot))
    file.write("image_width", calibration.image_size[0])
    file.write("image_height", calibration.image_size[1])
    file.write("fisheye_model", int(fisheye))
    file.write("camera_matrix", np.asarray(c.K, dtype=float))
    file.write("distortion_coefficients", np.array([distortion], dtype=float))
    file.write("avg_reprojection_error", float(calibration.quality.reprojection_rms_px))
    file.write("T_body_cam", np.asarray(calibration.T_body_cam, dtype=float))
    return file.releaseAndGetString()
