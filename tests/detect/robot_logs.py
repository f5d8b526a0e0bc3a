"""Drives in the topics, types and names that public robots publish, written by rosbags and the mcap library."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.writer import Writer
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from small_logs import LEFT, RIGHT, T0_NS, blank

from boxcal.detect.log.topics import Topics
from boxcal.detect.log.wheel_samples import JointUnit, WheelUnits
from boxcal.target.arrays import Array, Ids

JOINTS, IMAGE = "sensor_msgs/msg/JointState", "sensor_msgs/msg/Image"
DUCKIE_TICKS = "duckietown_msgs/msg/WheelEncoderStamped"
DEFINITIONS = {
    "irobot_create_msgs/msg/WheelTicks": "std_msgs/Header header\nint32 ticks_left\nint32 ticks_right\n",
    "kobuki_ros_interfaces/msg/SensorState": (
        "std_msgs/Header header\nuint16 time_stamp\nuint8 bumper\nuint8 wheel_drop\nuint8 cliff\nuint16 left_encoder\n"
        "uint16 right_encoder\nint8 left_pwm\nint8 right_pwm\nuint8 buttons\nuint8 charger\nuint8 battery\n"
        "uint16[] bottom\nuint8[] current\nuint8 over_current\nuint16 digital_input\nuint16[] analog_input\n"
    ),
    "turtlebot3_msgs/msg/SensorState": (
        "std_msgs/Header header\nuint8 bumper\nfloat32 cliff\nfloat32 sonar\nfloat32 illumination\nuint8 led\n"
        "uint8 button\nbool torque\nint32 left_encoder\nint32 right_encoder\nfloat32 battery\n"
    ),
    DUCKIE_TICKS: "std_msgs/Header header\nint32 data\nuint16 resolution\nuint8 type\n",
    "my_msgs/msg/Board": "uint32 uptime\nint64[] counts\nmy_msgs/Side right\nmy_msgs/Side left\n"
    + "=" * 80
    + "\nMSG: my_msgs/Side\nfloat32 angle\n",
}
STORE = get_typestore(Stores.ROS2_HUMBLE)
STORE1 = get_typestore(Stores.ROS1_NOETIC)
for store in (STORE, STORE1):
    for name, text in DEFINITIONS.items():
        found = get_types_from_msg(text, name)
        store.register({k: v for k, v in found.items() if k not in store.fielddefs})

Angles = tuple[Ids, Array, Array]
"""Stamps (S,) ns, and angles of the right and the left wheel (S,) rad."""
Message = tuple[str, str, int, Any]
"""Topic, type, time of recording, message."""
Pictures = Sequence[tuple[int, NDArray[np.uint8]]]
"""Stamps, ns, and grey pictures."""

BLANKS: Pictures = [(T0_NS + round((0.5 + 2 * k) * 1e9), blank(48, 64)) for k in range(4)]


def header(t_ns: int, frame: str = "", store: Any = STORE, **more: Any) -> Any:
    sec, nanosec = divmod(int(t_ns), 10**9)
    stamp = store.types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
    return store.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **more)


def joint_state(
    topic: str, t_ns: int, names: list[str], positions: list[float], velocities: list[float] | None = None
) -> Message:
    message = STORE.types[JOINTS](
        header=header(t_ns),
        name=names,
        position=np.array(positions, dtype=float),
        velocity=np.array(velocities or [], dtype=float),
        effort=np.zeros(0),
    )
    return topic, JOINTS, int(t_ns) + 2_000_000, message


def message_of(kind: str, topic: str, t_ns: int, *, stamped: bool = True, **fields: Any) -> Message:
    head = {"header": header(t_ns)} if stamped else {}
    return topic, kind, int(t_ns) + (2_000_000 if stamped else 0), STORE.types[kind](**head, **fields)


def images(pictures: Pictures, *topics: tuple[str, str]) -> Iterator[Message]:
    """Yield pictures in topics of an encoding each: of distances (16UC1) something else, ``jpeg`` as such."""
    for t, picture in pictures:
        for topic, encoding in topics or (("/camera/image_raw", "mono8"),):
            head, late = header(t, "camera_color_optical_frame"), int(t) + 30_000_000
            if encoding == "jpeg":
                kind = "sensor_msgs/msg/CompressedImage"
                data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].ravel()
                yield topic, kind, late, STORE.types[kind](header=head, format="jpeg", data=data)
                continue
            height, width = picture.shape
            message = STORE.types[IMAGE](
                header=head,
                height=height,
                width=width // 2 if encoding == "16UC1" else width,
                encoding=encoding,
                is_bigendian=0,
                step=width,
                data=picture.ravel(),
            )
            yield topic, IMAGE, late, message


def odometry(topic: str, angles: Angles, nominal: tuple[float, float], *, midpoint: bool = False) -> Iterator[Message]:
    """Yield poses as a driver reckons them from its wheels with a radius and a separation, m: by arcs or midpoints."""
    t_ns, phi_R, phi_L = angles
    radius, separation = nominal
    kind, types = "nav_msgs/msg/Odometry", STORE.types
    s = radius * np.diff(phi_R + phi_L, prepend=phi_R[0] + phi_L[0]) / 2
    turn = radius * np.diff(phi_R - phi_L, prepend=phi_R[0] - phi_L[0]) / separation
    heading = np.cumsum(turn)
    chord = s if midpoint else s * np.sinc(turn / (2 * np.pi))
    x, y = np.cumsum(chord * np.cos(heading - turn / 2)), np.cumsum(chord * np.sin(heading - turn / 2))
    zero = types["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
    twist = types["geometry_msgs/msg/TwistWithCovariance"](
        twist=types["geometry_msgs/msg/Twist"](linear=zero, angular=zero), covariance=np.zeros(36)
    )
    for k, t in enumerate(t_ns):
        pose = types["geometry_msgs/msg/Pose"](
            position=types["geometry_msgs/msg/Point"](x=float(x[k]), y=float(y[k]), z=0.0),
            orientation=types["geometry_msgs/msg/Quaternion"](
                x=0.0, y=0.0, z=float(np.sin(heading[k] / 2)), w=float(np.cos(heading[k] / 2))
            ),
        )
        message = types[kind](
            header=header(t, "odom"),
            child_frame_id="base_footprint",
            pose=types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=np.zeros(36)),
            twist=twist,
        )
        yield topic, kind, int(t) + 2_000_000, message


def write_mcap(path: Path, *parts: Iterable[Message]) -> Path:
    """Write messages by time with the mcap library."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        channels: dict[tuple[str, str], int] = {}
        for topic, kind, log, message in sorted((m for part in parts for m in part), key=lambda m: m[2]):
            if (topic, kind) not in channels:
                text = STORE.generate_msgdef(kind, ros_version=2)[0].encode()
                channels[topic, kind] = writer.register_channel(
                    topic, "cdr", writer.register_schema(kind, "ros2msg", text)
                )
            writer.add_message(channels[topic, kind], log, bytes(STORE.serialize_cdr(message, kind)), log)
        writer.finish()
    return path


