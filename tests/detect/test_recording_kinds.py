"""Every kind of recording gives what its MCAP twin gives, to the bit."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("foxglove_schemas_protobuf")
pytest.importorskip("mcap_ros1")
from recorded_kinds import KINDS, events, ros2_mcap

from boxcal.detect.errors import DetectError
from boxcal.detect.log.open_recording import open_recording, read_wheels
from boxcal.detect.log.opener import robot_name_of
from boxcal.detect.log.recording import Recording


def _same(found: Recording, right: Recording) -> None:
    np.testing.assert_array_equal(found.wheels.t_ns, right.wheels.t_ns)
    np.testing.assert_array_equal(found.wheels.phi_R, right.wheels.phi_R)
    np.testing.assert_array_equal(found.wheels.phi_L, right.wheels.phi_L)
    assert found.wheels.encoder_steps == right.wheels.encoder_steps
    np.testing.assert_array_equal(found.frame_t_ns, right.frame_t_ns)
    for (t, image), (t_right, image_right) in zip(
        found.read_frames(range(4)), right.read_frames(range(4)), strict=True
    ):
        assert t == t_right
        np.testing.assert_array_equal(image, image_right)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("kept", [True, False])
def test_every_kind_of_recording_gives_what_its_mcap_twin_gives(tmp_path: Path, kind: str, kept: bool) -> None:
    drive = events()
    right = open_recording(ros2_mcap(tmp_path / "twin.mcap", drive))
    path = KINDS[kind](tmp_path / "robot7", drive)
    found = open_recording(path)
    if not kept:  # the frames from their places in the recording, not from what was kept in passing
        found.source.cache.places.clear()
    _same(found, right)
    assert not found.notes
    assert found.sha256
    assert robot_name_of(path).startswith("robot7")
    np.testing.assert_array_equal(read_wheels(path).phi_R, right.wheels.phi_R)


def test_a_bag_folder_without_its_metadata_is_read_and_said(tmp_path: Path) -> None:
    path = KINDS["split sqlite3 folder"](tmp_path / "robot7", events())
    (path / "metadata.yaml").unlink()
    found = open_recording(path)
    _same(found, open_recording(ros2_mcap(tmp_path / "twin.mcap", events())))
    assert any("no whole metadata.yaml" in note for note in found.notes)


def test_a_folder_of_several_robots_recordings_is_no_bag(tmp_path: Path) -> None:
    """What the simulator writes, and what a fleet's logs look like: joined they would be one nonsensical drive."""
    whole = ros2_mcap(tmp_path / "one.mcap", events())
    folder = tmp_path / "robots"
    folder.mkdir()
    for name in ("r01.mcap", "r02.mcap", "r03.mcap"):
        (folder / name).write_bytes(whole.read_bytes())
    with pytest.raises(DetectError, match=r"robots: a folder of 3 recordings of their own .*robots/\*\.mcap"):
        open_recording(folder)


def test_a_missing_part_of_a_bag_costs_its_time_and_is_said(tmp_path: Path) -> None:
    path = KINDS["split mcap folder"](tmp_path / "robot7", events())
    (path / "robot7_1.mcap").unlink()
    found = open_recording(path)
    assert any("1 of its 2 parts are missing (robot7_1.mcap" in note for note in found.notes)
    assert found.frame_t_ns.size == 2


def test_a_bag_that_was_not_closed_is_read_without_its_index(tmp_path: Path) -> None:
    path = KINDS["ROS 1 bag"](tmp_path / "robot7", events())
    content = path.read_bytes()
    cut = tmp_path / "robot8.bag.active"
    cut.write_bytes(content[: len(content) * 2 // 3])
    found = open_recording(cut)
    assert robot_name_of(cut) == "robot8"
    assert any("truncated" in note for note in found.notes)
    right = open_recording(path)
    n = len(found.wheels)
    np.testing.assert_array_equal(found.wheels.phi_R, right.wheels.phi_R[:n])
    assert n > 100
