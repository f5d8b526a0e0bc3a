"""Logs in the topics, types and names that public robots publish: each gives the wheels that were driven."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from small_logs import LEFT, RIGHT, T0_NS, blank, drive

from boxcal.detect.errors import DetectError
from boxcal.detect.log.recording import Recording, open_recording
from boxcal.detect.log.signals import Quantity
from boxcal.detect.log.topics import Topics
from boxcal.detect.log.wheel_samples import JointUnit, WheelUnits
from boxcal.target.arrays import Array, Ids

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
    "duckietown_msgs/msg/WheelEncoderStamped": "std_msgs/Header header\nint32 data\nuint16 resolution\nuint8 type\n",
    "my_msgs/msg/Board": "uint32 uptime\nint64[] counts\nmy_msgs/Side right\nmy_msgs/Side left\n"
    + "=" * 80
    + "\nMSG: my_msgs/Side\nfloat32 angle\n",
}
STORE = get_typestore(Stores.ROS2_HUMBLE)
STORE1 = get_typestore(Stores.ROS1_NOETIC)
for store in (STORE, STORE1):
    for name, text in DEFINITIONS.items():
        found = get_types_from_msg(text.replace("std_msgs/Header header", "std_msgs/Header header"), name)
        store.register({k: v for k, v in found.items() if k not in store.fielddefs})

Angles = tuple[Ids, Array, Array]
Message = tuple[str, str, int, Any]
"""Topic, type, time of recording, message."""


def _angles(**how: float) -> Angles:
    t_ns, phi_R, phi_L, _ = drive(step=0, **how)  # type: ignore[arg-type]
    return t_ns, phi_R, phi_L


def _header(t_ns: int, frame: str = "", store: Any = STORE, **more: Any) -> Any:
    sec, nanosec = divmod(int(t_ns), 10**9)
    stamp = store.types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
    return store.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **more)


def _joints(
    topic: str, t_ns: int, names: list[str], positions: list[float], velocities: list[float] | None = None
) -> Message:
    kind = "sensor_msgs/msg/JointState"
    message = STORE.types[kind](
        header=_header(t_ns),
        name=names,
        position=np.array(positions, dtype=float),
        velocity=np.array(velocities or [], dtype=float),
        effort=np.zeros(0),
    )
    return topic, kind, int(t_ns) + 2_000_000, message


def _of(kind: str, topic: str, t_ns: int, *, stamped: bool = True, **fields: Any) -> Message:
    header = {"header": _header(t_ns)} if stamped else {}
    return topic, kind, int(t_ns) + (2_000_000 if stamped else 0), STORE.types[kind](**header, **fields)


def _image(topic: str, t_ns: int, encoding: str = "mono8") -> Message:
    kind, picture = "sensor_msgs/msg/Image", blank(48, 64)
    deep = encoding == "16UC1"
    message = STORE.types[kind](
        header=_header(t_ns, "camera_color_optical_frame"),
        height=48,
        width=32 if deep else 64,
        encoding=encoding,
        is_bigendian=0,
        step=64,
        data=picture.ravel(),
    )
    return topic, kind, int(t_ns) + 30_000_000, message


def _images(*topics: tuple[str, str]) -> Iterator[Message]:
    for k in range(4):
        for topic, encoding in topics or (("/camera/image_raw", "mono8"),):
            yield _image(topic, T0_NS + round((0.5 + 2 * k) * 1e9), encoding)


def _odometry(topic: str, angles: Angles, radius: float, separation: float) -> Iterator[Message]:
    t_ns, phi_R, phi_L = angles
    kind = "nav_msgs/msg/Odometry"
    s = radius * np.diff(phi_R + phi_L, prepend=phi_R[0] + phi_L[0]) / 2
    turn = radius * np.diff(phi_R - phi_L, prepend=phi_R[0] - phi_L[0]) / separation
    heading = np.cumsum(turn)
    chord = s * np.sinc(turn / (2 * np.pi))
    x, y = np.cumsum(chord * np.cos(heading - turn / 2)), np.cumsum(chord * np.sin(heading - turn / 2))
    types = STORE.types
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
            header=_header(t, "odom"),
            child_frame_id="base_footprint",
            pose=types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=np.zeros(36)),
            twist=twist,
        )
        yield topic, kind, int(t) + 2_000_000, message


def _log(path: Path, *parts: Iterator[Message]) -> Path:
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


def _check(found: Recording, angles: Angles, tick: float = 1e-9) -> None:
    """Hold the wheels to those that were driven, up to the encoder's tick."""
    t_ns, phi_R, phi_L = angles
    wheels = found.wheels
    assert len(wheels) > 0.9 * len(t_ns)
    right, left = (np.interp(wheels.t_ns - T0_NS, t_ns - T0_NS, phi) for phi in (phi_R, phi_L))
    for seen, true in ((wheels.phi_R, right), (wheels.phi_L, left)):
        assert np.max(np.abs((seen - seen[0]) - (true - true[0]))) <= 1.01 * tick + 1e-9
    assert np.all(wheels.covered)
    assert found.frame_t_ns.size == 4