def ticks(phi: Array, turn: float, bits: int = 31, *, signed: bool = False) -> Ids:
    """Return what a counter of so many bits reads: from 0 on, or with as much below zero as above."""
    counts, least = np.floor(phi * turn / (2 * np.pi)).astype(np.int64), 2 ** (bits - 1) if signed else 0
    return counts if bits == 64 else np.mod(counts + least, 2**bits) - least


def zeros(topic: str, angles: Angles, names: list[str]) -> Iterator[Message]:
    for t in angles[0]:
        yield joint_state(topic, t, names, [0.0] * len(names))


def joints(topic: str, angles: Angles, names: Sequence[str], more: Sequence[str] = ()) -> Iterator[Message]:
    """Yield the wheels' angles under names, left first, beside other joints that hardly move."""
    for k, (t, right, left) in enumerate(zip(*angles, strict=True)):
        others = [0.1 * (1 + np.sin(0.01 * k + j)) for j in range(len(more))]
        yield joint_state(topic, t, [*more, *names], [*others, left, right])


def several_wheels(angles: Angles, names: Sequence[str], right: Sequence[bool]) -> Iterator[Message]:
    for t, phi_R, phi_L in zip(*angles, strict=True):
        yield joint_state("/joint_states", t, list(names), [phi_R if r else phi_L for r in right])


