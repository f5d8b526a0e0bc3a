"""The whole guide killed (-9) at random moments, with a page open: what it recorded is there but for the last second.

``BOXCAL_KILLS=20`` kills it twenty times; the tests do so twice.
"""

import asyncio
import contextlib
import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from live_messages import CAMERA, INFO, WHEELS, Server, advertised, data_message, picture, until, wheels
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from boxcal.detect.log.containers.mcap import McapFile

KILLS = int(os.environ.get("BOXCAL_KILLS", "2"))
_LOST_S, _TOLD_S = 1.0, 0.1
SENT: list[int] = []
"""Times (ns) at which the robot sent something."""


async def _robot(socket: ServerConnection) -> None:
    """Send wheels at 50 Hz and pictures at 10 Hz, stamped with the present."""
    _, data = cv2.imencode(".jpg", np.random.default_rng(1).integers(0, 255, (480, 640), dtype=np.uint8))
    await socket.send(INFO)
    await socket.send(advertised(WHEELS, CAMERA))
    await socket.recv()
    with contextlib.suppress(ConnectionClosed):
        await _talk(socket, data.tobytes())


async def _talk(socket: ServerConnection, jpeg: bytes) -> None:
    for k in range(10_000):
        now = time.time_ns()
        await socket.send(data_message(1, now, wheels(now, 0.05 * k, 0.05 * k)))
        SENT.append(now)
        if k % 5 == 0:
            await socket.send(data_message(2, now, picture(now, jpeg)))
        await asyncio.sleep(0.02)


def _look_at(url: str, told: list[int]) -> None:
    """Read what a page is told, and note the times (ns) at which that came."""
    from http.client import HTTPConnection  # noqa: PLC0415

    found = re.match(r"http://([^:/]+):(\d+)", url)
    assert found is not None
    with contextlib.closing(HTTPConnection(found[1], int(found[2]), timeout=30)) as page:
        try:
            page.request("GET", "/events")
            with page.getresponse() as answer:
                while answer.readline():
                    told.append(time.time_ns())
        except OSError:
            pass  # the guide was killed


@pytest.mark.slow
def test_the_guide_killed_at_any_moment_loses_the_last_second_at_most(tmp_path: Path) -> None:
    rng = np.random.default_rng(int(os.environ.get("BOXCAL_KILLS_SEED", "4")))
    with Server(_robot, ["foxglove.sdk.v1"]) as server:
        for n in range(KILLS):
            folder = tmp_path / str(n)
            folder.mkdir()
            log = folder / "guide.log"
            words = [sys.executable, "-m", "boxcal.calib.guide.cli", server.url, "--port", "0"]
            with log.open("w") as out:
                guide = subprocess.Popen(words, stdout=out, stderr=out, cwd=folder)
            try:
                until(lambda: "connected to" in log.read_text(), 120)  # noqa: B023
                told: list[int] = [time.time_ns()]
                (url,) = re.findall(r"http://\S+", log.read_text())
                page = threading.Thread(target=_look_at, args=(url, told))
                page.start()
                until(lambda: list((folder / "recordings").glob("*.mcap")), 60)  # noqa: B023
                time.sleep(rng.uniform(0.0, 6.0))
            finally:
                killed = time.time_ns()
                guide.kill()
                guide.wait(20)
            page.join(20)
            (recording,) = (folder / "recordings").glob("*.mcap")
            with recording.open("rb") as file:
                pieces = list(McapFile(file, recording.name).batches())
            last = max((int(batch.log_ns.max()) for piece in pieces for batch in piece), default=0)
            sent = max(t for t in SENT if t <= killed)
            stalled = max((killed - told[-1]) / 1e9 - _TOLD_S, 0.0)  # of a busy machine: nothing was taken in meanwhile
            kept = last or recording.stat().st_ctime_ns
            assert (sent - kept) / 1e9 < _LOST_S + stalled, f"kill {n}"