def _ticks(phi: Array, turn: float, bits: int = 31) -> Ids:
    return np.mod(np.floor(phi * turn / (2 * np.pi)), 2.0**bits).astype(np.int64)


def _zeros(topic: str, angles: Angles, names: list[str]) -> Iterator[Message]:
    for t in angles[0]:
        yield _joints(topic, t, names, [0.0] * len(names))


def _wheel_ticks(angles: Angles) -> Iterator[Message]:
    t_ns, phi_R, phi_L = angles
    for t, right, left in zip(t_ns, _ticks(phi_R, 508.8), _ticks(phi_L, 508.8), strict=True):
        yield _of("irobot_create_msgs/msg/WheelTicks", "/wheel_ticks", t, ticks_left=int(left), ticks_right=int(right))


@pytest.mark.parametrize("beside", ["zero joints and odometry", "odometry", "nothing"])
def test_turtlebot4_and_create3_are_read_from_their_wheel_ticks(tmp_path: Path, beside: str) -> None:
    angles = _angles()
    parts = [_wheel_ticks(angles), _images(("/oakd/rgb/preview/image_raw", "mono8"))]
    if "odometry" in beside:
        parts.append(_odometry("/odom", angles, 0.0359, 0.233))
    if "joints" in beside:
        parts.append(_zeros("/joint_states", angles, ["left_wheel_joint", "right_wheel_joint"]))
    found = open_recording(_log(tmp_path / "tb4.mcap", *parts))
    _check(found, angles, 2 * np.pi / 508.8)
    assert found.wheels.encoder_steps == pytest.approx([2 * np.pi / 508.8] * 2, rel=1e-6)
    assert any("/joint_states never move" in note for note in found.notes) == ("joints" in beside)


@pytest.mark.parametrize(
    ("topic", "zeros"),
    [
        ("/odom", ()),
        ("/odom", ("wheel_left", "wheel_right")),
        ("/RosAria/pose", ()),
        ("/diff_drive_controller/odom", ()),
    ],
)
def test_odometry_alone_gives_the_wheels_of_its_driver(tmp_path: Path, topic: str, zeros: tuple[str, ...]) -> None:
    angles = _angles()
    parts = [_odometry(topic, angles, 0.04, 0.25), _images()]
    parts += [_odometry("/odometry/filtered", angles, 0.04, 0.25)]
    parts += [_zeros("/joint_states", angles, list(zeros))] if zeros else []
    path = _log(tmp_path / "lino.mcap", *parts)
    found = open_recording(path, nominal=(0.04, 0.25))
    _check(found, angles, 1e-6)
    assert found.quantity is Quantity.ODOMETRY
    assert any("corrections to these" in note for note in found.notes)
    unknown = open_recording(path)
    assert any("the sizes mean nothing" in note for note in unknown.notes)
    s = (unknown.wheels.phi_R + unknown.wheels.phi_L)[-1] * 0.05
    assert s == pytest.approx(0.04 * np.sum([p[-1] - p[0] for p in angles[1:]]), rel=1e-6)


def test_the_robots_description_gives_the_wheels_that_odometry_was_reckoned_with(tmp_path: Path) -> None:
    angles = _angles()
    wheel = '<link name="{0}"><collision><geometry><cylinder radius="0.04" length="1"/></geometry></collision></link>'
    joint = (
        '<joint name="{0}_wheel_joint" type="continuous"><parent link="base_link"/><child link="{0}"/>'
        '<origin xyz="0 {1} 0"/><axis xyz="0 1 0"/></joint>'
    )
    sides = (("left", 0.125), ("right", -0.125))
    body = "".join(wheel.format(s) + joint.format(s, y) for s, y in sides)
    urdf = f'<robot name="r"><link name="base_link"/>{body}</robot>'

    def description() -> Iterator[Message]:
        yield "/robot_description", "std_msgs/msg/String", T0_NS, STORE.types["std_msgs/msg/String"](data=urdf)

    found = open_recording(_log(tmp_path / "a.mcap", _odometry("/odom", angles, 0.04, 0.25), _images(), description()))
    assert found.nominal == pytest.approx((0.04, 0.25))
    _check(found, angles, 1e-6)


