"""What is wrong with a log's pictures or clocks is put right and said, or said rightly."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from drive_session import SETTINGS, TARGET, session, solution
from robot_logs import BLANKS, STORE, Message, header, images, joints, write_mcap
from small_logs import LEFT, RIGHT, drive

from boxcal.calib.calibrate import calibrate
from boxcal.calib.check_log.check import check_log
from boxcal.calib.results.verdict import Level
from boxcal.detect.errors import DetectError
from boxcal.detect.extract import extract
from boxcal.detect.log.open_recording import open_recording

COMPRESSED = "sensor_msgs/msg/CompressedImage"


def _plain_joints() -> Iterator[Message]:
    return joints("/joint_states", session().angles, [LEFT, RIGHT])


@pytest.mark.parametrize("axis", [0, 1])
def test_mirrored_pictures_are_said_to_be_mirrored(tmp_path: Path, axis: int) -> None:
    pictures = [(t, np.ascontiguousarray(np.flip(image, axis))) for t, image in session().pictures]
    path = write_mcap(tmp_path / "a.mcap", _plain_joints(), images(pictures))
    with pytest.raises(DetectError, match=r"a.mcap: no tag .* in their mirror images: .*turn off the mirroring"):
        extract(path, TARGET)


def test_pictures_of_a_camera_that_hangs_upside_down_need_nothing(tmp_path: Path) -> None:
    pictures = [(t, np.ascontiguousarray(np.rot90(image, 2))) for t, image in session().pictures]
    found = calibrate(write_mcap(tmp_path / "a.mcap", _plain_joints(), images(pictures)), TARGET, settings=SETTINGS)
    right = calibrate(
        write_mcap(tmp_path / "b.mcap", _plain_joints(), images(session().pictures)), TARGET, settings=SETTINGS
    )
    np.testing.assert_allclose(solution(found)[:3], solution(right)[:3], rtol=1e-3)
    turned = right.T_body_cam[:3, :3] @ np.diag([-1.0, -1.0, 1.0])
    np.testing.assert_allclose(found.T_body_cam[:3, :3], turned, atol=2e-3)


def _film(offset_ns: int) -> Iterator[Message]:
    """Yield five pictures a second, stamped by a clock that is ahead: the same at a stop, another in every moment
    between; recorded when they are stamped, so that nothing else tells of the clock."""
    t_ns, phi_R, _ = session().angles
    shown = np.array([t for t, _ in session().pictures])
    for t in range(int(t_ns[0]) + 50_000_000, int(t_ns[-1]), 200_000_000):
        k = int(np.argmin(np.abs(shown - t)))
        near = [np.interp(t - t_ns[0], t_ns - t_ns[0], phi_R), np.interp(shown[k] - t_ns[0], t_ns - t_ns[0], phi_R)]
        image = session().pictures[k][1]
        if abs(near[0] - near[1]) > 1e-3:
            image = np.roll(image, 1 + round(30 * (near[0] - near[1])), axis=1)
        data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1].ravel()
        message = STORE.types[COMPRESSED](header=header(t + offset_ns, "camera"), format="jpeg", data=data)
        yield "/camera/image_raw/compressed", COMPRESSED, t + offset_ns, message


@pytest.mark.parametrize("offset_s", [1.5, -90_000.0])
def test_a_clock_that_only_the_pictures_tell_is_put_right_and_said(tmp_path: Path, offset_s: float) -> None:
    wheels = [(topic, kind, log - 2_000_000, message) for topic, kind, log, message in _plain_joints()]
    path = write_mcap(tmp_path / "a.mcap", wheels, _film(round(offset_s * 1e9)))
    found = extract(path, TARGET)
    assert found.source.clock_offset == pytest.approx(offset_s, abs=0.2)
    assert len(found.stops) == len(session().pictures)
    side = "ahead of" if offset_s > 0 else "behind"
    assert any(f"s {side} the wheels' (its pictures stand still that much apart" in n for n in found.source.notes)
    check = check_log(path, TARGET)
    assert [(f.level, side in f.text) for f in check.findings if f.topic == "clock"] == [(Level.USABLE, True)]
    assert check.drive is not None
    assert np.all([check.frame_t_ns[0] < stop.t_end_ns < check.frame_t_ns[-1] for stop in check.drive.stops[:-1]])


def test_a_stop_whose_frames_do_not_show_one_picture_is_said(tmp_path: Path) -> None:
    (t, image), *others = session().pictures
    shaken = [(t + k * 50_000_000, np.roll(image, 3 * k, axis=1)) for k in range(-1, 3)]
    found = extract(write_mcap(tmp_path / "a.mcap", _plain_joints(), images([*shaken, *others])), TARGET)
    assert [n for n in found.source.notes if "the frames of 1 stop do not show one still picture" in n]
    still = extract(write_mcap(tmp_path / "b.mcap", _plain_joints(), images(session().pictures)), TARGET)
    assert not [n for n in still.source.notes if "still picture" in n]


def test_of_two_topics_that_whose_pixels_are_distances_is_no_camera(tmp_path: Path) -> None:
    t_ns, phi_R, phi_L, _ = drive(step=0)
    wheels = joints("/joint_states", (t_ns, phi_R, phi_L), [LEFT, RIGHT])
    path = write_mcap(tmp_path / "a.mcap", wheels, images(BLANKS, ("/front/image", "16UC1"), ("/top/image", "mono8")))
    assert open_recording(path).camera_topic == "/top/image"


def test_damaged_jpegs_at_stops_say_nothing_on_the_terminal(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """libjpeg writes to the process' own stderr: held at the level of file descriptors, over a whole extraction."""
    whole = list(images(session().pictures, ("/camera/image_raw/compressed", "jpeg")))
    broken = []
    for k, (topic, kind, log, message) in enumerate(whole):
        data = message.data.copy()
        if k == 1:
            data[len(data) // 3 : len(data) // 3 + 400] = 0x55
        elif k == 2:
            data = data[: len(data) // 2]
        fields = STORE.types[COMPRESSED](header=message.header, format="jpeg", data=data)
        broken.append((topic, kind, log, fields))
    found = extract(write_mcap(tmp_path / "a.mcap", _plain_joints(), broken), TARGET)
    assert len(found.stops) >= len(whole) - 2
    assert any("left out" in note for note in found.source.notes)
    out, err = capfd.readouterr()
    assert (out, err) == ("", "")