def wheel_ticks(angles: Angles) -> Iterator[Message]:
    t_ns, phi_R, phi_L = angles
    for t, right, left in zip(t_ns, ticks(phi_R, 508.8), ticks(phi_L, 508.8), strict=True):
        kind = "irobot_create_msgs/msg/WheelTicks"
        yield message_of(kind, "/wheel_ticks", t, ticks_left=int(left), ticks_right=int(right))


def kobuki_core(angles: Angles) -> Iterator[Message]:
    """Yield Kobuki's sensor states: counters of 16 bits that run over."""
    right, left = (ticks(phi + 155.0, 2578.33, 16) for phi in angles[1:])
    small = {"left_pwm": 0, "right_pwm": 0, "buttons": 0, "charger": 0, "battery": 0, "over_current": 0}
    lists = {"bottom": np.zeros(3, np.uint16), "current": np.zeros(2, np.uint8), "analog_input": np.zeros(4, np.uint16)}
    for t, r, left_ticks in zip(angles[0], right, left, strict=True):
        yield message_of(
            "kobuki_ros_interfaces/msg/SensorState",
            "/sensors/core",
            t,
            time_stamp=0,
            bumper=0,
            wheel_drop=0,
            cliff=0,
            left_encoder=int(left_ticks),
            right_encoder=int(r),
            digital_input=0,
            **small,
            **lists,
        )


def turtlebot3_core(angles: Angles) -> Iterator[Message]:
    right, left = (ticks(phi, 4096) for phi in angles[1:])
    rest = {"bumper": 0, "cliff": 0.0, "sonar": 0.0, "illumination": 0.0, "led": 0, "button": 0, "torque": True}
    for t, r, left_ticks in zip(angles[0], right, left, strict=True):
        yield message_of(
            "turtlebot3_msgs/msg/SensorState",
            "/sensor_state",
            t,
            left_encoder=int(left_ticks),
            right_encoder=int(r),
            battery=12.0,
            **rest,
        )


def counters(angles: Angles, kind: str, right: str, left: str) -> Iterator[Message]:
    """Yield bare counters of 1200 ticks a turn, a topic a wheel, without stamps."""
    for topic, phi in ((right, angles[1]), (left, angles[2])):
        for t, count in zip(angles[0], ticks(phi + 5, 1200, int(kind[3:]), signed=True), strict=True):
            yield message_of(f"std_msgs/msg/{kind}", topic, t, stamped=False, data=int(count))


def board(angles: Angles) -> Iterator[Message]:
    """Yield a message type of somebody's own that holds the wheels twice: as counters and as float32 angles."""
    side = STORE.types["my_msgs/msg/Side"]
    counts = np.stack([ticks(phi + 5, 1200) for phi in (angles[2], angles[1])], axis=1)
    for t, r, left, count in zip(*angles, counts, strict=True):
        sides = {"right": side(angle=float(r)), "left": side(angle=float(left))}
        yield message_of("my_msgs/msg/Board", "/board", t, stamped=False, uptime=0, counts=count, **sides)