def test_a_duckiebots_two_encoder_topics_are_one_pair_of_wheels(tmp_path: Path) -> None:
    angles = _angles()
    kind = "duckietown_msgs/msg/WheelEncoderStamped"
    path = tmp_path / "duckie.bag"
    events: list[tuple[int, str, str, Any]] = []
    for side, phi in (("right", angles[1]), ("left", angles[2])):
        for t, ticks in zip(angles[0], _ticks(phi, 135), strict=True):
            header = _header(t, store=STORE1, seq=0)
            message = STORE1.types[kind](header=header, data=int(ticks), resolution=135, type=1)
            events.append((int(t), f"/duckie/{side}_wheel_encoder_node/tick", kind, message))
    for k in range(4):
        t = T0_NS + round((0.5 + 2 * k) * 1e9)
        image = STORE1.types["sensor_msgs/msg/Image"](
            header=_header(t, store=STORE1, seq=k),
            height=48,
            width=64,
            encoding="mono8",
            is_bigendian=0,
            step=64,
            data=blank(48, 64).ravel(),
        )
        events.append((t, "/duckie/camera_node/image", "sensor_msgs/msg/Image", image))
    with Ros1Writer(path) as bag:
        connections: dict[str, Any] = {}
        for t, topic, name, message in sorted(events, key=lambda e: e[0]):
            if topic not in connections:
                connections[topic] = bag.add_connection(topic, name, typestore=STORE1)
            bag.write(connections[topic], t, STORE1.serialize_ros1(message, name))
    _check(open_recording(path), angles, 2 * np.pi / 135)


FOUR = {
    "Husky": ["front_left_wheel_joint", "front_right_wheel_joint", "rear_left_wheel_joint", "rear_right_wheel_joint"],
    "Jackal": ["front_left_wheel", "front_right_wheel", "rear_left_wheel", "rear_right_wheel"],
    "ROSbot": ["fl_wheel_joint", "fr_wheel_joint", "rl_wheel_joint", "rr_wheel_joint"],
    "Leo": ["wheel_FL_joint", "wheel_FR_joint", "wheel_RL_joint", "wheel_RR_joint"],
    "six wheels": [f"{place}_{side}_wheel" for place in ("front", "middle", "rear") for side in ("left", "right")],
}


@pytest.mark.parametrize("robot", FOUR)
def test_the_wheels_of_a_side_are_averaged_and_said(tmp_path: Path, robot: str) -> None:
    angles = _angles()
    names = FOUR[robot]
    right = ["right" in n or n.split("_")[-2 if "FL" in names[0] else 0].lower() in {"fr", "rr"} for n in names]

    def four() -> Iterator[Message]:
        for t, phi_R, phi_L in zip(*angles, strict=True):
            yield _joints("/joint_states", t, names, [phi_R if r else phi_L for r in right])

    found = open_recording(_log(tmp_path / "a.mcap", four(), _images()))
    _check(found, angles, 1e-6)
    assert any("averaged" in note and "effective" in note for note in found.notes)


def test_two_joint_topics_and_many_cameras_need_no_options(tmp_path: Path) -> None:
    angles = _angles()

    def joints() -> Iterator[Message]:
        for k, (t, right, left) in enumerate(zip(*angles, strict=True)):
            yield _joints("/mobile_base/joint_states", t, ["wheel_left_joint", "wheel_right_joint"], [left, right])
            names = ["arm_left_1_joint", "wheel_left_joint", "head", "wheel_right_joint"]
            if k % 2 == 0:
                yield _joints("/joint_states", t, names, [0.1, left, 0.2 * k, right])

    cameras = _images(
        ("/camera/color/image_raw", "mono8"),
        ("/camera/depth/image_rect_raw", "16UC1"),
        ("/camera/aligned_depth_to_color/image_raw", "16UC1"),
        ("/camera/infra1/image_rect_raw", "mono8"),
        ("/camera/infra2/image_rect_raw", "mono8"),
        ("/camera/color/image_rect", "mono8"),
    )
    found = open_recording(_log(tmp_path / "locobot.mcap", joints(), cameras))
    _check(found, angles)
    assert found.camera_topic == "/camera/color/image_raw"
    assert found.camera_frame == "camera_color_optical_frame"


