"""A log whose chunks hold wheels or images, not both: what a recorder with a buffer a topic writes."""

from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer
from numpy.typing import NDArray
from recorded_kinds import CAMERA, IMAGE, JOINT, JOINTS, ROS2, Event, ros_message

from boxcal.target.arrays import Array, Ids

CHUNK = 24 << 10
BLOCK_NS = 3_000_000_000


def write_apart(path: Path, events: list[Event]) -> Path:
    """Write events with an index, so that most chunks are of one topic."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=CHUNK)
        writer.start(profile="ros2")
        channels = {}
        for kind, topic in ((JOINT, JOINTS), (IMAGE, CAMERA)):
            text = ROS2.generate_msgdef(kind, ros_version=2)[0].encode()
            channels[kind] = writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", text))
        ordered = sorted(events, key=lambda e: (e.t_ns // BLOCK_NS, e.picture is not None, e.t_ns))
        for event in ordered:
            kind, message = ros_message(event, ROS2)
            writer.add_message(channels[kind], event.t_ns, bytes(ROS2.serialize_cdr(message, kind)), event.t_ns)
        writer.finish()
    return path


def needed_bytes(path: Path, stands: list[tuple[int, int]]) -> int:
    """Return the bytes of the chunks with wheels and of those with images recorded while the robot stood."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    joints = {number for number, channel in summary.channels.items() if channel.topic == JOINTS}
    total = 0
    for chunk in summary.chunk_indexes:
        at_rest = any(chunk.message_start_time <= b and chunk.message_end_time >= a for a, b in stands)
        if joints & set(chunk.message_index_offsets) or at_rest:
            total += chunk.chunk_length
    return total


def with_noise(
    angles: tuple[Ids, Array, Array], pictures: list[tuple[int, NDArray[np.uint8]]]
) -> list[tuple[int, NDArray[np.uint8]]]:
    """Return a drive's pictures with two of noise a second between its stops."""
    rng = np.random.default_rng(0)
    t_ns, shown = angles[0], np.array([t for t, _ in pictures])
    moving = [t for t in range(int(t_ns[0]), int(t_ns[-1]), 500_000_000) if np.min(np.abs(shown - t)) > 700_000_000]
    return [*pictures, *((t, rng.integers(0, 256, (480, 640), dtype=np.uint8)) for t in moving)]


def filmed(
    angles: tuple[Ids, Array, Array], pictures: list[tuple[int, NDArray[np.uint8]]]
) -> list[tuple[int, NDArray[np.uint8]]]:
    """Return a drive's pictures five times a second: at its stops the same again and again, changing grey between."""
    shown, out = np.array([t for t, _ in pictures]), []
    for n, t in enumerate(range(int(angles[0][0]), int(angles[0][-1]), 200_000_000)):
        k = int(np.argmin(np.abs(shown - t)))
        still = abs(int(shown[k]) - t) < 350_000_000
        out.append((t, pictures[k][1] if still else np.full((480, 640), 40 + 67 * n % 150, dtype=np.uint8)))
    return out
