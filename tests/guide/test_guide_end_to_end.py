"""The guide from start to "good" in a browser, following nothing but its page; then its recording calibrated again.

With ``BOXCAL_SCREENSHOTS=<folder>`` the pictures are kept there.
"""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import pytest
from browser import Browser
from live_messages import until

from boxcal.detect.log.containers.mcap import McapFile

SPEED = 6.0
"""Seconds of the robot's time in a second."""
PICTURES = 1.0
"""In a second of the robot's time: enough for a stop, and the machine has time for the rest."""
_PAGE = """(() => ({
  ...document.body.dataset, ...document.getElementById("place").dataset, state,
  title: document.getElementById("title").textContent, detail: document.getElementById("detail").textContent,
}))()"""


@dataclass
class Command:
    """A command that runs until it is ended, and what it has printed."""

    process: "subprocess.Popen[str]"
    log: Path

    def printed(self, text: str) -> str:
        """The rest of the line that holds a text, once it is there."""
        found: list[str] = []

        def there() -> bool:
            assert self.process.poll() is None, self.log.read_text()
            found[:] = [line.partition(text)[2] for line in self.log.read_text().splitlines() if text in line]
            return bool(found)

        until(there, 60)
        return found[0].strip()

    def end(self) -> None:
        self.process.terminate()
        self.process.wait(30)


def _run(log: Path, module: str, *words: str) -> Command:
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with log.open("w") as out:
        process = subprocess.Popen(
            [sys.executable, "-m", module, *words], stdout=out, stderr=out, text=True, env=environment, cwd=log.parent
        )
    return Command(process, log)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, int]]:
    """A simulated robot: the address of its topics, and the port of the page that drives it."""
    folder = tmp_path_factory.mktemp("robot")
    command = _run(
        folder / "robot.log",
        "boxcal.calib.simulate.serve.cli",
        *("--serve", "--port", "0", "--bridge-port", "0", "--speed", f"{SPEED:g}", "--rate", f"{PICTURES:g}"),
    )
    yield command.printed("topics at"), int(command.printed("drive it at").strip("/").rpartition(":")[2])
    command.end()


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    chromium = next((p for name in ("chromium", "google-chrome") if (p := shutil.which(name))), None)
    if chromium is None:
        pytest.skip("no chromium on this machine: the guide's page is not looked at")
    with Browser(chromium, tmp_path_factory.mktemp("chromium")) as opened:
        yield opened


def _send(port: int, **place: float) -> None:
    connection = HTTPConnection("127.0.0.1", port, timeout=20)
    connection.request("POST", "/go", json.dumps(place), {"X-Boxcal": "page"})
    assert connection.getresponse().read() == b'{"said":""}'
    connection.close()


def _drive_as_the_page_says(browser: Browser, port: int, shots: Path) -> list[dict[str, Any]]:
    """Drive to each next stop of the page until it says that it is enough; return the page after each stop."""
    after: list[dict[str, Any]] = []
    sent = ""
    for _ in range(6000):
        page: dict[str, Any] = browser.evaluate(_PAGE)
        stops = int(page.get("stops", 0))
        if stops > len(after):
            after.append(page)
            browser.screenshot(shots / f"stop{stops}.png")
            sent = ""
        if page.get("enough") == "true" and not sent:  # the robot may be on its way when the full solution comes
            return [*after[:-1], page]
        next_stop = page["state"]["plan"]["next"] if page["state"] else []
        if stops and next_stop and not sent and page["state"]["banner"]["kind"] in {"go", "taken"}:
            sent = page["x"]
            _send(
                port,
                x=float(page["x"]),
                y=float(page["y"]),
                heading=float(page["heading"]),
                whole_turns=int(page["turns"]),
            )
        assert stops < 20, "it is never enough"
        time.sleep(0.1)
    raise AssertionError(page)


def _messages_in(recording: Path) -> int:
    """Number of messages that a recording holds which was not finished."""
    with recording.open("rb") as file:
        return sum(len(batch.starts) for piece in McapFile(file, recording.name).batches() for batch in piece)