def test_kobukis_and_turtlebot3s_sensor_states_are_ticks(tmp_path: Path) -> None:
    angles = _angles(stops=8, stand=0.6)

    def kobuki() -> Iterator[Message]:
        right, left = (_ticks(phi + 155.0, 2578.33, 16) for phi in angles[1:])
        small = {"left_pwm": 0, "right_pwm": 0, "buttons": 0, "charger": 0, "battery": 0, "over_current": 0}
        lists = {
            "bottom": np.zeros(3, np.uint16),
            "current": np.zeros(2, np.uint8),
            "analog_input": np.zeros(4, np.uint16),
        }
        for t, r, left_ticks in zip(angles[0], right, left, strict=True):
            yield _of(
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

    def turtlebot3() -> Iterator[Message]:
        right, left = (_ticks(phi, 4096) for phi in angles[1:])
        for t, r, left_ticks in zip(angles[0], right, left, strict=True):
            rest = {"bumper": 0, "cliff": 0.0, "sonar": 0.0, "illumination": 0.0, "led": 0, "button": 0, "torque": True}
            yield _of(
                "turtlebot3_msgs/msg/SensorState",
                "/sensor_state",
                t,
                left_encoder=int(left_ticks),
                right_encoder=int(r),
                battery=12.0,
                **rest,
            )

    for robot, turn in ((kobuki, 2578.33), (turtlebot3, 4096.0)):
        path = _log(tmp_path / "a.mcap", robot(), _images())
        wheels = open_recording(path).wheels
        assert wheels.encoder_steps[0] == pytest.approx(2 * np.pi / turn, rel=1e-6)
        for seen, true in ((wheels.phi_R, angles[1]), (wheels.phi_L, angles[2])):
            assert np.max(np.abs((seen - seen[0]) - (true - true[0]))) < 2.1 * 2 * np.pi / turn


@pytest.mark.parametrize(
    ("kind", "right", "left"),
    [
        ("Int32", "/right_ticks", "/left_ticks"),
        ("Int64", "/encoder/right", "/encoder/left"),
        ("Int16", "/rwheel", "/lwheel"),
    ],
)
def test_bare_counters_need_the_ticks_in_a_turn(tmp_path: Path, kind: str, right: str, left: str) -> None:
    angles = _angles()

    def counters() -> Iterator[Message]:
        for topic, phi in ((right, angles[1]), (left, angles[2])):
            for t, ticks in zip(angles[0], _ticks(phi + 5, 1200), strict=True):
                yield _of(f"std_msgs/msg/{kind}", topic, t, stamped=False, data=int(ticks))

    path = _log(tmp_path / "a.mcap", counters(), _images())
    units = WheelUnits(unit=JointUnit.TICKS, ticks_per_turn=1200)
    found = open_recording(path, units=units)
    _check(found, angles, 2 * np.pi / 1200)
    assert any("carry no stamps" in note for note in found.notes)
    with pytest.raises(DetectError, match=r"whole numbers .*: encoder ticks, not radians.*--ticks-per-turn"):
        open_recording(path)


@pytest.mark.parametrize(
    ("right", "left", "tick"),
    [("/board.counts[1]", "/board.counts[0]", 2 * np.pi / 1200), ("/board.right.angle", "board.left.angle", 1e-5)],
)
def test_any_number_in_any_topic_can_be_a_wheel(tmp_path: Path, right: str, left: str, tick: float) -> None:
    angles = _angles()
    side = STORE.types["my_msgs/msg/Side"]

    def board() -> Iterator[Message]:
        for t, r, left_angle in zip(*angles, strict=True):
            counts = np.array([_ticks(np.array([p + 5]), 1200)[0] for p in (left_angle, r)])
            sides = {"right": side(angle=float(r)), "left": side(angle=float(left_angle))}
            yield _of("my_msgs/msg/Board", "/board", t, stamped=False, uptime=0, counts=counts, **sides)

    path = _log(tmp_path / "a.mcap", board(), _images())
    units = WheelUnits(unit=JointUnit.TICKS, ticks_per_turn=1200) if "counts" in right else None
    _check(open_recording(path, Topics(left_joint=left, right_joint=right), units), angles, tick)


def test_velocities_are_integrated_where_positions_stay_zero_and_said(tmp_path: Path) -> None:
    angles = _angles(rate_hz=200.0)
    speeds = [np.gradient(phi, (angles[0] - T0_NS) / 1e9) for phi in angles[1:]]

    def joints() -> Iterator[Message]:
        for t, right, left in zip(angles[0], *speeds, strict=True):
            yield _joints("/joint_states", t, [LEFT, RIGHT], [0.0, 0.0], [left, right])

    found = open_recording(_log(tmp_path / "a.mcap", joints(), _images()))
    _check(found, angles, 2e-3)
    assert found.quantity is Quantity.VELOCITY
    assert any("integrated velocities" in note for note in found.notes)


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("wheel_FL", "wheel_FR"),
        ("motor_left", "motor_right"),
        ("left_track", "right_track"),
        ("drivewhl_l_joint", "drivewhl_r_joint"),
        ("joint_left_wheel", "joint_right_wheel"),
    ],
)
def test_names_in_robots_habits_are_wheels(tmp_path: Path, left: str, right: str) -> None:
    angles = _angles()

    def joints() -> Iterator[Message]:
        for t, phi_R, phi_L in zip(*angles, strict=True):
            yield _joints(
                "/joint_states", t, ["gripper_left_finger", left, "left_arm_motor", right], [0.1, phi_L, 1.0, phi_R]
            )

    _check(open_recording(_log(tmp_path / "a.mcap", joints(), _images())), angles)


