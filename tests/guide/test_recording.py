"""What is heard is kept: readable after a kill at any moment, and when the disk fills."""

import os
import random
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from live_messages import CAMERA, T0, WHEELS, heard, until, wheels
from mcap.reader import make_reader

from boxcal.calib.errors import CalibError
from boxcal.calib.guide.recording import recorder as recording
from boxcal.calib.guide.recording.chunked_file import ChunkedFile
from boxcal.calib.guide.recording.recorder import Recorder
from boxcal.detect.log.containers.base import Damage
from boxcal.detect.log.containers.mcap import McapFile

_KILLS = 20
_AT_ONCE = 5
_WRITER = """
import sys, time
from pathlib import Path
from boxcal.calib.guide.recording.recorder import Recorder
from boxcal.calib.guide.sources.inbox import LiveMessage
from boxcal.detect.log.containers.base import Channel
wheels, camera = (Channel(topic=t, type="a/msg/B", encoding="cdr") for t in ("/joint_states", "/camera"))
recorder = Recorder(Path(sys.argv[1]))
print("ready", flush=True)
while True:
    now = time.time_ns()
    recorder.keep(LiveMessage(wheels, now, bytes(200), False))
    recorder.keep(LiveMessage(camera, now, bytes(50_000), True))
    time.sleep(0.02)
"""


def _read(path: Path) -> tuple[list[int], Damage]:
    with path.open("rb") as file:
        found = McapFile(file, path.name)
        times = [
            t
            for piece in found.batches()
            for batch in piece
            if batch.channel.topic == WHEELS.topic
            for t in batch.log_ns.tolist()
        ]
        return times, found.damage


@pytest.mark.slow
def test_killed_at_random_moments_the_recording_holds_all_but_the_last_second(tmp_path: Path) -> None:
    rng = random.Random(int(os.environ.get("BOXCAL_KILL_SEED", "1")))
    with ThreadPoolExecutor(_AT_ONCE) as several:
        moments = [rng.uniform(0.3, 1.6) for _ in range(_KILLS)]
        lost = list(several.map(lambda k: _lost_by_kill(tmp_path / f"{k}.mcap", moments[k]), range(_KILLS)))
    assert max(lost) < 1.0, lost


def _lost_by_kill(path: Path, moment: float) -> float:
    """Time before a kill, s, of which the recording holds nothing."""
    with subprocess.Popen([sys.executable, "-c", _WRITER, str(path)], stdout=subprocess.PIPE) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == b"ready\n"
        begun = time.time_ns()
        time.sleep(moment)
        killed = time.time_ns()
        writer.send_signal(signal.SIGKILL)
    times, damage = _read(path)
    assert all("truncated" in note for note in damage.notes)
    assert times == sorted(times)
    return (killed - (times[-1] if times else begun)) / 1e9


def test_a_finished_recording_is_a_whole_mcap_with_an_index(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "new" / "r.mcap")
    for k in range(200):
        recorder.keep(heard(WHEELS, T0 + k, wheels(T0 + k, 0.0, 0.0)))
    recorder.close()
    assert recorder.messages == 200
    assert not recorder.problem
    times, damage = _read(recorder.path)
    assert times == [T0 + k for k in range(200)]
    assert not damage.notes
    with recorder.path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == 200
        assert len(list(reader.iter_messages(topics=[WHEELS.topic]))) == 200


def test_no_recording_is_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "r.mcap"
    path.write_bytes(b"mine")
    with pytest.raises(FileExistsError):
        ChunkedFile(path)
    assert path.read_bytes() == b"mine"


_FULL = """
import resource, signal, sys
sys.path.insert(0, {folder!r})
from pathlib import Path
import boxcal.calib.guide.recording.recorder as recording
from live_messages import WHEELS, T0, heard, until, wheels
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
recording.TRY_AGAIN_S = 0.2
recording.EVERY_S = 0.05
resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, resource.RLIM_INFINITY))
recorder = recording.Recorder(Path({path!r}))
noise = __import__("random").Random(1).randbytes
sent = 0
def more(count):
    global sent
    for _ in range(count):
        recorder.keep(heard(WHEELS, T0 + sent, noise(5000)))
        sent += 1
        __import__("time").sleep(0.01)
until(lambda: more(2) or recorder.problem)
print(recorder.problem, flush=True)
kept = recorder.messages
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
until(lambda: more(2) or (not recorder.problem and recorder.messages > kept))
recorder.close()
print(kept, recorder.messages, recorder.lost, sent, recorder.problem)
"""


def test_a_disk_that_fills_loses_nothing_that_was_recorded_and_recording_goes_on_when_there_is_room(
    tmp_path: Path,
) -> None:
    path = tmp_path / "full.mcap"
    code = _FULL.format(folder=str(Path(__file__).parent), path=str(path))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=100)
    problem, figures = done.stdout.splitlines()
    assert "full.mcap cannot be written" in problem
    assert "what was recorded so far is kept" in problem
    kept, messages, lost, sent = (int(n) for n in figures.split())
    assert 0 < kept < messages
    assert lost > 0
    assert messages + lost == sent
    times, damage = _read(path)
    assert len(times) == messages
    assert times[:kept] == [T0 + k for k in range(kept)]
    assert not damage.notes


def test_pictures_are_dropped_when_the_disk_cannot_follow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorder = Recorder(tmp_path / "slow.mcap")
    monkeypatch.setattr(recorder._file, "flush", lambda: time.sleep(0.3))
    frame = bytes(16 << 20)
    kept = [recorder.keep(heard(CAMERA, k, frame)) for k in range(30)]
    assert not all(kept)
    assert recorder.unkept_pictures == kept.count(False)
    assert recorder.keep(heard(WHEELS, 0, b"x")), "wheel readings are kept all the same"
    others = [recorder.keep(heard(WHEELS, k, frame)) for k in range(30)]
    assert not all(others), "but not without end"
    assert recorder.lost == others.count(False)
    monkeypatch.undo()
    recorder.close()


def test_a_copy_of_a_recording_that_misses_messages_is_refused_and_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = Recorder(tmp_path / "r.mcap")
    recorder.keep(heard(WHEELS, T0, b"x"))
    (tmp_path / "copies").mkdir()
    assert _read(recorder.copy(tmp_path / "copies")) == ([T0], Damage())

    def full(_: bytes) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(recorder._file, "_append", full)
    recorder.keep(heard(WHEELS, T0 + 1, b"y"))
    with pytest.raises(CalibError, match="No space left on device"):
        recorder.copy(tmp_path / "copies")
    assert recorder.lost == 1
    monkeypatch.undo()
    monkeypatch.setattr(recording, "TRY_AGAIN_S", 0.0)
    recorder._blocked_until = 0.0
    recorder.keep(heard(WHEELS, T0 + 2, b"z"))
    with pytest.raises(CalibError, match="1 message of the drive could not be recorded"):
        recorder.copy(tmp_path / "copies")
    with pytest.raises(CalibError, match="could not be copied"):
        recorder.copy(tmp_path / "nowhere")
    recorder.close()
    with pytest.raises(CalibError, match="was not copied within 0 s"):  # its thread has ended
        recorder.copy(tmp_path / "copies", patience_s=0.01)


def test_a_recorder_says_what_it_has_written(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "r.mcap")
    recorder.keep(heard(WHEELS, T0, b"x" * 1000))
    until(lambda: recorder.messages == 1)
    assert recorder.size == recorder.path.stat().st_size
    recorder.close()