def duckiebot(path: Path, angles: Angles, pictures: Pictures) -> Path:
    """Write a Duckiebot's drive, a ROS 1 bag, with rosbags: a topic a wheel."""
    events: list[tuple[int, str, str, Any]] = []
    for side, phi in (("right", angles[1]), ("left", angles[2])):
        for t, count in zip(angles[0], ticks(phi, 135), strict=True):
            head = header(t, store=STORE1, seq=0)
            message = STORE1.types[DUCKIE_TICKS](header=head, data=int(count), resolution=135, type=1)
            events.append((int(t), f"/duckie/{side}_wheel_encoder_node/tick", DUCKIE_TICKS, message))
    for k, (t, picture) in enumerate(pictures):
        image = STORE1.types[IMAGE](
            header=header(t, store=STORE1, seq=k),
            height=picture.shape[0],
            width=picture.shape[1],
            encoding="mono8",
            is_bigendian=0,
            step=picture.shape[1],
            data=picture.ravel(),
        )
        events.append((int(t), "/duckie/camera_node/image", IMAGE, image))
    path = path.with_suffix(".bag")
    with Ros1Writer(path) as bag:
        connections: dict[str, Any] = {}
        for t, topic, kind, message in sorted(events, key=lambda e: e[0]):
            if topic not in connections:
                connections[topic] = bag.add_connection(topic, kind, typestore=STORE1)
            bag.write(connections[topic], t, STORE1.serialize_ros1(message, kind))
    return path


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotLog:
    """How one public robot's recordings look, and what a user says of them.

    Attributes
    ----------
    wheels
        Its messages of a drive.
    cameras
        Topic and encoding of its cameras; the first is the one that is meant.
    topics, units, nominal
        The options that the docs' table tells its user to give.
    tick : rad
        Of its encoders; 0: positions are exact.
    driver : m
        Radius and separation that its driver reckons with, of odometry alone.
    write
        What writes it where that is not an MCAP of ROS 2.
    """

    wheels: Callable[[Angles], Iterable[Message]] = lambda _: ()
    cameras: tuple[tuple[str, str], ...] = (("/camera/image_raw", "mono8"),)
    topics: Topics | None = None
    units: WheelUnits | None = None
    nominal: tuple[float, float] | None = None
    tick: float = 0.0
    driver: tuple[float, float] | None = None
    write: Callable[[Path, Angles, Pictures], Path] | None = None

    def log(self, path: Path, angles: Angles, pictures: Pictures = BLANKS) -> Path:
        """Write a drive as the robot records it."""
        if self.write is not None:
            return self.write(path, angles, pictures)
        return write_mcap(path, self.wheels(angles), images(pictures, *self.cameras))


def _turn(n: float) -> float:
    return 2 * np.pi / n


def _joints(names: Sequence[str], topic: str = "/joint_states", more: Sequence[str] = (), **rest: Any) -> RobotLog:
    return RobotLog(wheels=lambda a: joints(topic, a, names, more), **rest)


def _four(names: Sequence[str], is_right: Callable[[str], bool]) -> RobotLog:
    return RobotLog(wheels=lambda a: several_wheels(a, names, [is_right(n) for n in names]))


DRIVER = (0.034, 0.155)
"""Radius and separation, m, that drivers reckon with: a few per cent beside the truth of any robot of the tests."""


def _odometry(
    topic: str,
    *beside: Callable[[Angles], Iterable[Message]],
    midpoint: bool = False,
    nominal: tuple[float, float] | None = DRIVER,
) -> RobotLog:
    def wheels(angles: Angles) -> Iterator[Message]:
        yield from odometry(topic, angles, DRIVER, midpoint=midpoint)
        for part in beside:
            yield from part(angles)

    return RobotLog(wheels=wheels, nominal=nominal, driver=DRIVER)


def _zero_joints(*names: str) -> Callable[[Angles], Iterator[Message]]:
    return lambda angles: zeros("/joint_states", angles, list(names))


def _filtered(topic: str) -> Callable[[Angles], Iterator[Message]]:
    """Return odometry that a filter made of the wheels' and an IMU's: other turns."""
    return lambda angles: odometry(topic, angles, (DRIVER[0], DRIVER[1] * 1.1))


def _described(angles: Angles) -> Iterator[Message]:
    """Yield the odometry's wheels as the robot's description has them."""
    wheel = '<link name="{0}"><collision><geometry><cylinder radius="{1}" length="1"/></geometry></collision></link>'
    joint = (
        '<joint name="{0}_wheel_joint" type="continuous"><parent link="base_link"/><child link="{0}"/>'
        '<origin xyz="0 {1} 0"/><axis xyz="0 1 0"/></joint>'
    )
    radius, separation = DRIVER
    sides = (("left", separation / 2), ("right", -separation / 2))
    body = "".join(wheel.format(s, radius) + joint.format(s, y) for s, y in sides)
    urdf = f'<robot name="r"><link name="base_link"/>{body}</robot>'
    yield "/robot_description", "std_msgs/msg/String", int(angles[0][0]), STORE.types["std_msgs/msg/String"](data=urdf)


