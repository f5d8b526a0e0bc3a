"""Results of a robot with several cameras, camera by camera."""

from dataclasses import replace

import numpy as np

from boxcal.calib.results.calibration import Calibration
from boxcal.calib.results.rig import RigCamera


def each_camera(calibration: Calibration) -> tuple[Calibration, ...]:
    """Return a robot's result once for each of its cameras, the robot's own first, as it is.

    Those of further cameras are named as their folders are (``r01/rear``) and have what the robot's own file says of
    them: camera model, extrinsics, covariance and fit, with the robot's wheels and drive. A robot with one camera, and
    the file of a further camera, are one result.
    """
    rig = calibration.rig
    if rig is None or not np.array_equal(rig.cameras[0].T_body_cam, calibration.T_body_cam):
        return (calibration,)
    return (calibration, *(_of(calibration, camera) for camera in rig.cameras[1:]))


def _of(robot: Calibration, camera: RigCamera) -> Calibration:
    detail = None
    if robot.detail is not None and camera.covariance is not None:
        detail = replace(robot.detail, covariance=camera.covariance, camera_covariance=None)
    quality = replace(
        robot.quality,
        stops=camera.stops,
        landmarks=camera.landmarks,
        reprojection_rms_px=camera.reprojection_rms_px,
    )
    return replace(
        robot,
        robot=f"{robot.robot}/{camera.name}",
        image_size=camera.image_size,
        camera=camera.camera,
        T_body_cam=camera.T_body_cam,
        quality=quality,
        detail=detail,
        findings=(),
        notes=(),
        verdict=None,
        rig=None,
    )
