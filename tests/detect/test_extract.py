"""From a log to correspondences, end to end on small rendered logs, and every reason to refuse one."""

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from small_logs import COMPRESSED, T0_NS, drive, jpeg, write_joints, write_log
from small_views import SIZE, TARGET, T_cam_box, true_landmarks, view

from boxcal.calib.simulate.mcap_writer import LogWriter
from boxcal.detect.alignment.compilation import prepare
from boxcal.detect.correspondences import load_correspondences
from boxcal.detect.errors import DetectError
from boxcal.detect.extract import ExtractSettings, extract, frames_at
from boxcal.detect.log.open_recording import open_recording
from boxcal.detect.log.topics import Topics
from boxcal.detect.stops import StopSettings, find_stops
from boxcal.detect.tags.averaging import FLOOR_PX
from boxcal.target.box import Box, make_target
from boxcal.target.files.target_json import target_sha256

ANGLES = (0.0, 45.0, 120.0, 300.0)
Frames = Sequence[NDArray[np.uint8]]


def _pictures(*stops: Frames, offset: float = 0.3) -> Callable[[LogWriter], None]:
    """Frames of each stop, 0.1 s apart, beginning 0.3 s after the robot came to rest."""

    def write(log: LogWriter) -> None:
        for j, frames in enumerate(stops):
            for k, image in enumerate(frames):
                t = T0_NS + round((2.0 * j + offset + 0.1 * k) * 1e9)
                log.compressed_image(COMPRESSED, t, t + 30_000_000, jpeg(image))

    return write


def _good(tmp_path: Path) -> Path:
    stops = [[view(a, seed=s) for s in range(3)] for a in ANGLES]
    return write_log(tmp_path / "robot7.mcap", write_joints, _pictures(*stops))


def test_a_small_drive_gives_what_each_stop_saw_and_what_the_wheels_did(tmp_path: Path) -> None:
    path, told = _good(tmp_path), list[tuple[str, float]]()
    prepare()  # else the first test of all is told of that, too
    found = extract(path, TARGET, progress=lambda text, share: told.append((text, share)))
    assert (found.robot, found.image_size, len(found.stops)) == ("robot7", SIZE, 4)
    assert found.source.log == "robot7.mcap"
    assert found.source.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert found.source.target_sha256 == target_sha256(TARGET)
    np.testing.assert_array_equal(found.wheels.t_ns, drive()[0])
    for stop, angle in zip(found.stops, ANGLES, strict=True):
        assert stop.frames == 3
        np.testing.assert_array_equal(stop.p_box, TARGET.p_box(stop.landmark_ids))
        seen = true_landmarks(stop.landmark_ids, T_cam_box(angle))
        off = stop.uv_px - seen
        assert len(off) > 80
        assert np.sqrt(np.mean(off**2)) < 0.1
        assert np.all(np.linalg.eigvalsh(stop.cov_px2) > FLOOR_PX**2)
    (leg_R, leg_L) = found.leg(0)
    assert leg_R[-1] - leg_R[0] == pytest.approx(5.1, abs=0.005)
    assert leg_L[-1] - leg_L[0] == pytest.approx(4.3, abs=0.005)
    assert told[0][0].startswith("stop 1 of 4: 3 frames, ")
    assert [share for _, share in told] == [0.25, 0.5, 0.75, 1.0]


def test_correspondences_come_back_from_their_file_as_they_were(tmp_path: Path) -> None:
    found = extract(_good(tmp_path), TARGET)
    found.save(tmp_path / "c.npz")
    again = load_correspondences(tmp_path / "c.npz")
    assert (again.robot, again.image_size, again.source) == (found.robot, found.image_size, found.source)
    np.testing.assert_array_equal(again.wheels.phi_L, found.wheels.phi_L)
    for a, b in zip(again.stops, found.stops, strict=True):
        for name in b.__slots__:
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"not a zip at all"])
def test_a_file_that_is_no_correspondences_is_named(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "c.npz").write_bytes(content)
    with pytest.raises(DetectError, match=r"c.npz: not a correspondence file"):
        load_correspondences(tmp_path / "c.npz")


def test_a_linear_camera_is_told_by_itself_and_can_be_named(tmp_path: Path) -> None:
    stops = [[view(a, srgb=False, seed=s) for s in range(2)] for a in ANGLES]
    path = write_log(tmp_path / "a.mcap", write_joints, _pictures(*stops))
    rms = []
    for response in (None, "linear", "srgb"):
        found = extract(path, TARGET, settings=ExtractSettings(response=response))
        off = [
            stop.uv_px - true_landmarks(stop.landmark_ids, T_cam_box(angle))
            for stop, angle in zip(found.stops, ANGLES, strict=True)
        ]
        rms.append(np.sqrt(np.mean(np.concatenate(off) ** 2)))
    # tags may start under the other curve: where they end differs by less than a hundredth of their error
    assert rms[0] == pytest.approx(rms[1], rel=0.01)
    assert rms[0] < 0.1
    assert rms[2] > 2 * rms[0]


