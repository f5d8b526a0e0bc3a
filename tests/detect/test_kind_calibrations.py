"""Every kind of recording gives the calibration that its MCAP twin gives, and a damaged one is never called good."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("foxglove_schemas_protobuf")
pytest.importorskip("mcap_ros1")
from drive_session import SETTINGS, TARGET, session, solution
from mcap.reader import make_reader
from recorded_kinds import KINDS, Event, events_of, ros2_mcap

from boxcal.calib.calibrate import calibrate
from boxcal.calib.results.calibration import Calibration


@pytest.fixture(scope="module")
def drive() -> list[Event]:
    return events_of(session().angles, session().pictures)


@pytest.fixture(scope="module")
def twin(tmp_path_factory: pytest.TempPathFactory, drive: list[Event]) -> Calibration:
    return calibrate(ros2_mcap(tmp_path_factory.mktemp("twin") / "r07.mcap", drive), TARGET, settings=SETTINGS)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_recording_gives_the_calibration_of_its_mcap_twin(
    tmp_path: Path, drive: list[Event], twin: Calibration, kind: str
) -> None:
    found = calibrate(KINDS[kind](tmp_path / "r07", drive), TARGET, settings=SETTINGS)
    np.testing.assert_allclose(solution(found), solution(twin), rtol=1e-9, atol=1e-9)
    assert found.detail is not None
    assert twin.detail is not None
    np.testing.assert_allclose(found.detail.covariance.matrix, twin.detail.covariance.matrix, rtol=1e-6)
    assert (found.robot, found.notes) == (twin.robot, twin.notes)


def test_what_a_cut_recording_lost_is_said_and_it_is_never_good(
    tmp_path: Path, drive: list[Event], twin: Calibration
) -> None:
    whole = ros2_mcap(tmp_path / "whole.mcap", drive).read_bytes()
    path = tmp_path / "r07.mcap"
    path.write_bytes(whole[: len(whole) * 9 // 10])
    found = calibrate(path, TARGET, settings=SETTINGS)
    np.testing.assert_allclose(solution(found)[:3], solution(twin)[:3], rtol=2e-3)
    assert found.verdict is not None
    assert found.verdict.level == "usable"
    assert any("recording is damaged: truncated" in reason.text for reason in found.verdict.reasons)


def test_how_much_a_damaged_chunk_cost_is_said_in_messages_and_seconds(tmp_path: Path, drive: list[Event]) -> None:
    path = ros2_mcap(tmp_path / "r07.mcap", drive)
    content = bytearray(path.read_bytes())
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    chunks = [c for c in summary.chunk_indexes if len(c.message_index_offsets) == 1]  # joints alone
    chunk = chunks[len(chunks) // 2]
    content[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 0xFF
    path.write_bytes(bytes(content))
    found = calibrate(path, TARGET, settings=SETTINGS)
    assert found.verdict is not None
    assert found.verdict.level == "usable"
    (said,) = [reason.text for reason in found.verdict.reasons if "recording is damaged" in reason.text]
    assert "messages" in said
    assert " s)" in said
