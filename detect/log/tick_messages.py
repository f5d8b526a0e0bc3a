"""Encoder messages of public robots: which fields are the wheels, and how many ticks make a turn."""

from dataclasses import dataclass

from boxcal.detect.log.signals import Quantity, Signal
from boxcal.detect.log.wheel_names import Side, encoder_side

ODOMETRY = {
    "nav_msgs/msg/Odometry": ("pose.pose.", "child_frame_id"),
    "foxglove.Odometry": ("pose.", "body_frame_id"),
    "foxglove_msgs/msg/Odometry": ("pose.", "body_frame_id"),
}
"""Types of odometry: where the pose and the robot's frame stand in them."""
FOXGLOVE_JOINTS = {"foxglove.JointStates", "foxglove_msgs/msg/JointStates"}
"""Foxglove's types of joint states."""

CREATE3_TICKS = 508.8
"""Encoder counts a turn of the wheel of iRobot's Create 3 (and so TurtleBot 4), from its documentation."""
KOBUKI_TICKS = 2578.33
"""Of Kobuki: 0.002436916871363930187454 rad a tick in its driver (kobuki_driver, diff_drive.cpp)."""
DYNAMIXEL_TICKS = 4096.0
"""Of TurtleBot 3: 0.001533981 rad a tick in its core (turtlebot3_core_config.h)."""
DUCKIEBOT_TICKS = 135.0
"""Of a Duckiebot's Hall encoders, from its documentation; the messages carry it as well."""

_COUNTS = {f"std_msgs/msg/{sign}Int{bits}" for sign in ("", "U") for bits in (16, 32, 64)}
_ANGLES = {"std_msgs/msg/Float32", "std_msgs/msg/Float64"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """A number in the messages of a topic that says how far a wheel has turned.

    Attributes
    ----------
    path, name
        Where it stands in the message; what it is called.
    quantity
        What it is.
    side
        Which wheel; None if only the user knows.
    ticks_per_turn
        None if the type does not say.
    resolution
        The field that carries the ticks a turn where the driver fills it in, empty if none does.
    """

    path: str
    name: str
    quantity: Quantity
    side: Side | None = None
    ticks_per_turn: float | None = None
    resolution: str = ""

    def signal(self, topic: str) -> Signal:
        """Return an empty signal of the field."""
        return Signal(
            topic=topic, name=self.name, quantity=self.quantity, side=self.side, ticks_per_turn=self.ticks_per_turn
        )


def _pair(right: str, left: str, quantity: Quantity, ticks: float | None = None) -> tuple[Field, ...]:
    return (
        Field(path=right, name=right, quantity=quantity, side="right", ticks_per_turn=ticks),
        Field(path=left, name=left, quantity=quantity, side="left", ticks_per_turn=ticks),
    )


_BOTH_WHEELS = {
    "irobot_create_msgs/msg/WheelTicks": _pair("ticks_right", "ticks_left", Quantity.TICKS, CREATE3_TICKS),
    "irobot_create_msgs/msg/WheelVels": _pair("velocity_right", "velocity_left", Quantity.VELOCITY),
    "kobuki_ros_interfaces/msg/SensorState": _pair("right_encoder", "left_encoder", Quantity.TICKS, KOBUKI_TICKS),
    "kobuki_msgs/msg/SensorState": _pair("right_encoder", "left_encoder", Quantity.TICKS, KOBUKI_TICKS),
    "turtlebot3_msgs/msg/SensorState": _pair("right_encoder", "left_encoder", Quantity.TICKS, DYNAMIXEL_TICKS),
}


def fields_of(kind: str, topic: str) -> tuple[Field, ...]:
    """Return the wheels that messages of a type carry in a topic, right first; none where there are none."""
    if kind in _BOTH_WHEELS:
        return _BOTH_WHEELS[kind]
    side = encoder_side(topic)
    if kind == "duckietown_msgs/msg/WheelEncoderStamped" and side is not None:
        return (
            Field(
                path="data",
                name="data",
                quantity=Quantity.TICKS,
                side=side,
                ticks_per_turn=DUCKIEBOT_TICKS,
                resolution="resolution",
            ),
        )
    if side is not None and kind in _COUNTS:
        return (Field(path="data", name="data", quantity=Quantity.TICKS, side=side),)
    if side is not None and kind in _ANGLES:
        return (Field(path="data", name="data", quantity=Quantity.POSITION, side=side),)
    return ()
