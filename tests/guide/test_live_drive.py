"""A drive heard live is the drive that a reader of its recording finds."""

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drives import TARGET, in_steps, logged, messages
from live_messages import CAMERA, STORE, T0, WHEELS, heard, picture, wheels

from boxcal.calib.guide.drive.frames_at_rest import MOST_BYTES, MOST_FRAMES, FramesAtRest, HeldFrame
from boxcal.calib.guide.drive.live_drive import LiveDrive
from boxcal.calib.guide.drive.taken_stops import TakenStop, TakenStops
from boxcal.calib.guide.recording.chunked_file import ChunkedFile
from boxcal.calib.guide.sources.inbox import LiveMessage
from boxcal.calib.settings import Settings
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.extract import extract
from boxcal.detect.log.containers.base import Channel
from boxcal.detect.stops import Stop
from boxcal.detect.tags.averaging import AveragedCorners


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return logged(tmp_path_factory.mktemp("drive") / "r01.mcap")


@pytest.fixture(scope="module")
def read(log: Path) -> Correspondences:
    return extract(log, TARGET)


def _followed(of: list[LiveMessage]) -> LiveDrive:
    drive = LiveDrive("r01", TARGET, Settings())
    for piece in in_steps(of):
        drive.take(piece)
        drive.update()
        while (due := drive.to_measure()) is not None:
            drive.taken.take(*due)
    while (due := drive.to_measure(at_end=True)) is not None:
        drive.taken.take(*due)
    return drive


@pytest.mark.slow
def test_stops_measured_while_driving_are_those_of_the_recording_to_the_last_bit(
    log: Path, read: Correspondences
) -> None:
    live = _followed(messages(log)).correspondences("r01.mcap")
    assert live is not None
    assert len(live.stops) == len(read.stops) >= 4
    assert np.array_equal(live.wheels.phi_R, read.wheels.phi_R)
    for now, later in zip(live.stops, read.stops, strict=True):
        assert (now.t_start_ns, now.frames) == (later.t_start_ns, later.frames)
        assert np.array_equal(now.landmark_ids, later.landmark_ids)
        assert np.array_equal(now.uv_px, later.uv_px)
        assert np.allclose(now.cov_px2, later.cov_px2, rtol=1e-12)
    assert live.image_size == read.image_size
    assert live.source.camera_topic == read.source.camera_topic
    assert live.source.camera_frame == read.source.camera_frame
    assert live.source.wheel_topics == read.source.wheel_topics == ("/joint_states",)
    assert live.source.wheel_quantity == read.source.wheel_quantity


@pytest.mark.slow
def test_messages_late_doubled_and_out_of_order_change_nothing(log: Path, read: Correspondences) -> None:
    rng = np.random.default_rng(5)
    came = messages(log)
    late = [m._replace(log_ns=m.log_ns + int(rng.uniform(0, 2.5e8))) for m in came]
    doubled = [m for k, m in enumerate(late) for _ in range(1 + (k % 7 == 0))]
    live = _followed(sorted(doubled, key=lambda m: m.log_ns)).correspondences("r01.mcap")
    assert live is not None
    assert [s.t_start_ns for s in live.stops] == [s.t_start_ns for s in read.stops]
    for now, later in zip(live.stops, read.stops, strict=True):
        both = np.isin(now.landmark_ids, later.landmark_ids)
        assert np.mean(both) > 0.95
        again = np.isin(later.landmark_ids, now.landmark_ids)
        sigma = np.sqrt(np.trace(later.cov_px2[again], axis1=1, axis2=2))
        assert np.median(np.linalg.norm(now.uv_px[both] - later.uv_px[again], axis=1) / sigma) < 1.5


def test_a_robot_that_has_not_moved_yet_stands() -> None:
    drive = LiveDrive("r", TARGET, Settings())
    for k in range(150):
        drive.take([heard(WHEELS, T0 + k * 20_000_000, wheels(T0 + k * 20_000_000, 1.0, 2.0))])
    drive.update()
    assert drive.samples is None
    assert drive.stands is not None
    assert drive.stands.standing
    assert drive.stands.seconds == pytest.approx(2.98)
    assert drive.correspondences("r") is None


def test_pictures_that_do_not_decode_are_said_and_passed_over() -> None:
    drive = LiveDrive("r", TARGET, Settings())
    drive.take([heard(CAMERA, T0, b"\x00"), heard(CAMERA, T0, picture(T0, b"no jpeg"))])
    assert "CDR" in drive.damaged
    assert drive.newest is not None
    stop = drive.taken.take(_stop(T0, T0 + 10**9), [drive.newest])
    assert stop is None
    assert drive.taken.undecoded


def _stop(first: int, last: int) -> Stop:
    return Stop(t_start_ns=first, t_end_ns=last, first_sample=0, last_sample=1, phi_R=0.0, phi_L=0.0)


