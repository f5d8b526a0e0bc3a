"""One drive written as every kind of recording, by writers that are not ours where there are any."""

import base64
import gzip
import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import zstandard
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.JointState_pb2 import JointState
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import Writer as McapWriter
from mcap_protobuf.writer import Writer as ProtobufWriter
from mcap_ros1.writer import Writer as Ros1McapWriter
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore
from small_logs import CAMERA, JOINTS, LEFT, RIGHT, T0_NS, blank, drive

from boxcal.target.arrays import Array, Ids

ROS2, ROS1 = get_typestore(Stores.ROS2_HUMBLE), get_typestore(Stores.ROS1_NOETIC)
JOINT, IMAGE = "sensor_msgs/msg/JointState", "sensor_msgs/msg/Image"


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """One message of the drive: a pair of wheel angles, or a picture."""

    t_ns: int
    angles: tuple[float, float] | None = None
    picture: NDArray[np.uint8] | None = None


def events(stops: int = 4) -> list[Event]:
    """The small drive as messages in order of time."""
    t_ns, phi_R, phi_L, _ = drive(stops=stops)
    due = [T0_NS + round((0.5 + 2 * k) * 1e9) + 1 for k in range(stops)]
    return events_of((t_ns, phi_R, phi_L), [(t, blank(48, 64) + np.uint8(k)) for k, t in enumerate(due)])


def events_of(angles: tuple[Ids, Array, Array], pictures: Sequence[tuple[int, NDArray[np.uint8]]]) -> list[Event]:
    """Stamps, ns, with angles right and left, rad, and with pictures, as messages in order of time."""
    wheels = [Event(t_ns=int(t), angles=(float(r), float(left))) for t, r, left in zip(*angles, strict=True)]
    return sorted([*wheels, *(Event(t_ns=t, picture=picture) for t, picture in pictures)], key=lambda e: e.t_ns)


def ros_message(event: Event, store: Any, *, ros1: bool = False) -> tuple[str, Any]:
    sec, nanosec = divmod(event.t_ns, 10**9)
    stamp = store.types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
    extra = {"seq": 0} if ros1 else {}
    header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="camera_optical", **extra)
    if event.angles is not None:
        right, left = event.angles
        empty = np.zeros(0)
        return JOINT, store.types[JOINT](
            header=header, name=[LEFT, RIGHT], position=np.array([left, right]), velocity=empty, effort=empty
        )
    picture = event.picture
    assert picture is not None
    return IMAGE, store.types[IMAGE](
        header=header,
        height=picture.shape[0],
        width=picture.shape[1],
        encoding="mono8",
        is_bigendian=0,
        step=picture.shape[1],
        data=picture.ravel(),
    )


def ros2_folder(path: Path, drive_events: list[Event], storage: StoragePlugin, compression: str = "") -> Path:
    """A bag folder by rosbags."""
    bag = Ros2Writer(path, version=9, storage_plugin=storage)
    if compression:
        bag.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    with bag:
        connections = {k: bag.add_connection(t, k, typestore=ROS2) for t, k in ((JOINTS, JOINT), (CAMERA, IMAGE))}
        for event in drive_events:
            kind, message = ros_message(event, ROS2)
            bag.write(connections[kind], event.t_ns, ROS2.serialize_cdr(message, kind))
    return path


def split_folder(path: Path, drive_events: list[Event], storage: StoragePlugin) -> Path:
    """A bag folder of two parts, as ``ros2 bag record --max-bag-size`` makes it."""
    half = len(drive_events) // 2
    parts = [
        ros2_folder(path.with_name(f"{path.name}_{k}"), part, storage)
        for k, part in enumerate((drive_events[:half], drive_events[half:]))
    ]
    path.mkdir()
    suffix = ".db3" if storage is StoragePlugin.SQLITE3 else ".mcap"
    names: list[str] = []
    for k, part in enumerate(parts):
        (recording,) = part.glob(f"*{suffix}")
        names.append(f"{path.name}_{k}{suffix}")
        shutil.move(recording, path / names[-1])
    text = (parts[0] / "metadata.yaml").read_text()
    (old,) = (line for line in text.splitlines() if line.lstrip().startswith("- ") and line.endswith(suffix))
    indent = old[: len(old) - len(old.lstrip())]
    listed = "\n".join(f"{indent}- {name}" for name in names)
    (path / "metadata.yaml").write_text(text.replace(old, listed, 1))
    for part in parts:
        shutil.rmtree(part)
    return path


