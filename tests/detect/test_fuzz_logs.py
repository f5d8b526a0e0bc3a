"""Fuzzing of the readers: small recordings of every kind, spoilt; kept seeds first, then as long as is asked for.

``BOXCAL_FUZZ_S=120 pytest tests/detect/test_fuzz_logs.py`` fuzzes for two minutes (some seconds without it),
from other seeds with ``BOXCAL_FUZZ_SEED=N``. What fails
prints its seed; put it into SEEDS.
"""

import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("foxglove_schemas_protobuf")
pytest.importorskip("mcap_ros1")
from mcap.writer import CompressionType, Writer
from recorded_kinds import KINDS, events
from robot_logs import BLANKS, ROBOTS, STORE, Message, images
from small_logs import drive, write_small

from boxcal.detect.errors import DetectError
from boxcal.detect.log.open_recording import open_recording

SECONDS = float(os.environ.get("BOXCAL_FUZZ_S", "6"))
FIRST = int(os.environ.get("BOXCAL_FUZZ_SEED", str(1 << 40)))
"""Where fuzzing goes on after SEEDS: the same in every run, so that a run that fails can be had again."""
SEEDS = [*range(100), 16_000_000_149]
"""What every run begins with; put in what was found to fail."""
_FUZZED = (
    "db3 alone",
    "ROS 1 bag",
    "ROS 1 bag, lz4",
    "mcap.zst",
    "mcap.gz",
    "Foxglove protobuf, raw",
    "Foxglove JSON",
    "split mcap folder",
    "sqlite3 folder, messages compressed",
    "ROS 1 in MCAP",
    "plain folder with times in a file",
)
_BARE = ("TurtleBot 4", "Int16 counters", "any message, ticks in a list", "odometry beside its driver's parameters")
"""Robots whose messages are spoilt themselves, in a file without compression or checksums."""
Files = dict[str, bytes]
"""Content by path in a folder; of a recording in one file by an empty path."""


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[str, Files]]:
    folder = tmp_path_factory.mktemp("fuzz")
    out = [(".mcap", {"": write_small(folder / "a.mcap").read_bytes()})]
    for k, kind in enumerate(_FUZZED):
        path = KINDS[kind](folder / f"r{k}", events(3))
        inside = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else []
        files = {str(p.relative_to(path)): p.read_bytes() for p in inside} or {"": path.read_bytes()}
        out.append(("" if inside else "".join(path.suffixes), files))
    t_ns, phi_R, phi_L, _ = drive(stops=3, step=0)
    for robot in _BARE:
        wheels = ROBOTS[robot].wheels((t_ns[::5], phi_R[::5], phi_L[::5]))
        content = _bare(folder / "b.mcap", [*wheels, *images(BLANKS[:3], ("/camera/image_raw/compressed", "jpeg"))])
        out.append((".mcap", {"": content}))
    return out


def _bare(path: Path, messages: list[Message]) -> bytes:
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, enable_crcs=False, chunk_size=1 << 14)
        writer.start(profile="ros2")
        channels: dict[str, int] = {}
        for topic, kind, log, message in sorted(messages, key=lambda m: m[2]):
            if topic not in channels:
                text = STORE.generate_msgdef(kind, ros_version=2)[0].encode()
                channels[topic] = writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", text))
            writer.add_message(channels[topic], log, bytes(STORE.serialize_cdr(message, kind)), log)
        writer.finish()
    return path.read_bytes()


def _bits(data: bytearray, rng: np.random.Generator) -> None:
    for at in rng.integers(0, len(data), rng.integers(1, 20)):
        data[at] ^= 1 << int(rng.integers(8))


def _bytes(data: bytearray, rng: np.random.Generator) -> None:
    at = int(rng.integers(0, len(data)))
    data[at : at + 8] = rng.integers(0, 256, 8, dtype=np.uint8).tobytes()


def _large_numbers(data: bytearray, rng: np.random.Generator) -> None:
    at = int(rng.integers(0, len(data)))
    data[at : at + 4] = [b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\0\0\x80", b"\0\0\0\0"][int(rng.integers(4))]


def _cut(data: bytearray, rng: np.random.Generator) -> None:
    del data[int(rng.integers(0, len(data))) :]


def _moved(data: bytearray, rng: np.random.Generator) -> None:
    a, b, n = int(rng.integers(len(data))), int(rng.integers(len(data))), int(rng.integers(1, 400))
    data[a:a] = data[b : b + n]


def _lost(data: bytearray, rng: np.random.Generator) -> None:
    at = int(rng.integers(len(data)))
    del data[at : at + int(rng.integers(1, 400))]


SPOIL: tuple[Callable[[bytearray, np.random.Generator], None], ...] = (
    _bits,
    _bytes,
    _large_numbers,
    _cut,
    _moved,
    _lost,
)


def _try(folder: Path, recordings: list[tuple[str, Files]], seed: int) -> bool:
    """Read a spoilt recording; tell whether it was used. Anything but a DetectError escapes."""
    rng = np.random.default_rng(seed)
    suffix, files = recordings[int(rng.integers(len(recordings)))]
    name = sorted(files)[int(rng.integers(len(files)))]
    data = bytearray(files[name])
    for _ in range(int(rng.integers(1, 4))):
        if data:
            SPOIL[int(rng.integers(len(SPOIL)))](data, rng)
    path = folder / f"a{suffix}"
    shutil.rmtree(path, ignore_errors=True)
    for other, content in files.items():
        (path / other).parent.mkdir(parents=True, exist_ok=True)
        (path / other).write_bytes(bytes(data) if other == name else content)
    try:
        recording = open_recording(path)
        list(recording.read_frames(range(min(recording.frame_t_ns.size, 5))))
    except DetectError as error:
        assert str(error).startswith(path.name), (seed, str(error))  # noqa: PT017
        return False
    except Exception as error:
        raise AssertionError(f"seed {seed}: {type(error).__name__}: {error}") from error
    return True


def test_spoilt_recordings_are_read_or_refused(tmp_path: Path, recordings: list[tuple[str, Files]]) -> None:
    used = sum(_try(tmp_path, recordings, seed) for seed in SEEDS)
    assert 0 < used < len(SEEDS)
    begun, seed = time.monotonic(), FIRST
    while time.monotonic() < begun + SECONDS:
        _try(tmp_path, recordings, seed)
        seed += 1
