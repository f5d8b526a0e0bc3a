"""True scene at each stop of a drive: floor, box, camera pose and camera model."""

from dataclasses import dataclass, replace

import numpy as np

from boxcal.calib.geometry.so3_se3 import exp_se3, exp_so3, inverse, planar, rigid
from boxcal.calib.simulate.imperfections import CameraFaults, Imperfections
from boxcal.calib.simulate.robot import Robot
from boxcal.target.arrays import Array
from boxcal.target.camera.camera_model import CameraKind, CameraModel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """Floor, box and camera at each stop.

    Attributes
    ----------
    T_box_floor : (P, 4, 4), m
        The floor that the robot stands on, in the box's frame; with the robot's lean of each stop.
    lean : (P, 4, 4)
        Rotation of the robot against that floor, about its origin.
    T_body_cam : (P, 4, 4), m
        The camera on the robot.
    cameras
        The camera at each stop.
    """

    T_box_floor: Array
    lean: Array
    T_body_cam: Array
    cameras: tuple[CameraModel, ...]

    def T_box_cam(self, stop: int, pose: Array) -> Array:
        """Return the camera's pose (4, 4), m, of a robot at x, y, heading (3,) on the floor, as it is at a stop."""
        return np.asarray(self.T_box_floor[stop] @ planar(*pose) @ self.lean[stop] @ self.T_body_cam[stop])


def make_scene(robot: Robot, faults: Imperfections, stops: int, rng: np.random.Generator) -> Scene:
    """Return what stands where; random values are drawn only where there are any."""
    floor = rigid(exp_so3(np.array([*faults.tilt, 0.0])), np.zeros(3))
    T_floor_box = np.eye(4) if faults.box.standing is None else faults.box.standing
    turned = faults.lean * rng.standard_normal((stops, 2)) if faults.lean else np.zeros((stops, 2))
    focus = faults.camera.autofocus * rng.standard_normal(stops) if faults.camera.autofocus else np.zeros(stops)
    of_box, of_camera = [], []
    for j in range(stops):
        if faults.box.moved is not None and j == faults.box.moved[0]:
            T_floor_box = planar(*faults.box.moved[1:]) @ T_floor_box
        of_box.append(inverse(T_floor_box) @ floor)
        knocked = faults.camera.knocked
        of_camera.append(
            robot.T_body_cam @ exp_se3(np.array(knocked[1])) if knocked and j >= knocked[0] else robot.T_body_cam
        )
    return Scene(
        T_box_floor=np.array(of_box),
        lean=np.array([rigid(exp_so3(np.array([*w, 0.0])), np.zeros(3)) for w in turned]),
        T_body_cam=np.array(of_camera),
        cameras=tuple(_camera(robot, faults.camera, j, float(focus[j])) for j in range(stops)),
    )


def _camera(robot: Robot, faults: CameraFaults, stop: int, focus: float) -> CameraModel:
    """Return the camera at a stop: with the further coefficients, refocused, cropped."""
    camera = robot.camera
    if faults.fisheye is not None:
        k1, k2, k3, k4 = faults.fisheye
        camera = CameraModel(
            fu=camera.fu, fv=camera.fv, cu=camera.cu, cv=camera.cv, kr=k1, k2=k2, k3=k3, k4=k4, kind=CameraKind.FISHEYE
        )
    if camera.kind is CameraKind.RADIAL and any(faults.lens):
        k2, p1, p2, k3 = faults.lens
        camera = replace(camera, kind=CameraKind.BROWN, k2=k2, p1=p1, p2=p2, k3=k3)
    scale, right, down = (1.0, 0.0, 0.0) if faults.focus is None or stop < faults.focus[0] else faults.focus[1:]
    scale *= 1 + focus
    if (scale, right, down) == (1.0, 0.0, 0.0):
        return camera
    u, v = ((size - 1) / 2 for size in robot.image_size)
    return replace(
        camera,
        fu=scale * camera.fu,
        fv=scale * camera.fv,
        cu=u + scale * (camera.cu - u) + right,
        cv=v + scale * (camera.cv - v) + down,
    )