def ros1_bag(path: Path, drive_events: list[Event], compression: str = "") -> Path:
    """A ROS 1 bag by rosbags."""
    bag = Ros1Writer(path)
    if compression:
        bag.set_compression(Ros1Writer.CompressionFormat[compression.upper()])
    bag.chunk_threshold = 1 << 14
    with bag:
        connections = {k: bag.add_connection(t, k, typestore=ROS1) for t, k in ((JOINTS, JOINT), (CAMERA, IMAGE))}
        for event in drive_events:
            kind, message = ros_message(event, ROS1, ros1=True)
            bag.write(connections[kind], event.t_ns, ROS1.serialize_ros1(message, kind))
    return path


def _ros1_library_message(event: Event) -> Any:
    """Return what the mcap-ros1-support library takes for a message: its class carries type and definition."""
    kind, message = ros_message(event, ROS1, ros1=True)
    data = bytes(ROS1.serialize_ros1(message, kind))
    text = ROS1.generate_msgdef(kind)[0]
    fields = {"_type": kind.replace("/msg/", "/"), "_full_text": text, "serialize": lambda _, out: out.write(data)}
    return type("Message", (), fields)()


def ros1_mcap(path: Path, drive_events: list[Event]) -> Path:
    with path.open("wb") as file:
        writer = Ros1McapWriter(file)
        for event in drive_events:
            topic = JOINTS if event.angles is not None else CAMERA
            writer.write_message(topic, _ros1_library_message(event), event.t_ns)
        writer.finish()
    return path


def ros2_mcap(path: Path, drive_events: list[Event]) -> Path:
    """A bare MCAP by the mcap library."""
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=1 << 14)
        writer.start(profile="ros2")
        channels = {}
        for event in drive_events:
            kind, message = ros_message(event, ROS2)
            if kind not in channels:
                text = ROS2.generate_msgdef(kind, ros_version=2)[0].encode()
                schema = writer.register_schema(kind, "ros2msg", text)
                topic = JOINTS if kind == JOINT else CAMERA
                channels[kind] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channels[kind], event.t_ns, bytes(ROS2.serialize_cdr(message, kind)), event.t_ns)
        writer.finish()
    return path


def _packed(pack: Callable[[bytes], bytes], suffix: str) -> Callable[[Path, list[Event]], Path]:
    def write(path: Path, drive_events: list[Event]) -> Path:
        plain = ros2_mcap(path.with_suffix(".plain"), drive_events)
        out = path.with_name(f"{path.stem}.mcap{suffix}")
        out.write_bytes(pack(plain.read_bytes()))
        return out

    return write


def _json_joints(event: Event) -> bytes:
    assert event.angles is not None
    sec, nanosec = divmod(event.t_ns, 10**9)
    right, left = event.angles
    message = {"header": {"stamp": {"sec": sec, "nanosec": nanosec}}, "name": [RIGHT, LEFT], "position": [right, left]}
    return json.dumps(message).encode()


