"""Frames kept while a recording is read: those that will be looked at, in bounded memory."""

import numpy as np
import pytest

from boxcal.detect.log import frame_cache
from boxcal.detect.log.containers.base import Channel
from boxcal.detect.log.frame_cache import FrameCache
from boxcal.detect.log.images import ImageSeries

KIND = "sensor_msgs/msg/CompressedImage"
LOOKED_AT = 20
BYTES = 1000


def stands(cache: FrameCache, *frames: int) -> tuple[ImageSeries, list[range], list[memoryview]]:
    """Offer stands of so many frames, ten at a time, with five frames of driving behind each."""
    series = ImageSeries(channel=Channel(topic="/camera", type=KIND, encoding="cdr"), kind=KIND)
    rests = np.concatenate([np.arange(n + 5) < n for n in frames])
    data = [memoryview(bytes([k % 256]) * BYTES) for k in range(rests.size)]
    for k in range(0, rests.size, 10):
        cache.offer(series, k, data[k : k + 10], rests[k : k + 10])
    ends = np.cumsum(np.array(frames) + 5) - 5
    return series, [range(int(end) - n, int(end)) for n, end in zip(frames, ends, strict=True)], data


def looked_at(stand: range) -> list[int]:
    """Return the frames that a stop's measurement asks for, which leaves out two at each end."""
    inner = stand[2:-2]
    stride = 1
    while len(wanted := [k for k in inner if k % stride == 0]) > LOOKED_AT:
        stride *= 2
    return wanted


@pytest.mark.parametrize("memory", [1 << 24, 30 * BYTES], ids=["in memory", "in the file"])
def test_frames_that_are_looked_at_are_kept_and_not_many_more(memory: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame_cache, "_MAX_MEMORY", memory)
    cache = FrameCache()
    series, found, data = stands(cache, 5, 24, 30, 37, 70, 200, 33, 60)
    for stand in found:
        wanted = looked_at(stand)
        assert all(cache.get(series, k) == bytes(data[k]) for k in wanted)
        assert sum(cache.get(series, k) is not None for k in stand) <= 33
    in_memory = sum(length for place, length in cache.places.values() if place < 0)
    assert in_memory <= memory + 33 * BYTES
    assert (cache.read_back > 0) == (memory < 1 << 24)
    cache.close()


def test_a_disk_that_has_no_room_is_not_filled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame_cache, "_MAX_MEMORY", 0)
    monkeypatch.setattr(frame_cache, "_MAX_BYTES", 50 * BYTES)
    cache = FrameCache()
    series, found, _ = stands(cache, 30, 30, 30)
    assert len(cache.places) == 50
    assert cache.get(series, found[2][-1]) is None  # it is read from the recording again
    cache.close()
