"""A session says on its page and on the terminal what is wrong, and goes on with what there is."""

import shutil
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from drives import TARGET, logged, messages, seen
from live_messages import CAMERA, T0, WHEELS, Server, advertised, data_message, heard, picture, until, wheels
from websockets.asyncio.server import ServerConnection

from boxcal.calib.calibrate import calibrate
from boxcal.calib.guide.estimate.advice import Place
from boxcal.calib.guide.outlook import GuideOptions
from boxcal.calib.guide.page.state import state_of
from boxcal.calib.guide.recording import recorder as recording
from boxcal.calib.guide.session import Session
from boxcal.calib.guide.sources.inbox import Inbox, LiveMessage
from boxcal.calib.guide.sources.link import Link
from boxcal.calib.planning.goal import Bar
from boxcal.calib.results.json_format import load_calibration
from boxcal.calib.settings import Settings
from boxcal.detect.correspondences import Correspondences
from boxcal.detect.log.containers.base import Channel
from boxcal.detect.log.topics import Topics

Started = Callable[[], "Running"]


class Running:
    """A session that works in a thread, without a source: messages are put into its inbox."""

    def __init__(self, folder: Path) -> None:
        options = GuideOptions(
            robot="r01", target=TARGET, settings=Settings(), recordings=folder / "recordings", out=folder / "out"
        )
        self.link = Link(address="ws://robot:8765", topics=Topics(), inbox=Inbox(1000.0))
        self.link.found()
        self.session = Session(options, self.link)
        self.state: dict[str, Any] = {}
        self.said: list[str] = []
        self._thread = threading.Thread(target=lambda: self.session.run(self._publish))
        self._thread.start()

    def _publish(self, session: Session) -> None:
        self.state = state_of(session)
        while session.said:
            self.said.append(session.said.popleft())

    def put(self, of: list[LiveMessage]) -> None:
        for message in of:
            self.link.inbox.put(message, now=message.log_ns / 1e9)

    def warned(self, text: str) -> bool:
        return any(text in w["text"] for w in self.state.get("warnings", []))

    def end(self) -> None:
        self.session.stopped.set()
        self._thread.join(60)
        assert not self._thread.is_alive()


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Started]:
    running: list[Running] = []

    def begin() -> Running:
        running.append(Running(tmp_path))
        return running[-1]

    yield begin
    for session in running:
        session.end()


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return logged(tmp_path_factory.mktemp("drive") / "r01.mcap", stops=5)


def _still(first: int, count: int) -> list[LiveMessage]:
    return [
        heard(WHEELS, T0 + k * 20_000_000, wheels(T0 + k * 20_000_000, 1.0, 2.0)) for k in range(first, first + count)
    ]


def _picture(t_ns: int, grey: int) -> LiveMessage:
    _, data = cv2.imencode(".jpg", np.full((480, 640), grey, dtype=np.uint8))
    return heard(CAMERA, t_ns, picture(t_ns, data.tobytes()))


@pytest.mark.slow
def test_a_drive_leads_to_bars_next_stops_a_verdict_and_a_report(log: Path, start: Started, tmp_path: Path) -> None:
    running = start()
    until(lambda: running.state and not running.session.compiling, 400)
    for message in messages(log):
        while running.link.inbox.is_full:
            threading.Event().wait(0.01)
        running.put([message])
    until(lambda: running.state.get("stops") == 5, 60)
    until(lambda: running.state["bars"], 60)
    until(lambda: running.state["plan"]["next"], 60)
    until(lambda: [s["n"] for s in running.state["plan"]["stops"]] == [1, 2, 3, 4, 5], 60)
    assert running.state["plan"]["robot"]["source"] in {"seen", "reckoned"}
    until(lambda: running.state["verdict"], 60)
    assert {"wheels", "stops", "box"} <= {topic for _, topic, _ in running.state["verdict"]["checked"]}
    running.session.request("calibrate")
    until(lambda: running.state["finished"], 60)
    assert running.state["banner"]["title"].startswith("Calibrated")
    assert (tmp_path / "out" / "r01" / "report.html").is_file()
    (recorded,) = (tmp_path / "recordings").iterdir()
    _is_what_the_recording_gives(tmp_path / "out" / "r01" / "calibration.json", recorded, tmp_path / "again")
    kept = running.session.recorder
    assert kept is not None
    kept.lost = 1
    running.session.request("calibrate")
    until(lambda: running.warned("frames on the move are not used: 1 message of the drive could not be recorded"))
    until(lambda: running.state["finished"], 60)
    notes = load_calibration(tmp_path / "out" / "r01" / "calibration.json").notes
    assert any("not from the recording: 1 message" in note for note in notes)
    assert any(line.startswith("stop 5 taken") for line in running.said)
    assert any("written" in line for line in running.said)
    running.session.request("again")
    until(lambda: running.state["stops"] == 0, 20)
    assert not running.state["finished"]
    assert len(list((tmp_path / "recordings").iterdir())) == 1, "what was recorded is kept"