def foxglove_protobuf(path: Path, drive_events: list[Event], *, raw: bool = True) -> Path:
    """Pictures as Foxglove's protobuf, wheels in JSON."""
    with path.open("wb") as file, ProtobufWriter(file) as writer:
        inner = writer._writer
        schema = inner.register_schema("sensor_msgs/msg/JointState", "jsonschema", b"{}")
        joints = inner.register_channel(JOINTS, "json", schema)
        for event in drive_events:
            if event.picture is None:
                inner.add_message(joints, event.t_ns, _json_joints(event), event.t_ns)
                continue
            height, width = event.picture.shape
            stamp = Timestamp(seconds=event.t_ns // 10**9, nanos=event.t_ns % 10**9)
            if raw:
                image: Any = RawImage(
                    timestamp=stamp,
                    frame_id="camera_optical",
                    width=width,
                    height=height,
                    encoding="mono8",
                    step=width,
                    data=event.picture.tobytes(),
                )
            else:
                png = cv2.imencode(".png", event.picture)[1].tobytes()
                image = CompressedImage(timestamp=stamp, frame_id="camera_optical", data=png, format="png")
            writer.write_message(CAMERA, image, event.t_ns, event.t_ns)
    return path


def foxglove_joints(path: Path, drive_events: list[Event]) -> Path:
    """All in Foxglove's protobuf: JointStates and RawImage."""
    with path.open("wb") as file, ProtobufWriter(file) as writer:
        for event in drive_events:
            stamp = Timestamp(seconds=event.t_ns // 10**9, nanos=event.t_ns % 10**9)
            if event.angles is not None:
                joints = [JointState(name=n, position=a) for n, a in zip((RIGHT, LEFT), event.angles, strict=True)]
                writer.write_message(JOINTS, JointStates(timestamp=stamp, joints=joints), event.t_ns, event.t_ns)
            elif event.picture is not None:
                height, width = event.picture.shape
                data = event.picture.tobytes()
                image = RawImage(timestamp=stamp, width=width, height=height, encoding="mono8", step=width, data=data)
                writer.write_message(CAMERA, image, event.t_ns, event.t_ns)
    return path


def foxglove_json(path: Path, drive_events: list[Event]) -> Path:
    """All in JSON, pictures in base64."""
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        joints = writer.register_channel(
            JOINTS, "json", writer.register_schema("sensor_msgs/msg/JointState", "jsonschema", b"{}")
        )
        images = writer.register_channel(
            CAMERA, "json", writer.register_schema("foxglove.CompressedImage", "jsonschema", b"{}")
        )
        for event in drive_events:
            if event.picture is None:
                writer.add_message(joints, event.t_ns, _json_joints(event), event.t_ns)
                continue
            png = cv2.imencode(".png", event.picture)[1].tobytes()
            message = {
                "timestamp": {"sec": event.t_ns // 10**9, "nsec": event.t_ns % 10**9},
                "frame_id": "camera_optical",
                "format": "png",
                "data": base64.b64encode(png).decode(),
            }
            writer.add_message(images, event.t_ns, json.dumps(message).encode(), event.t_ns)
        writer.finish()
    return path


def plain_folder(path: Path, drive_events: list[Event], *, times_file: bool = False) -> Path:
    (path / "images").mkdir(parents=True)
    rows, times = ["stamp_ns,left,right"], ["t_ns,file"]
    for k, event in enumerate(drive_events):
        if event.angles is not None:
            rows.append(f"{event.t_ns},{event.angles[1]!r},{event.angles[0]!r}")
        elif event.picture is not None:
            name = f"{k}.png" if times_file else f"frame_{event.t_ns // 10**9}.{event.t_ns % 10**9:09d}.png"
            times.append(f"{event.t_ns},{name}")
            cv2.imwrite(str(path / "images" / name), event.picture)
    (path / "wheels.csv").write_text("\n".join(rows) + "\n")
    if times_file:
        (path / "images.csv").write_text("\n".join(times) + "\n")
    return path


KINDS: dict[str, Callable[[Path, list[Event]], Path]] = {
    "mcap folder": lambda p, e: ros2_folder(p, e, StoragePlugin.MCAP),
    "sqlite3 folder": lambda p, e: ros2_folder(p, e, StoragePlugin.SQLITE3),
    "sqlite3 folder, files compressed": lambda p, e: ros2_folder(p, e, StoragePlugin.SQLITE3, "file"),
    "sqlite3 folder, messages compressed": lambda p, e: ros2_folder(p, e, StoragePlugin.SQLITE3, "message"),
    "mcap folder, files compressed": lambda p, e: ros2_folder(p, e, StoragePlugin.MCAP, "file"),
    "split mcap folder": lambda p, e: split_folder(p, e, StoragePlugin.MCAP),
    "split sqlite3 folder": lambda p, e: split_folder(p, e, StoragePlugin.SQLITE3),
    "db3 alone": lambda p, e: next(ros2_folder(p, e, StoragePlugin.SQLITE3).glob("*.db3")),
    "mcap.zst": _packed(zstandard.compress, ".zst"),
    "mcap.gz": _packed(gzip.compress, ".gz"),
    "ROS 1 bag": lambda p, e: ros1_bag(p.with_suffix(".bag"), e),
    "ROS 1 bag, bz2": lambda p, e: ros1_bag(p.with_suffix(".bag"), e, "bz2"),
    "ROS 1 bag, lz4": lambda p, e: ros1_bag(p.with_suffix(".bag"), e, "lz4"),
    "ROS 1 in MCAP": lambda p, e: ros1_mcap(p.with_suffix(".mcap"), e),
    "Foxglove protobuf, raw": lambda p, e: foxglove_protobuf(p.with_suffix(".mcap"), e),
    "Foxglove protobuf, compressed": lambda p, e: foxglove_protobuf(p.with_suffix(".mcap"), e, raw=False),
    "Foxglove protobuf, joints": lambda p, e: foxglove_joints(p.with_suffix(".mcap"), e),
    "Foxglove JSON": lambda p, e: foxglove_json(p.with_suffix(".mcap"), e),
    "plain folder": plain_folder,
    "plain folder with times in a file": lambda p, e: plain_folder(p, e, times_file=True),
}
