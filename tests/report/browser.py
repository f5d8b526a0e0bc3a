"""Chromium by its DevTools protocol over two pipes: enough to open a page, look at it, and hear what it does."""

import base64
import json
import os
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self

QUIET = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
)
_WAIT_S = 60.0


class Browser:
    """One headless Chromium with one page at a time."""

    def __init__(self, chromium: str, profile: Path) -> None:
        self._command = [chromium, *QUIET, "--remote-debugging-pipe", f"--user-data-dir={profile}", "about:blank"]
        self._log = profile / "stderr.txt"
        self._number = 0
        self._events: list[dict[str, Any]] = []
        self._rest = b""
        self._session: str | None = None
        self._target: str | None = None

    def __enter__(self) -> Self:
        ours_in, theirs_out = os.pipe()
        theirs_in, ours_out = os.pipe()

        def connect() -> None:  # Chromium reads from 3 and writes to 4.
            reads, writes = os.dup(theirs_in), os.dup(theirs_out)
            os.dup2(reads, 3)
            os.dup2(writes, 4)

        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                self._command,
                stdout=log,
                stderr=log,
                preexec_fn=connect,  # noqa: PLW1509  only so can pipes get the numbers 3 and 4
                close_fds=False,
            )
        os.close(theirs_in)
        os.close(theirs_out)
        os.set_blocking(ours_in, False)
        self._in, self._out = ours_in, ours_out
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._session = None
        try:
            self.send("Browser.close")
            self._process.wait(10)
        except (OSError, TimeoutError, subprocess.TimeoutExpired):
            self._process.kill()
            self._process.wait(10)
        finally:
            os.close(self._in)
            os.close(self._out)

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send one command and return its result."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        end = time.monotonic() + _WAIT_S
        while time.monotonic() < end:
            for answer in self._read():
                if answer.get("id") == self._number:
                    if "error" in answer:
                        raise RuntimeError(f"{method}: {answer['error']}")
                    result: dict[str, Any] = answer["result"]
                    return result
                self._events.append(answer)
        raise TimeoutError(f"{method}: no answer; {self._log.read_text(errors='replace')[-500:]}")

    def _read(self) -> list[dict[str, Any]]:
        try:
            part = os.read(self._in, 1 << 20)
        except BlockingIOError:
            time.sleep(0.002)
            return []
        self._rest += part
        *whole, self._rest = self._rest.split(b"\0")
        return [json.loads(message) for message in whole]

    def open(self, path: Path | str, *, width: int = 1280, height: int = 800, dark: bool = False) -> None:
        """Open a file or an address in a new page, of this size and colour scheme; the page before is closed."""
        before, self._session = self._target, None
        self._target = self.send("Target.createTarget", url="about:blank")["targetId"]
        if before is not None:  # it would go on listening and drawing
            self.send("Target.closeTarget", targetId=before)
        self._session = self.send("Target.attachToTarget", targetId=self._target, flatten=True)["sessionId"]
        self._events.clear()
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.send(f"{domain}.enable")
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=width < 500,
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.send("Emulation.setEmulatedMedia", features=[scheme])
        begun = time.monotonic()
        self.send("Page.navigate", url=path if isinstance(path, str) else path.as_uri())
        while not any(e.get("method") == "Page.loadEventFired" for e in self._events):
            if time.monotonic() > begun + _WAIT_S:
                raise TimeoutError(f"{path} did not load")
            self._events += self._read()
        self.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")

    def evaluate(self, script: str) -> Any:
        """Run a script in the page and return its value."""
        answer = self.send("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(str(answer["exceptionDetails"]))
        return answer["result"].get("value")

    def complaints(self) -> list[str]:
        """Return what the page wrote to the console, threw, asked or was refused."""
        kinds = (
            "Runtime.consoleAPICalled",
            "Runtime.exceptionThrown",
            "Log.entryAdded",
            "Page.javascriptDialogOpening",
        )
        return [json.dumps(e["params"])[:400] for e in self._events if e.get("method") in kinds]

    def requests(self) -> list[str]:
        """Return what the page asked for, its own file and data in itself left aside."""
        sent = [e["params"]["request"]["url"] for e in self._events if e.get("method") == "Network.requestWillBeSent"]
        return [url for url in sent[1:] if not url.startswith("data:")]

    def screenshot(self, path: Path) -> bytes:
        """Write a picture of the whole page."""
        shot = self.send("Page.captureScreenshot", format="png", captureBeyondViewport=True)
        content = base64.b64decode(shot["data"])
        path.write_bytes(content)
        return content

    def pdf(self, path: Path) -> bytes:
        """Print the page."""
        content = base64.b64decode(self.send("Page.printToPDF", printBackground=False)["data"])
        path.write_bytes(content)
        return content

    def press(self, key: str) -> None:
        """Press a key, as a person would."""
        self.send("Input.dispatchKeyEvent", type="keyDown", key=key, code=key)
        self.send("Input.dispatchKeyEvent", type="keyUp", key=key, code=key)
