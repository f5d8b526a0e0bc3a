"""Messages of any type as objects: ROS 2 (CDR), ROS 1, protobuf and JSON, by the definition in the recording."""

import json
import re
import struct
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore

from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.base import Channel
from boxcal.detect.log.containers.packing import message_unpacked
from boxcal.detect.log.safe_text import printable
from boxcal.detect.log.signals import LATEST_NS
from boxcal.target.arrays import Array

_NS = 1_000_000_000
_MAX_JSON_BYTES = 64 << 20
_MAX_JOINTS, _MAX_NAME = 10_000, 256
_STEP = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)|\[(\d{1,6})\]|\.?")
Decoder = Callable[[bytes], Any]

_HEADER = "std_msgs/Header header\n"
KNOWN_DEFINITIONS = {
    "irobot_create_msgs/msg/WheelTicks": f"{_HEADER}int32 ticks_left\nint32 ticks_right\n",
    "irobot_create_msgs/msg/WheelVels": f"{_HEADER}float32 velocity_left\nfloat32 velocity_right\n",
    "kobuki_ros_interfaces/msg/SensorState": (
        f"{_HEADER}uint16 time_stamp\nuint8 bumper\nuint8 wheel_drop\nuint8 cliff\nuint16 left_encoder\n"
        "uint16 right_encoder\nint8 left_pwm\nint8 right_pwm\nuint8 buttons\nuint8 charger\nuint8 battery\n"
        "uint16[] bottom\nuint8[] current\nuint8 over_current\nuint16 digital_input\nuint16[] analog_input\n"
    ),
    "turtlebot3_msgs/msg/SensorState": (
        f"{_HEADER}uint8 bumper\nfloat32 cliff\nfloat32 sonar\nfloat32 illumination\nuint8 led\nuint8 button\n"
        "bool torque\nint32 left_encoder\nint32 right_encoder\nfloat32 battery\n"
    ),
    "duckietown_msgs/msg/WheelEncoderStamped": f"{_HEADER}int32 data\nuint16 resolution\nuint8 type\n",
}
"""Encoder messages of public robots, for recordings that do not carry the definitions of their types."""


def decoder_of(channel: Channel) -> Decoder:
    """Return what turns a channel's messages into objects.

    Raises
    ------
    DetectError
        If the encoding is not known, a library for it is not installed, or the type's definition is missing or damaged.
    """
    decode = _decoder(channel.encoding, channel.type, channel.schema, channel.schema_encoding)
    return (lambda data: decode(message_unpacked(data))) if channel.packed else decode


def value_at(message: Any, path: str) -> float:
    """Return the number in a message's field, such as ``ticks_left``, ``encoders[0].count`` or ``data``.

    Raises
    ------
    DetectError
        If there is no such field or it is no number.
    """
    found, at = message, 0
    try:
        while at < len(path):
            step = _STEP.match(path, at)
            if step is None or step.end() == at:
                raise ValueError
            at = step.end()
            name, index = step.groups()
            if name is not None:
                found = found[name] if isinstance(found, dict) else getattr(found, name)
            elif index is not None:
                found = found[int(index)]
        return float(found)
    except (ValueError, TypeError, AttributeError, LookupError) as error:
        raise DetectError(f"no number in field {printable(path)} of a message; check the field's name") from error


def text_at(message: Any, name: str) -> str:
    """Return a message's text field, empty if it has none; no longer than a name is."""
    found = message.get(name, "") if isinstance(message, dict) else getattr(message, name, "")
    return str(found)[:_MAX_NAME]


def joints_of(message: Any) -> list[tuple[str, Array | None, Array | None]]:
    """Return the joints of a decoded message: name, position (1,) and velocity (1,), None where there is none.

    ROS' joint states hold lists of names and numbers, Foxglove's a list of joints.

    Raises
    ------
    DetectError
        If it is no message of joint states.
    """

    def field(of: Any, name: str) -> Any:
        return of.get(name) if isinstance(of, dict) else getattr(of, name, None)

    try:
        joints = field(message, "joints")
        if joints is not None:
            rows = [(str(field(j, "name")), field(j, "position"), field(j, "velocity")) for j in joints[:_MAX_JOINTS]]
        else:
            names = list(field(message, "name") or [])[:_MAX_JOINTS]
            both = [list(field(message, k) or []) for k in ("position", "velocity")]
            where, speeds = (n if len(n) == len(names) else [None] * len(names) for n in both)
            rows = list(zip((str(n) for n in names), where, speeds, strict=True))
        return [(name[:_MAX_NAME], _one_number(position), _one_number(speed)) for name, position, speed in rows]
    except (TypeError, ValueError, AttributeError) as error:
        raise DetectError(f"no joint states ({printable(str(error))})") from error


