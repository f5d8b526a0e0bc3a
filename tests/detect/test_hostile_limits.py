"""Small files made to take all memory or time: each ends within bounds, in one clear line."""

import resource
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import zstandard

from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.mcap_records import MAGIC
from boxcal.detect.log.open_recording import open_recording

MOST_MB, MOST_SECONDS = 500, 20
_CHILD = """
import resource, sys, time
from pathlib import Path
from boxcal.detect.errors import DetectError
from boxcal.detect.extract import extract
from boxcal.target.box import make_target
begun, before = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    extract(Path(sys.argv[1]), make_target())
    print("read")
except DetectError as error:
    print(str(error)[:300].replace(chr(10), " "))
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024, time.process_time() - begun)
"""


def _record(opcode: int, body: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def _text(text: bytes) -> bytes:
    return struct.pack("<I", len(text)) + text


def _schema(number: int, name: bytes, data: bytes = b"") -> bytes:
    return _record(3, struct.pack("<H", number) + _text(name) + _text(b"ros2msg") + _text(data))


def _channel(number: int, schema: int, topic: bytes) -> bytes:
    return _record(4, struct.pack("<HH", number, schema) + _text(topic) + _text(b"cdr") + struct.pack("<I", 0))


def _message(channel: int, t_ns: int, data: bytes) -> bytes:
    return _record(5, struct.pack("<HIQQ", channel, 0, t_ns, t_ns) + data)


def _chunk(data: bytes, *, size: int | None = None, pack: bool = True) -> bytes:
    held = zstandard.compress(data) if pack else data
    head = struct.pack("<QQQI", 0, 0, len(data) if size is None else size, zlib.crc32(data) if size is None else 0)
    return _record(6, head + _text(b"zstd" if pack else b"") + struct.pack("<Q", len(held)) + held)


def _mcap(path: Path, *records: bytes) -> Path:
    path.write_bytes(MAGIC + b"".join(records) + _record(2, bytes(20)) + MAGIC)
    return path


_JOINTS = _schema(1, b"sensor_msgs/msg/JointState") + _channel(1, 1, b"/joint_states")
_IMAGES = _schema(2, b"sensor_msgs/msg/CompressedImage") + _channel(2, 2, b"/image/compressed")


def _schemas_of_400_mb(path: Path) -> Path:
    return _mcap(path, *(_chunk(_schema(k + 1, b"a/msg/B", bytes(100 << 20))) for k in range(4)))


def _long_joint_name(path: Path) -> Path:
    name = bytes(8 << 20)
    joints = (
        b"\0\1\0\0"
        + struct.pack("<iIII", 1, 0, 1, 0)
        + struct.pack("<I", 50)
        + (struct.pack("<I", len(name)) + name) * 10
    )
    return _mcap(path, *(_chunk(_JOINTS + _message(1, k, joints)) for k in range(3)))


def _empty_messages(path: Path) -> Path:
    return _mcap(path, *(_chunk(_JOINTS + _message(1, 0, b"") * 2_000_000) for _ in range(2)))


def _huge_pictures(path: Path) -> Path:
    picture = cv2.imencode(".jpg", np.zeros((4900, 5000), dtype=np.uint8))[1].tobytes()
    records = []
    for k in range(1200):
        t = k * 50_000_000
        leg, within = divmod(k / 20, 5.0)
        phi = 5 * (leg + max(within - 3, 0) / 2)
        names = b"".join(struct.pack("<I", 9) + n + b"\0\0\0\0" for n in (b"l_wheel_", b"r_wheel_"))
        head = b"\0\1\0\0" + struct.pack("<iIII", t // 10**9 + 1, t % 10**9, 0, 2)
        names = struct.pack("<I", 8) + b"l_wheel\0" + struct.pack("<I", 8) + b"r_wheel\0"
        pad = bytes(-(len(head) - 4 + len(names) + 4) % 8)
        numbers = struct.pack("<I", 2) + pad + struct.pack("<dd", phi, 0.9 * phi) + struct.pack("<II", 0, 0)
        records.append(_message(1, t, head + names + numbers))
        if within < 3 and k % 10 == 5:
            image = b"\0\1\0\0" + struct.pack("<iI", t // 10**9 + 1, t % 10**9) + struct.pack("<I", 0)
            image += struct.pack("<I", 4) + b"jpg\0" + struct.pack("<I", len(picture)) + picture
            records.append(_message(2, t, image))
    return _mcap(path, _chunk(_JOINTS + _IMAGES + b"".join(records)))


def _chunk_of_2_63(path: Path) -> Path:
    return _mcap(path, _record(6, struct.pack("<QQQII", 0, 0, 1 << 63, 0, 0) + struct.pack("<Q", 1 << 63) + b"x"))


def _bomb(path: Path) -> Path:
    worker = zstandard.ZstdCompressor()
    return _mcap(path, *(_chunk(b"", size=127 << 20)[:0] + _lying(worker) for _ in range(2)))


def _lying(worker: zstandard.ZstdCompressor) -> bytes:
    held = worker.compress(bytes(1 << 28))
    head = struct.pack("<QQQI", 0, 0, 127 << 20, 0)
    return _record(6, head + _text(b"zstd") + struct.pack("<Q", len(held)) + held)


def _packed_bomb(path: Path) -> Path:
    out = path.with_suffix(".mcap.zst")
    with out.open("wb") as file, zstandard.ZstdCompressor().stream_writer(file) as writer:
        for _ in range(12):
            writer.write(bytes(64 << 20))
    return out


HOSTILE: dict[str, Callable[[Path], Path]] = {
    "schemas of 400 MB": _schemas_of_400_mb,
    "joint names of 8 MB": _long_joint_name,
    "millions of empty messages": _empty_messages,
    "pictures of 25 Mpx": _huge_pictures,
    "a chunk of 2^63 bytes": _chunk_of_2_63,
    "chunks that unpack to more than they say": _bomb,
    "a compressed file of zeros": _packed_bomb,
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_file_takes_bounded_memory_and_time(tmp_path: Path, kind: str) -> None:
    path = HOSTILE[kind](tmp_path / "a.mcap")
    assert path.stat().st_size < 1 << 30
    done = subprocess.run(
        [sys.executable, "-c", _CHILD, str(path)], capture_output=True, text=True, timeout=300, check=True
    )
    said, figures = done.stdout.strip().splitlines()
    mb, seconds = (float(word) for word in figures.split())
    assert said.startswith(path.name), said
    assert mb < MOST_MB, (said, mb)
    assert seconds < MOST_SECONDS, (said, seconds)


def test_an_odd_path_is_no_recording(tmp_path: Path) -> None:
    for path in (Path("/dev/null"), tmp_path / "none"):
        with pytest.raises(DetectError):
            open_recording(path)
    assert resource.RLIMIT_AS
