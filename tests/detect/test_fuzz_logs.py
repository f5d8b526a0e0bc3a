"""Fuzzing of the readers: small recordings of every kind, spoilt; kept seeds first, then as long as is asked for.

``BOXCAL_FUZZ_S=120 pytest tests/detect/test_fuzz_logs.py`` fuzzes for two minutes (some seconds without it),
from other seeds with ``BOXCAL_FUZZ_SEED=N``. What fails
prints its seed; put it into SEEDS.
"""

import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("foxglove_schemas_protobuf")
pytest.importorskip("mcap_ros1")
from recorded_kinds import KINDS, events
from small_logs import write_small

from boxcal.detect.errors import DetectError
from boxcal.detect.log.recording import open_recording

SECONDS = float(os.environ.get("BOXCAL_FUZZ_S", "6"))
FIRST = int(os.environ.get("BOXCAL_FUZZ_SEED", str(1 << 40)))
"""Where fuzzing goes on after SEEDS: the same in every run, so that a run that fails can be had again."""
SEEDS = [*range(40), 1001, 4242, 90_210, 459_720_522_620, 459_720_537_771, 459_721_185_512, 1_099_511_656_960]
"""Seeds that found something once, and some to begin with."""
_FUZZED = (
    "mcap",
    "db3 alone",
    "ROS 1 bag",
    "ROS 1 bag, lz4",
    "mcap.zst",
    "mcap.gz",
    "Foxglove protobuf, raw",
    "Foxglove JSON",
)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[str, bytes]]:
    folder, out = tmp_path_factory.mktemp("fuzz"), []
    for k, kind in enumerate(_FUZZED):
        path = write_small(folder / "a.mcap") if kind == "mcap" else KINDS[kind](folder / f"r{k}", events(3))
        out.append(("".join(path.suffixes), path.read_bytes()))
    return out


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


def _try(folder: Path, recordings: list[tuple[str, bytes]], seed: int) -> bool:
    """Read a spoilt recording; tell whether it was used. Anything but a DetectError escapes."""
    rng = np.random.default_rng(seed)
    suffix, content = recordings[int(rng.integers(len(recordings)))]
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 4))):
        if data:
            SPOIL[int(rng.integers(len(SPOIL)))](data, rng)
    path = folder / f"a{suffix}"
    path.write_bytes(bytes(data))
    try:
        recording = open_recording(path)
        list(recording.read_frames(range(min(recording.frame_t_ns.size, 5))))
    except DetectError as error:
        assert str(error).startswith(path.name), (seed, str(error))  # noqa: PT017
        return False
    except Exception as error:
        raise AssertionError(f"seed {seed}: {type(error).__name__}: {error}") from error
    return True


def test_spoilt_recordings_are_read_or_refused(tmp_path: Path, recordings: list[tuple[str, bytes]]) -> None:
    used = sum(_try(tmp_path, recordings, seed) for seed in SEEDS)
    assert 0 < used < len(SEEDS)
    begun, seed = time.monotonic(), FIRST
    while time.monotonic() < begun + SECONDS:
        _try(tmp_path, recordings, seed)
        seed += 1