def _one_number(value: Any) -> Array | None:
    return None if value is None else np.array([value], dtype=np.float64)


def stamp_of(message: Any) -> int | None:
    """Return the time that a message carries, ns; None if it carries none."""
    for path in (("header", "stamp"), ("timestamp",), ("stamp",)):
        found = message
        for name in path:
            found = found.get(name) if isinstance(found, dict) else getattr(found, name, None)
        if found is None:
            continue
        if isinstance(found, dict):
            sec, nanosec = found.get("sec", found.get("secs", found.get("seconds"))), None
            nanosec = next((found[k] for k in ("nanosec", "nsec", "nsecs", "nanos", "nanoseconds") if k in found), 0)
        else:
            sec = getattr(found, "sec", getattr(found, "seconds", None))
            nanosec = getattr(found, "nanosec", getattr(found, "nanos", 0))
        if isinstance(sec, int) and isinstance(nanosec, int) and abs(sec * _NS + nanosec) < LATEST_NS:
            return sec * _NS + nanosec
    return None


def _decoder(encoding: str, kind: str, schema: bytes, language: str) -> Decoder:
    if encoding == "cdr":
        return _ros_decoder(kind, schema, language, ros1=False)
    if encoding == "ros1":
        return _ros_decoder(kind, schema, language, ros1=True)
    if encoding == "json":
        return _json_message
    if encoding == "protobuf":
        return _protobuf_decoder(kind, schema)
    raise DetectError(
        f"messages encoded as {printable(encoding) or 'nothing'} are not read; CDR, ROS 1, protobuf, JSON are"
    )


@cache
def _ros_decoder(kind: str, schema: bytes, language: str, *, ros1: bool) -> Decoder:
    """Return a decoder of a ROS type by the standard definition, or by the one that the recording carries."""
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    if kind not in store.fielddefs:
        text = schema.decode("utf-8", "replace") or KNOWN_DEFINITIONS.get(kind, "")
        if not text:
            raise DetectError(
                f"the recording has no definition of {printable(kind)}",
                remedy="record with ROS 2 Iron or newer, or in MCAP, which keep definitions",
            )
        try:
            types = get_types_from_idl(text) if language == "ros2idl" else get_types_from_msg(text, kind)
            store.register({name: fields for name, fields in types.items() if name not in store.fielddefs})
        except (TypesysError, ValueError, KeyError, AssertionError, RecursionError, SyntaxError) as error:
            raise DetectError(f"the definition of {printable(kind)} is damaged ({printable(str(error))})") from error
    read = store.deserialize_ros1 if ros1 else store.deserialize_cdr

    def decode(data: bytes) -> Any:
        try:
            return read(data, kind)
        except (SerdeError, AssertionError, ValueError, IndexError, KeyError, struct.error, MemoryError) as error:
            raise DetectError(
                f"a message does not decode as {kind} ({printable(str(error))}); the log or its schema is damaged"
            ) from error

    return decode


def _json_message(data: bytes) -> Any:
    if len(data) > _MAX_JSON_BYTES:
        raise DetectError(f"a JSON message of {len(data)} bytes, at most {_MAX_JSON_BYTES} are read")
    try:
        message = json.loads(bytes(data))
    except (ValueError, RecursionError) as error:
        raise DetectError(f"a message is no JSON ({printable(str(error))})") from error
    if not isinstance(message, dict):
        raise DetectError("a JSON message is no object")
    return message


@cache
def _protobuf_decoder(kind: str, schema: bytes) -> Decoder:
    try:
        from google.protobuf.message import (  # type: ignore[import-untyped,unused-ignore]  # noqa: PLC0415  (an extra)
            DecodeError,
        )
        from mcap.records import Schema  # noqa: PLC0415
        from mcap_protobuf.decoder import DecoderFactory  # noqa: PLC0415
    except ImportError as error:
        raise DetectError(
            "protobuf messages are read with an extra", remedy="pip install 'boxcal[foxglove]'"
        ) from error
    try:
        read = DecoderFactory().decoder_for("protobuf", Schema(id=1, name=kind, encoding="protobuf", data=schema))
    except Exception as error:  # the library lets protobuf's many errors through
        raise DetectError(f"the definition of {printable(kind)} is damaged ({printable(str(error))})") from error
    if read is None:
        raise DetectError(f"no protobuf definition of {printable(kind)}")

    def decode(data: bytes) -> Any:
        try:
            return read(bytes(data))
        except (DecodeError, ValueError) as error:
            raise DetectError(f"a message does not decode as {printable(kind)}; the log is damaged") from error

    return decode
