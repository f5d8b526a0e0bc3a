"""A picture's faults are told by what they are, and a robot on its way is not scolded for looking elsewhere."""

from dataclasses import replace

import numpy as np
import pytest

from boxcal.calib.geometry.so3_se3 import inverse, planar
from boxcal.calib.guide.drive.glance import Glance, glance
from boxcal.calib.guide.drive.warnings import sharpness, warnings_of_picture
from boxcal.calib.simulate.robot import turtlebot
from boxcal.target.arrays import Array
from boxcal.target.box import make_target
from boxcal.target.render.renderer import render
from boxcal.target.render.sensor import SensorModel

TARGET, ROBOT = make_target(), turtlebot()
SHARP = SensorModel(noise=1.5, psf_px=0.6, srgb=True)


def _pose(distance: float, turn: float = 0.0) -> Array:
    return np.asarray(planar(-distance, -distance, np.pi / 4 + turn) @ ROBOT.T_body_cam)


def _seen(distance: float = 0.42, sensor: SensorModel = SHARP, turn: float = 0.0) -> Glance:
    pose = inverse(_pose(distance, turn))
    image = render(TARGET, ROBOT.camera, pose, ROBOT.image_size, sensor, np.random.default_rng(1))
    return glance(image, 0, TARGET, ROBOT.camera)


def _said(seen: Glance, *, planned: bool = False, moving: bool = False) -> str:
    return "; ".join(w.text for w in warnings_of_picture(seen, planned=planned, moving=moving))


def test_a_good_picture_is_not_complained_of_and_tells_where_the_camera_is() -> None:
    seen = _seen()
    assert len(seen.faces) == 2
    assert not _said(seen)
    assert sharpness(seen) == "sharp"
    assert seen.T_box_cam is not None
    assert np.linalg.norm(seen.T_box_cam[:3, 3] - _pose(0.42)[:3, 3]) < 0.01
    assert seen.jpeg.startswith(b"\xff\xd8")


@pytest.mark.parametrize(
    ("sensor", "said"),
    [
        (replace(SHARP, gain=0.02), "too dark"),
        (replace(SHARP, gain=5.0), "overexposed"),
        (replace(SHARP, psf_px=2.0), "blurred"),
    ],
    ids=["dark", "bright", "blurred"],
)
def test_light_and_sharpness_are_judged(sensor: SensorModel, said: str) -> None:
    assert said in _said(_seen(0.42, sensor))


def test_distance_faces_and_direction_are_judged_where_the_robot_stands() -> None:
    far = replace(_seen(), side_px=15.0)
    assert "far" in _said(far)
    one = replace(_seen(), faces=(0,))
    assert "one face only" in _said(one)
    assert not _said(one, planned=True)
    elsewhere = _seen(turn=2.0)
    assert not len(elsewhere.corners)
    assert "no tag" in _said(elsewhere)
    for seen in (far, one, elsewhere):
        assert not _said(seen, moving=True)
