"""Headless Chromium, controlled over its DevTools pipe, without a port or a driver program.

Chromium reads JSON commands from file descriptor 3 and writes responses and events to 4; each ends
with a zero byte.
"""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome-stable", "google-chrome")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-dev-shm-usage",
    "--disable-sync",
    "--hide-scrollbars",
    "--remote-debugging-pipe",
)
TIMEOUT = 120.0  # s, for a response, on a machine under load


class Page:
    """One page.

    Attributes
    ----------
        problems: errors and warnings of the page and its console.
        requests: URLs that the page requested.
        events: names of the DevTools events.
    """

    def __init__(self, write: int, read: int) -> None:
        self._write, self._read = write, read
        self._number = 0
        self._session: str | None = None
        self._buffer = b""
        self.problems: list[str] = []
        self.requests: list[str] = []
        self.events: list[str] = []
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        found = self.send("Target.attachToTarget", targetId=target, flatten=True)
        self._session = found["sessionId"]
        for domain in ("Runtime", "Log", "Network", "Page"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **parameters: Any) -> Any:
        """Send a command; return its result."""
        self._number += 1
        command: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            command["sessionId"] = self._session
        os.write(self._write, json.dumps(command).encode() + b"\0")
        while True:
            message = self._receive()
            if message.get("id") == self._number:
                assert "error" not in message, f"{method}: {message['error']}"
                return message["result"]

    def open(self, path: Path, width: int = 1400, height: int = 1000, dark: bool = False) -> float:
        """Load a file; return the time until it is drawn, s, from the page's own clock."""
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.send("Emulation.setEmulatedMedia", features=scheme)
        self.events.clear()
        self.send("Page.navigate", url=path.resolve().as_uri())
        while "Page.loadEventFired" not in self.events:
            self._receive()
        drawn = "report.ready.then(() => new Promise((done) => requestAnimationFrame(() => "
        return self.run(drawn + "setTimeout(() => done(performance.now() / 1000), 0))))")

    def run(self, expression: str) -> Any:
        """Evaluate an expression in the page; return its value, of a promise the resolved one."""
        found = self.send(
            "Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait_for_drawing(self) -> None:
        """Wait until pending changes are drawn."""
        frame = "requestAnimationFrame(() => "
        self.run(f"new Promise((done) => {frame}{frame}done())))")

    def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        """Send a mouse event at a point of the window."""
        self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def screenshot(self, path: Path, whole: bool = False) -> None:
        """Save a screenshot (PNG) of the window, or of the whole page."""
        found = self.send("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(found["data"]))

    def _receive(self) -> dict[str, Any]:
        end = time.monotonic() + TIMEOUT
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._read], [], [], max(0.0, end - time.monotonic()))
            assert ready, f"no response of the browser within {TIMEOUT:g} s"
            data = os.read(self._read, 1 << 20)
            assert data, "the browser ended"
            self._buffer += data
        raw, self._buffer = self._buffer.split(b"\0", 1)
        message: dict[str, Any] = json.loads(raw)
        self._note(message.get("method", ""), message.get("params", {}))
        return message

    def _note(self, event: str, about: dict[str, Any]) -> None:
        self.events.append(event)
        if event == "Runtime.exceptionThrown":
            self.problems.append(json.dumps(about["exceptionDetails"]))
        elif event == "Runtime.consoleAPICalled" and about["type"] in ("error", "warning"):
            self.problems.append(json.dumps(about["args"]))
        elif event == "Log.entryAdded" and about["entry"]["level"] in ("error", "warning"):
            self.problems.append(about["entry"]["text"])
        elif event == "Network.requestWillBeSent":
            self.requests.append(about["request"]["url"])


def find_browser() -> str:
    """Return the path of the browser; fail with the package to install if there is none."""
    names = [os.environ["CYLCONN_BROWSER"]] if "CYLCONN_BROWSER" in os.environ else list(NAMES)
    found = [path for path in map(shutil.which, names) if path]
    assert found, (
        f"none of {', '.join(names)} is on PATH: pages are tested in a real browser "
        "(sudo apt install chromium, or name yours in CYLCONN_BROWSER)"
    )
    return found[0]


@contextmanager
def browser(directory: Path) -> Iterator[Page]:
    """Start a browser with an empty profile in ``directory``, and open a page."""
    command_read, command_write = os.pipe()
    response_read, response_write = os.pipe()

    def set_descriptors() -> None:  # runs in the child
        low, high = os.dup(command_read), os.dup(response_write)
        os.dup2(low, 3)
        os.dup2(high, 4)

    log = (directory / "browser.log").open("wb")
    process = subprocess.Popen(
        [find_browser(), *FLAGS, f"--user-data-dir={directory / 'profile'}"],
        preexec_fn=set_descriptors,
        pass_fds=(3, 4),
        stdin=subprocess.DEVNULL,
        stdout=log,
        stderr=log,
        start_new_session=True,
    )
    os.close(command_read)
    os.close(response_write)
    try:
        yield Page(command_write, response_read)
    finally:
        os.close(command_write)  # the browser ends with its pipe
        os.close(response_read)
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, 9)
            process.wait()
        log.close()