def _taken(first: int, last: int, rejected: int = 0) -> TakenStop:
    corners = AveragedCorners(
        landmark_ids=np.arange(16),
        uv_px=np.zeros((16, 2)),
        sigma_px=np.full(16, 0.05),
        cov_px2=np.tile(0.05**2 * np.eye(2), (16, 1, 1)),
        counts=np.ones(16, dtype=np.int64),
        scatter_px2=np.zeros((2, 2)),
        normalised=0.0,
        freedom=0,
        frames=1,
    )
    return TakenStop(
        t_start_ns=first,
        t_end_ns=last,
        numbers=(0,),
        corners=corners,
        left_out="",
        rejected_tags=rejected,
        camera=None,
    )


def test_tags_that_do_not_lie_where_the_box_has_them_are_counted_as_a_reader_of_the_recording_counts_them() -> None:
    taken = TakenStops(target=TARGET)
    taken.stops = [_taken(0, 10, rejected=3), _taken(20, 30)]
    assert [s.rejected_tags for s in taken.observations([_stop(0, 10), _stop(20, 30)])] == [3, 0]


def test_a_measurement_belongs_to_one_stop_and_a_stop_has_one_measurement() -> None:
    taken = TakenStops(target=TARGET)
    first, second = _taken(0, 10), _taken(20, 30)
    taken.stops = [first, second]
    both, early, late = _stop(0, 29), _stop(0, 4), _stop(5, 10)
    assert taken.matched([both]) == [(both, first)], "two stands that are one: the longer measurement"
    assert taken.matched([early, late, _stop(20, 30)])[0] == (late, first), "one that is two: the longer stand"
    assert len(taken.matched([early, late, _stop(20, 30)])) == 2
    assert taken.matched([_stop(12, 18)]) == [], "a nudge, and a longer stand after it: measured anew"
    assert taken.matched([]) == []


def test_a_long_stand_holds_few_pictures_and_little_memory() -> None:
    frames = FramesAtRest()
    data = bytes(9 << 20)
    for k in range(3000):  # five minutes of 10 Hz
        frames.add(HeldFrame(T0 + k * 10**8, k, CAMERA, data))
        assert len(frames._frames) <= MOST_FRAMES
        assert frames.size <= MOST_BYTES
    chosen = frames.of_stop(T0, T0 + 3000 * 10**8, 0.1, 20)
    numbers = [f.number for f in chosen]
    assert 5 <= len(numbers) <= 20
    assert len(set(np.diff(numbers))) == 1, "evenly spread"


def test_a_stop_is_measured_from_the_pictures_that_a_reader_would_choose() -> None:
    """As :func:`boxcal.detect.extract.frames_at`: away from the ends, every second, fourth ... of the topic's."""
    frames = FramesAtRest()
    for k in range(30):
        frames.add(HeldFrame(T0 + k * 10**8, k, CAMERA, b"x"))
    assert [f.number for f in frames.of_stop(T0, T0 + 29 * 10**8, 0.1, 20)] == list(range(2, 29, 2))
    assert [f.number for f in frames.of_stop(T0 + 5 * 10**8, T0 + 5 * 10**8, 0.1, 20)] == [5]
    assert not frames.of_stop(T0 + 10**12, T0 + 2 * 10**12, 0.1, 20)
    frames.forget_before(T0 + 25 * 10**8)
    assert [f.number for f in frames.of_stop(T0, T0 + 10**12, 0.0, 20)] == [25, 26, 27, 28, 29]


@pytest.mark.slow
def test_a_recording_of_rosbridge_messages_is_read_like_the_robots_own(
    log: Path, read: Correspondences, tmp_path: Path
) -> None:
    """JSON as rosbridge sends it, bytes in base64, kept as it came."""
    file = ChunkedFile(tmp_path / "r01.mcap")
    channels: dict[str, Channel] = {}
    for message in messages(log):
        kind = message.channel.type
        channel = channels.setdefault(
            kind, Channel(topic=message.channel.topic, type=kind, encoding="json", schema_encoding="jsonschema")
        )
        file.add(channel, message.log_ns, json.dumps(_as_json(STORE.deserialize_cdr(message.data, kind))).encode())
    file.close()
    again = extract(file.path, TARGET)
    assert len(again.stops) == len(read.stops)
    for now, before in zip(again.stops, read.stops, strict=True):
        assert np.array_equal(now.landmark_ids, before.landmark_ids)
        assert np.array_equal(now.uv_px, before.uv_px)
    assert np.array_equal(again.wheels.phi_R, read.wheels.phi_R)


def _as_json(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return base64.b64encode(value.tobytes()).decode() if value.dtype == np.uint8 else value.tolist()
    if hasattr(value, "__msgtype__"):
        return {name: _as_json(getattr(value, name)) for name in value.__dataclass_fields__ if name != "__msgtype__"}
    return [_as_json(v) for v in value] if isinstance(value, list) else value