def _parameters(angles: Angles) -> Iterator[Message]:
    """Yield what nodes say of their parameters as they start: the driver's, and another's that has no wheels."""
    kind, types = "rcl_interfaces/msg/ParameterEvent", STORE.types
    for node, values in (
        ("/controller_manager", {"update_rate": 100.0}),
        ("/diff_drive_controller", {"wheel_radius": DRIVER[0], "wheel_separation": DRIVER[1] / 1.25}),
        ("/diff_drive_controller", {"wheel_separation_multiplier": 1.25}),
    ):
        new = [
            types["rcl_interfaces/msg/Parameter"](
                name=name,
                value=types["rcl_interfaces/msg/ParameterValue"](
                    type=3,
                    bool_value=False,
                    integer_value=0,
                    double_value=value,
                    string_value="",
                    byte_array_value=np.zeros(0, np.uint8),
                    bool_array_value=np.zeros(0, np.bool_),
                    integer_array_value=np.zeros(0, np.int64),
                    double_array_value=np.zeros(0),
                    string_array_value=[],
                ),
            )
            for name, value in values.items()
        ]
        stamp = header(int(angles[0][0])).stamp
        event = types[kind](stamp=stamp, node=node, new_parameters=new, changed_parameters=[], deleted_parameters=[])
        yield "/parameter_events", kind, int(angles[0][0]), event


def _locobot(angles: Angles) -> Iterator[Message]:
    yield from joints("/mobile_base/joint_states", angles, ["wheel_left_joint", "wheel_right_joint"])
    for k, (t, right, left) in enumerate(zip(*angles, strict=True)):
        if k % 2 == 0:
            both = ["arm_left_1_joint", "wheel_left_joint", "head", "wheel_right_joint"]
            yield joint_state("/joint_states", t, both, [0.1, left, 0.2 * k, right])


def _in_unit(unit: JointUnit, factor: float) -> RobotLog:
    return RobotLog(
        wheels=lambda a: joints("/joint_states", (a[0], a[1] * factor, a[2] * factor), [LEFT, RIGHT]),
        units=WheelUnits(unit=unit),
    )


_CREATE3 = RobotLog(
    wheels=lambda a: [*wheel_ticks(a), *odometry("/odom", a, (0.0359, 0.233))],
    cameras=(("/camera/image_raw/compressed", "jpeg"),),
    tick=_turn(508.8),
)
_REALSENSE = (
    ("/camera/color/image_raw", "mono8"),
    ("/camera/depth/image_rect_raw", "16UC1"),
    ("/camera/aligned_depth_to_color/image_raw", "16UC1"),
    ("/camera/infra1/image_rect_raw", "mono8"),
    ("/camera/infra2/image_rect_raw", "mono8"),
    ("/camera/color/image_rect", "mono8"),
)
_1200 = WheelUnits(unit=JointUnit.TICKS, ticks_per_turn=1200)