def test_a_drive_that_is_heard_faster_than_time_misses_no_stop(
    log: Path, start: Started, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("boxcal.calib.guide.session._TICK_S", 1e9)  # as if no time passed
    running = start()
    until(lambda: running.state and not running.session.compiling, 400)
    for message in messages(log):
        running.put([message])
        while running.link.inbox.waiting:
            threading.Event().wait(0.0002)
    until(lambda: running.state.get("stops") == 5, 60)


def _is_what_the_recording_gives(live: Path, recorded: Path, out: Path) -> None:
    """The recording, still open, calibrated with the defaults gives the same."""
    out.mkdir()
    copy = Path(shutil.copy(recorded, out))
    found, later = load_calibration(live), calibrate(copy, TARGET)
    np.testing.assert_allclose([found.wheels.b, found.wheels.rL], [later.wheels.b, later.wheels.rL], rtol=1e-7)
    np.testing.assert_allclose(found.T_body_cam, later.T_body_cam, rtol=0, atol=1e-7)  # .001 sigma
    assert found.verdict is not None
    assert later.verdict is not None
    assert found.verdict.level == later.verdict.level


def test_pictures_of_another_camera_never_enter_a_drive(start: Started, tmp_path: Path) -> None:
    running = start()
    rear = Channel(topic="/rear/compressed", type=CAMERA.type, encoding="cdr")
    running.link.offer([WHEELS, CAMERA, rear])
    running.link.choose_camera(CAMERA.topic)
    running.link.offer([WHEELS, CAMERA, rear])
    before = running.session.progress
    running.session.request("again")
    until(lambda: running.session.progress is not before)  # else what comes now may be of the drive before
    running.put(_still(0, 10))
    until(lambda: running.session.progress.drive.wheels.heard)
    first = running.session.progress
    running.session.request("camera", rear.topic)
    until(lambda: running.session.progress is not first, 60)
    threading.Event().wait(1.1)  # recordings are named by the second
    late = _picture(T0, 100)
    running.put([late])  # it waited, or was on its way, when the other camera was named
    running.link.hand_on(late.channel, late.log_ns, late.data)
    running.link.offer([WHEELS, CAMERA, rear])
    running.link.hand_on(late.channel, late.log_ns, late.data)
    running.put([late._replace(channel=rear), *_still(10, 10)])
    until(lambda: running.session.progress.drive.pictures == 1, 20)
    until(lambda: running.state["recording"].get("messages", 0) == 11)
    assert running.session.progress.drive.newest.channel.topic == rear.topic  # type: ignore[union-attr]


def test_a_camera_that_comes_instead_of_the_drives_is_said_and_left_out(start: Started) -> None:
    running = start()
    rear = Channel(topic="/rear/compressed", type=CAMERA.type, encoding="cdr")
    running.put([_picture(T0, 100), _picture(T0 + 10**8, 100)._replace(channel=rear), *_still(0, 10)])
    until(lambda: any(f"pictures of {rear.topic} are left out" in line for line in running.said))
    assert running.session.progress.drive.pictures == 1


def test_pictures_are_all_kept_while_messages_wait(start: Started) -> None:
    """A robot that stood for long, as far as was heard, may have driven on since."""
    running = start()
    running.session.compiling = "held"
    drive = running.session.progress.drive
    running.put(_still(0, 1500))
    until(lambda: drive.stands is not None and drive.stands.seconds > 25)
    stop = drive.stands.stops[-1]  # type: ignore[union-attr]
    drive.taken.stops.append(_taken(stop.t_start_ns, stop.t_end_ns))
    session, now = running.session, T0 + 1500 * 20_000_000
    running.end()
    assert session._is_idle(now) is False
    assert session._is_idle(now) is True
    session._pending.append(_still(0, 1)[0])
    assert session._is_idle(now) is False


def test_a_disk_that_fills_is_said_on_page_and_terminal(start: Started, monkeypatch: pytest.MonkeyPatch) -> None:
    running = start()
    running.put(_still(0, 20))
    until(lambda: running.state.get("recording", {}).get("messages", 0) == 20)
    kept = running.session.recorder
    assert kept is not None

    def full(_: bytes) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(recording, "TRY_AGAIN_S", 0.1)
    monkeypatch.setattr(kept._file, "_append", full)
    running.put(_still(20, 20))
    until(lambda: running.warned("No space left on device") and running.warned("what was recorded so far is kept"))
    until(lambda: any("No space left on device" in line for line in running.said))
    monkeypatch.undo()
    running.put(_still(40, 20))
    until(lambda: running.put(_still(60, 1)) or not running.warned("No space left on device"))
    assert running.state["recording"]["lost"] >= 20


def test_a_folder_that_cannot_be_written_is_said_and_the_drive_is_guided_all_the_same(
    start: Started, tmp_path: Path
) -> None:
    (tmp_path / "recordings").write_text("a file")
    running = start()
    running.put(_still(0, 50))
    until(lambda: running.warned("nothing can be recorded there"))
    until(lambda: running.session.progress.drive.stands is not None)


def test_darkness_and_an_empty_picture_are_told_apart(start: Started) -> None:
    running = start()
    until(lambda: running.state and not running.session.compiling, 400)
    running.put([*_still(0, 60), _picture(T0 + 10**9, 8)])
    until(lambda: running.warned("too dark"))
    running.put([*_still(60, 60), _picture(T0 + 2 * 10**9, 128)])
    until(lambda: running.warned("no tag of the box") and not running.warned("too dark"))


def test_a_calibration_that_is_not_good_is_not_shown_as_done(start: Started) -> None:
    running = start()
    until(lambda: running.state and not running.session.compiling, 400)
    running.put([*_still(0, 60), _picture(T0 + 10**9, 128)])
    for level, kind in (("good", "done"), ("usable", "care"), ("redo", "bad")):
        running.session.progress.full.written = {"level": level, "headline": "So it is.", "stops": 0}
        until(lambda: running.state["banner"]["title"] == f"Calibrated: {level}")  # noqa: B023
        assert running.state["banner"]["kind"] == kind


def test_where_goals_are_reached_the_driver_waits_for_the_full_calibration(
    start: Started, monkeypatch: pytest.MonkeyPatch
) -> None:
    running = start()
    until(lambda: running.state and not running.session.compiling, 400)
    running.put([*_still(0, 60), _picture(T0 + 10**9, 128)])
    until(lambda: running.state["plan"]["next"])
    session, answers = running.session, [Future[dict[str, Any]](), Future[dict[str, Any]]()]
    none = Correspondences(robot="r01", image_size=(640, 480), wheels=seen(3).wheels, stops=())
    monkeypatch.setattr(session._solver, "judge", lambda _: answers.pop(0))
    full, better = answers
    session.progress.outlook.bars = (Bar(name="position", label="Position", unit="m", value=0.1, goal=0.2),)
    session.progress.full.judge(none)
    until(lambda: running.state["banner"]["title"] == "All goals are reached")
    assert not running.state["plan"]["next"], "wherever it were driven to meanwhile, the answer would be of other stops"
    full.set_result({"level": "usable", "headline": "Drive on.", "lines": []})
    until(lambda: running.state["plan"]["next"] and not running.state["enough"])
    session.progress.full.judge(none)
    better.set_result({"level": "good", "headline": "So it is.", "lines": []})
    until(lambda: running.state["enough"])
    assert running.state["banner"]["title"] == "Enough: calibrate"
    assert not running.state["plan"]["next"]


def test_places_planned_for_fewer_stops_are_not_shown(start: Started) -> None:
    running = start()
    running.session.compiling = "held"
    until(lambda: running.session.tasks._worker.idle)
    outlook = running.session.progress.outlook
    outlook.places, outlook.placed_after = (Place(x=1.0, y=0.0, heading=3.0),), 0
    assert running.session.progress.places
    outlook.placed_after = 1
    assert not running.session.progress.places


def test_another_camera_begins_a_new_drive_that_still_knows_the_robot(start: Started, tmp_path: Path) -> None:
    running = start()
    described = Channel(topic="/robot_description", type="std_msgs/msg/String", encoding="cdr")
    rear = Channel(topic="/rear/compressed", type=CAMERA.type, encoding="cdr")
    running.link.offer([WHEELS, CAMERA, rear])
    until(lambda: running.state.get("cameras", {}).get("all") == [CAMERA.topic, rear.topic])
    assert not running.state["cameras"]["chosen"]
    running.put([heard(described, T0, b"urdf"), *_still(0, 10)])
    until(lambda: running.session.progress.drive.wheels.heard)
    first = running.session.progress
    running.session.request("camera", "/nothing")
    running.session.request("camera", rear.topic)
    until(lambda: running.session.progress is not first, 60)
    assert running.link.topics.camera_topic == rear.topic
    threading.Event().wait(1.1)  # recordings are named by the second
    running.put(_still(10, 10))
    until(lambda: running.state["recording"].get("messages", 0) == 11)
    assert len(list((tmp_path / "recordings").iterdir())) == 2


def test_topics_that_vanish_are_said_on_the_page(start: Started) -> None:
    running = start()
    running.put(_still(0, 10))
    running.link.offer([WHEELS])
    until(lambda: running.warned("no camera topic"))
    running.link.lost("the connection was lost")
    until(lambda: running.state["banner"]["kind"] == "bad")
    assert running.state["banner"]["detail"] == "the connection was lost"
    assert "the connection was lost" in running.said
    running.link.found()
    running.link.offer([WHEELS, CAMERA])
    until(lambda: running.state["banner"]["kind"] != "bad" and not running.warned("no camera topic"))


def test_a_robot_left_standing_over_night_fills_neither_disk_nor_memory(start: Started) -> None:
    running = start()
    running.session.compiling = "held"
    drive = running.session.progress.drive
    until(lambda: not running.session.tasks._worker.name or running.session.tasks._worker.idle)
    running.put(_still(0, 1500))
    until(lambda: drive.stands is not None and drive.stands.seconds > 25)
    stop = drive.stands.stops[-1]  # type: ignore[union-attr]
    drive.taken.stops.append(_taken(stop.t_start_ns, stop.t_end_ns))
    before = drive.pictures
    now = T0 + 1500 * 20_000_000
    running.put([_picture(now + k * 10**8, 128) for k in range(600)])  # a minute of 10 Hz
    until(lambda: not running.link.inbox.is_full and drive.pictures > before)
    threading.Event().wait(0.5)
    assert drive.pictures - before <= 32


def _taken(first: int, last: int) -> Any:
    from boxcal.calib.guide.drive.taken_stops import TakenStop  # noqa: PLC0415
    from boxcal.detect.tags.averaging import combine  # noqa: PLC0415

    return TakenStop(
        t_start_ns=first, t_end_ns=last, numbers=(0,), corners=combine([]), left_out="", rejected_tags=0, camera=None
    )


def test_thirty_4k_pictures_a_second_keep_memory_flat_and_lose_no_wheel_reading(tmp_path: Path) -> None:
    """Pictures of 3840 x 2160 at 30 Hz by a bridge: what cannot be worked on is dropped, never queued."""
    from live_messages import INFO, Followed  # noqa: PLC0415

    raw = bytes(3840 * 2160)
    sent = 90

    async def talk(socket: ServerConnection) -> None:
        await socket.send(INFO)
        await socket.send(advertised(WHEELS, CAMERA))
        await socket.recv()
        for k in range(sent):
            await socket.send(data_message(2, T0 + k, raw))
            await socket.send(data_message(1, T0 + k, wheels(T0 + k, 0.0, 0.0)))
        await socket.wait_closed()

    with Server(talk, ["foxglove.websocket.v1"]) as server, Followed(server.url) as link:
        inbox = link.inbox
        until(lambda: sum(not m.picture for m in inbox._waiting) == sent, 60)
        held = sum(len(m.data) for m in inbox._waiting if m.picture)
        assert held <= 64 << 20
        assert inbox.dropped_pictures > 0
