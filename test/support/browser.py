# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A headless Chromium that opens pages and sends them the input of a person.

A test that opens one is skipped where none is installed.
"""

import base64
import itertools
import json
import os
import select
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

from test.support.programs import require

TIMEOUT = 20.0  # s


class Browser:
    """One page of one headless Chromium, over the DevTools protocol on a pair of pipes.

    `problems` are console messages, exceptions and network requests so far.
    """

    def __init__(self, width: int = 1280, height: int = 900) -> None:
        chromium = require("chromium", "chromium-browser", "google-chrome")
        self.problems: list[str] = []
        self._ids = itertools.count(1)
        self._held = b""
        self._events: list[dict[str, Any]] = []
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        to_browser, self._write = os.pipe()
        self._read, from_browser = os.pipe()
        command = (
            f'exec "{chromium}" --headless --no-sandbox --disable-gpu --hide-scrollbars '
            f'--remote-debugging-pipe --user-data-dir="{self._profile.name}" --no-first-run '
            "--disable-background-networking --disable-dev-shm-usage --disable-extensions "
            f"about:blank 3<&{to_browser} 4>&{from_browser}"
        )
        self._process = subprocess.Popen(
            ["bash", "-c", command],
            pass_fds=(to_browser, from_browser),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_browser)
        os.close(from_browser)
        self._session = ""
        targets = self.send("Target.getTargets")["targetInfos"]
        [target] = [t["targetId"] for t in targets if t["type"] == "page"]
        attached = self.send("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")
        self.resize(width, height)

    def __enter__(self) -> "Browser":
        """Return the browser itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the browser."""
        self._process.terminate()
        self._process.wait(TIMEOUT)
        os.close(self._write)
        os.close(self._read)
        self._profile.cleanup()

    def open(self, page: Path, moment: str = "") -> None:
        """Load a page, at a moment such as "#t=3.2", and wait until it is drawn."""
        self.send("Page.navigate", url="about:blank")  # as only the moment may differ
        self._wait("Page.loadEventFired")
        self.send("Page.navigate", url=page.resolve().as_uri() + moment)
        self._wait("Page.loadEventFired")
        self.evaluate("window.opened")  # a promise of the page of a log
        self.settle()

    def resize(self, width: int, height: int, *, mobile: bool = False) -> None:
        """Give the page another size, in CSS pixels."""
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=mobile,
        )

    def evaluate(self, expression: str) -> Any:
        """Return what an expression of JavaScript gives in the page."""
        answer = self.send(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def settle(self) -> None:
        """Wait until the page has drawn its last changes."""
        frame = "requestAnimationFrame"
        self.evaluate(f"new Promise(done => {frame}(() => {frame}(() => {frame}(() => done()))))")

    def text(self, selector: str) -> str:
        """Return the text of an element."""
        return str(self.evaluate(f"document.querySelector({json.dumps(selector)}).textContent"))

    def place(self, selector: str, across: float = 0.5, down: float = 0.5) -> tuple[float, float]:
        """Scroll an element into view and return a point of it."""
        box = self.evaluate(
            f"(() => {{ const e = document.querySelector({json.dumps(selector)});"
            "e.scrollIntoView({block: 'center'}); const b = e.getBoundingClientRect();"
            "return [b.left, b.top, b.width, b.height]; })()"
        )
        return box[0] + across * box[2], box[1] + down * box[3]

    def mouse(self, kind: str, at: tuple[float, float], **more: Any) -> None:
        """Send mousePressed, mouseReleased, mouseMoved or mouseWheel."""
        if kind != "mouseMoved" or "buttons" in more:
            more = {"button": "left", "clickCount": 1, **more}
        self.send("Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], **more)

    def click(self, at: tuple[float, float], count: int = 1) -> None:
        """Click at a point, or double-click."""
        self.mouse("mouseMoved", at)
        for k in range(count):
            self.mouse("mousePressed", at, clickCount=k + 1)
            self.mouse("mouseReleased", at, clickCount=k + 1)
        self.settle()

    def hover(self, at: tuple[float, float]) -> None:
        """Move the mouse to a point."""
        self.mouse("mouseMoved", at)
        self.settle()

    def drag(
        self, start: tuple[float, float], end: tuple[float, float], modifiers: int = 0
    ) -> None:
        """Drag from one point to another."""
        self.mouse("mouseMoved", start, modifiers=modifiers)
        self.mouse("mousePressed", start, modifiers=modifiers)
        for share in (0.3, 0.7, 1.0):
            at = tuple(a + share * (b - a) for a, b in zip(start, end, strict=True))
            self.mouse("mouseMoved", (at[0], at[1]), buttons=1, modifiers=modifiers)
        self.mouse("mouseReleased", end, modifiers=modifiers)
        self.settle()

    def key(self, key: str, text: str = "", modifiers: int = 0) -> None:
        """Press and release a key."""
        more = {"text": text} if text else {}
        self.send("Input.dispatchKeyEvent", type="keyDown", key=key, modifiers=modifiers, **more)
        self.send("Input.dispatchKeyEvent", type="keyUp", key=key, modifiers=modifiers)
        self.settle()

    def screenshot(self, path: Path, *, whole: bool = False) -> None:
        """Write a PNG of the visible part, or of the whole page."""
        answer = self.send("Page.captureScreenshot", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(answer["data"]))

    def pdf(self, path: Path) -> None:
        """Print to a PDF of A4 pages."""
        answer = self.send(
            "Page.printToPDF", paperWidth=8.27, paperHeight=11.69, printBackground=True
        )
        path.write_bytes(base64.b64decode(answer["data"]))

    def send(self, method: str, **parameters: Any) -> Any:
        """Send a command and return its result."""
        number = next(self._ids)
        message: dict[str, Any] = {"id": number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        data, sent = json.dumps(message).encode() + b"\0", 0
        while sent < len(data):
            sent += os.write(self._write, data[sent:])
        while True:
            answer = self._message()
            if answer.get("id") == number:
                assert "error" not in answer, (method, answer["error"])
                return answer["result"]
            self._note(answer)

    def _wait(self, method: str) -> None:
        while not any(event.get("method") == method for event in self._events):
            self._note(self._message())
        self._events.clear()

    def _note(self, event: dict[str, Any]) -> None:
        self._events.append(event)
        details = event.get("params", {})
        if event.get("method") == "Runtime.exceptionThrown":
            self.problems.append(str(details["exceptionDetails"]))
        elif event.get("method") == "Runtime.consoleAPICalled":
            self.problems.append(f"console.{details['type']}: {details['args']}")
        elif event.get("method") == "Log.entryAdded":
            self.problems.append(f"{details['entry']['level']}: {details['entry']['text']}")
        elif event.get("method") == "Network.requestWillBeSent":
            url = details["request"]["url"]
            if not url.startswith(("file:", "data:", "about:")):
                self.problems.append(f"request: {url}")

    def _message(self) -> dict[str, Any]:
        deadline = time.monotonic() + TIMEOUT
        while b"\0" not in self._held:
            ready, _, _ = select.select([self._read], [], [], max(0.0, deadline - time.monotonic()))
            assert ready, f"Chromium did not answer within {TIMEOUT:g} s."
            data = os.read(self._read, 2**20)
            assert data, "Chromium has ended."
            self._held += data
        message, self._held = self._held.split(b"\0", 1)
        content: dict[str, Any] = json.loads(message)
        return content
