"""Which joints are wheels, by name."""

import pytest

from boxcal.detect.log.topics import choose_camera
from boxcal.detect.log.wheel_names import wheel_side


@pytest.mark.parametrize(
    "name",
    ["left_wheel_joint", "wheel_left_joint", "LeftWheel", "l_wheel_joint", "base_l_wheel", "lwheel", "wheelL",
     "robot1/left_wheel", "drivewhl_l_joint", "leftwheel", "front_left_wheel_joint", "WHEEL_LEFT"],
)  # fmt: skip
def test_left_and_right_wheels_are_told_by_their_names(name: str) -> None:
    other = name.replace("left", "right").replace("Left", "Right").replace("LEFT", "RIGHT").replace("_l_", "_r_")
    other = {"l_wheel_joint": "r_wheel_joint", "lwheel": "rwheel", "wheelL": "wheelR"}.get(name, other)
    assert (wheel_side(name), wheel_side(other)) == ("left", "right")


@pytest.mark.parametrize(
    "name",
    ["", "pan", "left_arm", "wheel", "caster_left_wheel", "left_steering_wheel", "left_wheel_suspension_joint",
     "left_right_wheel", "rear_wheel", "l_arm", "\x00"],
)  # fmt: skip
def test_other_joints_are_no_wheels(name: str) -> None:
    assert wheel_side(name) is None


def test_a_camera_topic_without_messages_is_passed_over() -> None:
    assert choose_camera("a", {"/x": 0, "/x/compressed": 3}, {}, None) == "/x/compressed"
    assert choose_camera("a", {"/x": 1, "/x/compressed": 3, "/x/compressedDepth": 3}, {}, None) == "/x"