def _figures(calibration: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(calibration.read_text())
    kept = {k: found[k] for k in ("camera", "wheels", "T_body_cam", "sigma", "noise", "notes")}
    return kept | {"stops": len(found["stops"]), "verdict": found["verdict"]["level"]}


@pytest.mark.slow
def test_following_the_page_alone_leads_to_a_good_calibration(
    robot: tuple[str, int], browser: Browser, tmp_path: Path
) -> None:
    url, port = robot
    command = _run(tmp_path / "guide.log", "boxcal.calib.guide.cli", url, "--port", "0", "--robot", "r01")
    try:
        address = command.printed("the page is at")
        browser.open(address, width=1280, height=900)
        shots = Path(os.environ.get("BOXCAL_SCREENSHOTS", tmp_path))
        after = _drive_as_the_page_says(browser, port, shots)
        assert 5 <= len(after) <= 14
        latencies = [page["state"]["latency_ms"] for page in after]
        assert sorted(latencies)[len(latencies) // 2] < 1000, latencies
        until(lambda: browser.evaluate("state.picture.tags.length > 0"), 20)
        bars = after[-1]["state"]["bars"]
        assert all(bar["reached"] for bar in bars)
        browser.evaluate('document.getElementById("calibrate").click()')
        until(lambda: browser.evaluate("document.body.dataset.finished") == "good", 60)
        assert not browser.complaints()
        for name, width, dark in (("phone", 390, False), ("phone-dark", 390, True), ("desktop-dark", 1280, True)):
            browser.open(address, width=width, height=844, dark=dark)
            until(lambda: browser.evaluate('document.getElementById("picture").naturalWidth > 0'), 20)
            browser.screenshot(shots / f"{name}.png")
            assert browser.evaluate("document.documentElement.scrollWidth <= innerWidth")
            assert not browser.complaints()
        report = browser.evaluate('fetch("report/").then((r) => r.text())')
        assert "GOOD" in report.upper()
    finally:
        command.end()
    (recording,) = (tmp_path / "recordings").glob("r01-*.mcap")
    words = (str(recording), "--out", str(tmp_path / "again"))
    again = _run(tmp_path / "again.log", "boxcal.calib.cli", *words)
    assert again.process.wait(120) == 0, again.log.read_text()
    live, later = (
        _figures(tmp_path / "calibration/r01/calibration.json"),
        _figures(tmp_path / "again" / recording.stem / "calibration.json"),
    )
    assert live["stops"] == later["stops"] >= len(after)
    assert live["verdict"] == later["verdict"] == "good"
    assert not list((tmp_path / "recordings").glob(".*")), "the copy that was calibrated is gone"
    assert not [note for note in live["notes"] if "not from the recording" in note], (
        tmp_path / "guide.log"
    ).read_text()
    # The recording went on, so that other frames on the move may be chosen of it: two estimates from samples that
    # overlap, which differ by less than two of independent ones would.
    for name, value in later["wheels"].items():
        assert live["wheels"][name] == pytest.approx(value, abs=2.8 * later["sigma"].get(name, value * 1e-4)), (
            live["notes"],
            later["notes"],
        )


@pytest.mark.slow
def test_the_robots_page_drives_it_by_keys_and_clicks(robot: tuple[str, int], browser: Browser, tmp_path: Path) -> None:
    browser.open(f"http://127.0.0.1:{robot[1]}/", width=1000, height=800)
    until(lambda: browser.evaluate("state !== null"))

    def pose() -> tuple[float, float]:
        return tuple(browser.evaluate("[state.robot.x, state.robot.y]"))  # type: ignore[return-value]

    _send(robot[1], x=-1.2, y=-0.7, heading=0.5)
    until(lambda: abs(pose()[0] + 1.2) + abs(pose()[1] + 0.7) < 0.02 and browser.evaluate("!state.moving"), 60)
    before = pose()
    browser.send("Input.dispatchKeyEvent", type="keyDown", key="ArrowUp", code="ArrowUp")
    until(lambda: abs(pose()[0] - before[0]) + abs(pose()[1] - before[1]) > 0.05)
    browser.send("Input.dispatchKeyEvent", type="keyUp", key="ArrowUp", code="ArrowUp")
    until(lambda: browser.evaluate("!state.moving"))
    where = browser.evaluate("""(() => { const r = document.getElementById("plan").getBoundingClientRect();
        return [r.left + r.width * 0.2, r.top + r.height * 0.25]; })()""")
    for kind in ("mousePressed", "mouseReleased"):
        browser.send("Input.dispatchMouseEvent", type=kind, x=where[0], y=where[1], button="left", clickCount=1)
    until(lambda: browser.evaluate("state.moving && state.ahead.length > 0"))
    until(lambda: browser.evaluate("!state.moving"), 60)
    assert pose()[0] < -0.3
    assert pose()[1] > 0.2
    browser.screenshot(tmp_path / "robot.png")
    assert not [c for c in browser.complaints() if f":{robot[1]}/" in c]


def _faults_of(browser: Browser) -> list[list[str]]:
    """Serious faults of accessibility, as axe-core finds them."""
    browser.evaluate(Path(os.environ["BOXCAL_AXE"]).read_text(encoding="utf-8") + "; 1")
    faults: list[list[str]] = browser.evaluate(
        "axe.run(document, {resultTypes: ['violations']})"
        ".then((r) => r.violations.map((v) => [v.impact, v.id, v.nodes[0].html]))"
    )
    return [f for f in faults if f[0] in {"serious", "critical"}]


@pytest.mark.slow
@pytest.mark.skipif(
    "BOXCAL_AXE" not in os.environ, reason="axe-core is not here: see tests/report/test_report_browser.py"
)
def test_axe_finds_no_serious_fault_in_either_page(robot: tuple[str, int], browser: Browser, tmp_path: Path) -> None:
    command = _run(tmp_path / "guide.log", "boxcal.calib.guide.cli", robot[0], "--port", "0")
    try:
        address = command.printed("the page is at")
        for dark in (False, True):
            browser.open(address, dark=dark)
            until(lambda: browser.evaluate('state !== null && !document.getElementById("picture").hidden'), 60)
            assert _faults_of(browser) == []
            browser.open(f"http://127.0.0.1:{robot[1]}/", dark=dark)
            until(lambda: browser.evaluate("state !== null"))
            assert _faults_of(browser) == []
    finally:
        command.end()


@pytest.mark.slow
def test_a_page_left_open_goes_on_when_the_guide_or_the_robot_come_back(
    robot: tuple[str, int], browser: Browser, tmp_path: Path
) -> None:
    words = (robot[0], "--robot", "r02")
    command = _run(tmp_path / "guide.log", "boxcal.calib.guide.cli", *words, "--port", "0")
    address = command.printed("the page is at")
    browser.open(address)
    until(lambda: int(browser.evaluate("document.body.dataset.stops || 0")) >= 1, 60)
    (kept,) = (tmp_path / "recordings").glob("r02-*.mcap")
    killed = time.time()
    command.process.kill()
    command.process.wait(10)
    assert killed - kept.stat().st_mtime < 1.0, "all but the last second is kept"
    assert _messages_in(kept) > 50
    until(
        lambda: "does not answer" in browser.evaluate("document.title + document.getElementById('title').textContent")
    )
    port = address.strip("/").rpartition(":")[2]
    command = _run(tmp_path / "again.log", "boxcal.calib.guide.cli", *words, "--port", port)
    try:
        until(lambda: browser.evaluate("!document.body.classList.contains('gone') && state.connected"), 60)
    finally:
        command.end()
    assert "recorded" in command.log.read_text()
    assert len(list((tmp_path / "recordings").glob("r02-*.mcap"))) == 2