def test_stops_without_the_box_or_without_frames_are_left_out(tmp_path: Path) -> None:
    nothing = np.full((SIZE[1], SIZE[0]), 90, dtype=np.uint8)
    stops = [[view(0.0)], [nothing], [view(120.0)], [], [view(300.0)]]
    path = write_log(tmp_path / "a.mcap", lambda log: write_joints(log, stops=5), _pictures(*stops))
    found = extract(path, TARGET)
    assert [round((s.t_start_ns - T0_NS) / 2e9) for s in found.stops] == [0, 2, 4]
    leg_R, _ = found.leg(0)
    assert leg_R[-1] - leg_R[0] == pytest.approx(2 * 5.1, abs=0.005)


def test_frames_near_a_stops_ends_are_used_only_if_there_are_no_others(tmp_path: Path) -> None:
    image = np.zeros((8, 8), dtype=np.uint8)
    path = write_log(tmp_path / "a.mcap", write_joints, _pictures([image] * 8, [image] * 3, offset=0.05))
    recording = open_recording(path)
    stops = find_stops(recording.wheels)
    assert frames_at(recording, stops[0], 0.1, 20).tolist() == [1, 2, 3, 4, 5, 6, 7]
    assert frames_at(recording, stops[0], 0.1, 3).tolist() == [2, 4, 6]
    assert frames_at(recording, stops[0], 5.0, 20).tolist() == list(range(8))
    assert frames_at(recording, stops[3], 0.1, 20).size == 0


def _nothing() -> Frames:
    return [np.full((SIZE[1], SIZE[0]), 90, dtype=np.uint8)] * 2


@pytest.mark.parametrize(
    ("stops", "message"),
    [
        (
            lambda: [[view(0.0)], [view(45.0)], _nothing()],
            r"a.mcap: 4 stops of 0.4 s or longer, 3 of them with images, 2 with the box, 2 with 4 tags or more; "
            r"3 such stops are needed; let the robot stand still",
        ),
        (
            lambda: [_nothing(), _nothing(), _nothing(), _nothing()],
            r"a.mcap: no tag of the box in the 8 images looked at at 4 stops of /camera/.*; check that the camera sees",
        ),
        (
            lambda: [[view(0.0, target=make_target(Box(first_id=200)))]] * 4,
            r"no tag of the box in the 4 images .*: tags 20\d, .* of DICT_APRILTAG_36h11 were seen, the target carries "
            r"0 to 139; give the target.json",
        ),
        (
            lambda: [[view(0.0, target=make_target(Box(dictionary="DICT_5X5_1000")))]] * 4,
            r"tags of DICT_5X5_\d+ were seen, the target carries DICT_APRILTAG_36h11; give the target.json",
        ),
        (
            lambda: [[view(0.0)], [view(0.0)[:300]]],
            r"a.mcap: 4 stops .* are needed; .*; 1 images of another size than 480 x 360 px were left out",
        ),
    ],
)
def test_a_log_that_does_not_show_the_box_is_refused_with_what_was_seen(
    tmp_path: Path, stops: Callable[[], list[Frames]], message: str
) -> None:
    with pytest.raises(DetectError, match=message):
        extract(write_log(tmp_path / "a.mcap", write_joints, _pictures(*stops())), TARGET)


def test_images_taken_only_while_driving_are_named(tmp_path: Path) -> None:
    path = write_log(tmp_path / "a.mcap", write_joints, _pictures([view(0.0)], [view(0.0)], offset=1.5))
    with pytest.raises(DetectError, match=r"a.mcap: 4 stops but no image was taken during any of them.*record the cam"):
        extract(path, TARGET)


def test_a_robot_that_never_stands_is_named(tmp_path: Path) -> None:
    path = write_log(tmp_path / "a.mcap", write_joints, _pictures([view(0.0)]))
    settings = ExtractSettings(stops=StopSettings(min_stand=5.0))
    with pytest.raises(DetectError, match=r"a.mcap: 0 stops of 5 s or longer, 0 of them with images"):
        extract(path, TARGET, settings=settings)


def test_settings_and_topics_are_checked(tmp_path: Path) -> None:
    with pytest.raises(DetectError, match=r"max_frames is 0, a number from 1 on is needed"):
        ExtractSettings(max_frames=0)
    with pytest.raises(DetectError, match=r"robot7.mcap: no camera topic /x"):
        extract(_good(tmp_path), TARGET, topics=Topics(camera_topic="/x"))
