"""The images of a robot that is being driven, rendered one after the other as fast as the machine can."""

from dataclasses import replace
from math import atan2, hypot

import numpy as np

from boxcal.calib.geometry.so3_se3 import inverse
from boxcal.calib.simulate.recorder import RecordOptions
from boxcal.calib.simulate.serve.moving_robot import MovingRobot
from boxcal.target.arrays import Array, Image
from boxcal.target.camera.camera_model import project
from boxcal.target.render.renderer import render
from boxcal.target.render.sensor import SensorModel

EXPOSURE_S = 0.008
DARK_GAIN = 0.02
_MOST_BLUR_PX = 40.0
_BEFORE_CAMERA = np.array([0.0, 0.0, 0.6])


class LiveCamera:
    """Takes images; while the robot stands one is rendered, and only the noise is new."""

    def __init__(self, moving: MovingRobot, sensor: SensorModel, rng: np.random.Generator) -> None:
        self._moving, self._sensor, self._rng = moving, sensor, rng
        self._last: tuple[Array, float] | None = None
        self._at_rest: Image | None = None
        self.gain = 1.0

    def picture(self) -> Image:
        """Return the image (H, W) of now."""
        T_box_cam, now = self._moving.T_box_cam, self._moving.time_s
        still = self._last is not None and np.array_equal(self._last[0], T_box_cam)
        if not still or self._at_rest is None:
            streak = self._streak(T_box_cam, now)
            length = min(hypot(*streak), _MOST_BLUR_PX)
            sensor = replace(
                self._sensor,
                noise=0.0,
                gain=self.gain,
                motion_blur_px=length,
                motion_angle=atan2(streak[1], streak[0]),
            )
            robot = self._moving.robot
            self._at_rest = render(
                self._moving.target, robot.camera, inverse(T_box_cam), robot.image_size, sensor, self._rng
            )
            self._last = (T_box_cam, now)
        return self._noisy(self._at_rest)

    def set_gain(self, gain: float) -> None:
        """Change the exposure: 1 is right."""
        self.gain, self._at_rest = gain, None

    def _noisy(self, picture: Image) -> Image:
        noise = np.float32(self._sensor.noise) * self._rng.standard_normal(picture.shape, dtype=np.float32)
        return np.asarray(np.rint(np.clip(picture + noise, 0, 255)), dtype=np.uint8)

    def _streak(self, T_box_cam: Array, now: float) -> Array:
        """Return how far a point before the camera moves in the image during an exposure, (2,), px."""
        if self._last is None or now <= self._last[1] or not self._moving.moving:
            return np.zeros(2)
        p_box = T_box_cam[:3, :3] @ _BEFORE_CAMERA + T_box_cam[:3, 3]
        uv = []
        for T in (self._last[0], T_box_cam):
            T_cam_box = inverse(T)
            p_cam = T_cam_box[:3, :3] @ p_box + T_cam_box[:3, 3]
            if p_cam[2] < 0.05:
                return np.zeros(2)
            uv.append(project(self._moving.robot.camera, p_cam))
        streak = (uv[1] - uv[0]) * (EXPOSURE_S / (now - self._last[1]))
        return np.asarray(streak) if np.all(np.isfinite(streak)) else np.zeros(2)


def usual_sensor() -> SensorModel:
    """Return lens and sensor as the simulated logs have them."""
    return RecordOptions().sensor