def test_wheels_without_sides_in_their_names_are_named_by_option(tmp_path: Path) -> None:
    angles = _angles()

    def joints() -> Iterator[Message]:
        for t, phi_R, phi_L in zip(*angles, strict=True):
            yield _joints("/joint_states", t, ["wheel0", "wheel1"], [phi_L, phi_R])

    path = _log(tmp_path / "a.mcap", joints(), _images())
    with pytest.raises(DetectError, match=r"no wheel joints in /joint_states \(found: wheel0, wheel1\); name them"):
        open_recording(path)
    _check(open_recording(path, Topics(left_joint="wheel0", right_joint="wheel1")), angles)


def test_two_publishers_on_one_topic_are_told_apart_and_said(tmp_path: Path) -> None:
    angles = _angles()

    def joints() -> Iterator[Message]:
        for t, phi_R, phi_L in zip(*angles, strict=True):
            yield _joints("/joint_states", t, [LEFT, RIGHT], [phi_L, phi_R])
            yield _joints("/joint_states", t + 7_000_000, [LEFT, RIGHT], [0.0, 0.0])

    found = open_recording(_log(tmp_path / "a.mcap", joints(), _images()))
    _check(found, angles)
    assert any("has two publishers" in note for note in found.notes)


def _once_a_second(angles: Angles) -> Iterator[Message]:
    for t, right, left in list(zip(*angles, strict=True))[::50]:
        yield _joints("/joint_states", t, [LEFT, RIGHT], [left, right])


CAUSES: dict[str, tuple[Callable[[Angles], Iterator[Message]], str]] = {
    "wheels never move": (lambda a: _zeros("/joint_states", a, [LEFT, RIGHT]), r"the wheels \(.*\) never move"),
    "joints at 1 Hz": (_once_a_second, r"come at 1 Hz, 3 Hz at least"),
}


@pytest.mark.parametrize("cause", CAUSES)
def test_each_cause_has_its_own_sentence(tmp_path: Path, cause: str) -> None:
    joints, sentence = CAUSES[cause]
    with pytest.raises(DetectError, match=sentence):
        open_recording(_log(tmp_path / "a.mcap", joints(_angles(stops=8)), _images()))


def test_all_problems_of_a_log_are_told_in_one_run(tmp_path: Path) -> None:
    path = _log(
        tmp_path / "a.mcap",
        _zeros("/joint_states", _angles(), [LEFT, RIGHT]),
        _images(("/a", "mono8"), ("/b", "mono8")),
    )
    with pytest.raises(DetectError, match=r"a.mcap: 2 camera topics .*; and the wheels .* never move"):
        open_recording(path)


def test_an_arms_broken_topic_harms_nothing(tmp_path: Path) -> None:
    angles = _angles()

    def joints() -> Iterator[Message]:
        for t, phi_R, phi_L in zip(*angles, strict=True):
            yield _joints("/joint_states", t, [LEFT, RIGHT], [phi_L, phi_R])
            yield _joints("/arm/joint_states", t, ["a", "b"], [1.0])

    found = open_recording(_log(tmp_path / "a.mcap", joints(), _images()))
    _check(found, angles)
    assert not found.notes