ROBOTS: dict[str, RobotLog] = {
    "TurtleBot 3": _joints(["wheel_left_joint", "wheel_right_joint"]),
    "TurtleBot 3 (OpenCR alone)": RobotLog(wheels=turtlebot3_core, tick=_turn(4096)),
    "Andino": _joints(["left_wheel_joint", "right_wheel_joint"]),
    "DiffBot": _joints(["left_wheel_joint", "right_wheel_joint"], more=["pan", "tilt"]),
    "TurtleBot 4": RobotLog(
        wheels=lambda a: [
            *_CREATE3.wheels(a),
            *zeros("/joint_states", a, ["left_wheel_joint", "right_wheel_joint"]),
        ],
        cameras=(("/oakd/rgb/preview/image_raw", "mono8"),),
        tick=_turn(508.8),
    ),
    "Create 3": _CREATE3,
    "Kobuki": _joints(["wheel_left_joint", "wheel_right_joint"]),
    "Kobuki (/sensors/core)": RobotLog(wheels=kobuki_core, tick=_turn(2578.33)),
    "Duckiebot": RobotLog(write=duckiebot, tick=_turn(135)),
    "LoCoBot": RobotLog(wheels=_locobot, cameras=_REALSENSE),
    "PMB2": _joints(
        ["wheel_left_joint", "wheel_right_joint"],
        more=["caster_back_left_2_joint", "caster_front_left_2_joint", "suspension_left_joint"],
    ),
    "TIAGo": _joints(
        ["wheel_left_joint", "wheel_right_joint"],
        more=["arm_1_joint", "gripper_left_finger_joint", "torso_lift_joint", "head_1_joint"],
        cameras=(("/xtion/rgb/image_raw/compressed", "jpeg"), ("/xtion/depth/image_raw", "16UC1")),
    ),
    "Husky": _four(
        ["front_left_wheel_joint", "front_right_wheel_joint", "rear_left_wheel_joint", "rear_right_wheel_joint"],
        lambda n: "right" in n,
    ),
    "Jackal": _four(
        ["front_left_wheel", "front_right_wheel", "rear_left_wheel", "rear_right_wheel"], lambda n: "right" in n
    ),
    "Warthog": _four(
        ["front_left_wheel_joint", "front_right_wheel_joint", "rear_left_wheel_joint", "rear_right_wheel_joint"],
        lambda n: "right" in n,
    ),
    "ROSbot": _four(["fl_wheel_joint", "fr_wheel_joint", "rl_wheel_joint", "rr_wheel_joint"], lambda n: n[1] == "r"),
    "Panther": _four(["fl_wheel_joint", "fr_wheel_joint", "rl_wheel_joint", "rr_wheel_joint"], lambda n: n[1] == "r"),
    "Leo": _four(["wheel_FL_joint", "wheel_FR_joint", "wheel_RL_joint", "wheel_RR_joint"], lambda n: n[7] == "R"),
    "six wheels": _four(
        [f"{place}_{side}_wheel" for place in ("front", "middle", "rear") for side in ("left", "right")],
        lambda n: "right" in n,
    ),
    "linorobot2": _odometry(
        "/odom/unfiltered", _filtered("/odom"), _zero_joints("left_wheel_joint", "right_wheel_joint")
    ),
    "e-puck2": _odometry("/odom", midpoint=True),
    "Pioneer (ROSARIA)": _odometry("/RosAria/pose"),
    "Pioneer (p2os)": _odometry("/pose", _zero_joints("p2os_left_hubcap_joint", "p2os_right_hubcap_joint")),
    "Raspberry Pi Mouse": _odometry("/odom", _zero_joints("left_wheel_joint", "right_wheel_joint"), midpoint=True),
    "LIMO": _odometry("/odom", midpoint=True),
    "Stretch": _odometry("/odom", _zero_joints("joint_lift", "joint_head_pan", "joint_gripper_finger_left")),
    "MiR": _odometry("/odom", _filtered("/odometry/filtered"), _zero_joints("left_wheel_joint", "right_wheel_joint")),
    "odometry beside its robot's description": _odometry("/odom", _described, nominal=None),
    "odometry beside its driver's parameters": _odometry("/odom", _parameters, nominal=None),
    "Int32 counters": RobotLog(
        wheels=lambda a: counters(a, "Int32", "/right_ticks", "/left_ticks"), units=_1200, tick=_turn(1200)
    ),
    "Int64 counters": RobotLog(
        wheels=lambda a: counters(a, "Int64", "/encoder/right", "/encoder/left"), units=_1200, tick=_turn(1200)
    ),
    "Int16 counters": RobotLog(
        wheels=lambda a: counters(a, "Int16", "/rwheel", "/lwheel"), units=_1200, tick=_turn(1200)
    ),
    "any message, ticks in a list": RobotLog(
        wheels=board,
        units=_1200,
        topics=Topics(left_joint="/board.counts[0]", right_joint="/board.counts[1]"),
        tick=_turn(1200),
    ),
    "any message, angles": RobotLog(
        wheels=board, topics=Topics(left_joint="board.left.angle", right_joint="/board.right.angle"), tick=1e-5
    ),
    "wheels without a side in their names": _joints(
        ["wheel0", "wheel1"], topics=Topics(left_joint="wheel0", right_joint="wheel1")
    ),
    "a reversed wheel": RobotLog(
        wheels=lambda a: joints("/joint_states", (a[0], -a[1], a[2]), [LEFT, RIGHT]),
        units=WheelUnits(reverse_right=True),
    ),
    "degrees": _in_unit(JointUnit.DEGREES, 180 / np.pi),
    "turns": _in_unit(JointUnit.TURNS, 1 / (2 * np.pi)),
    "metres": _in_unit(JointUnit.METRES, DRIVER[0]),
}
"""Every row of the table in docs/recording.md."""
