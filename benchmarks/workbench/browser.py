"""Chromium, driven by its own protocol.

Playwright and Selenium have the browser report every message and exception. It then keeps a stack trace with all that
is awaited, for which a library of 4.5 MB is parsed several times: it doubles the time of a first view.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from websockets.sync.client import connect

NAMES = "chromium", "chromium-browser", "google-chrome", "chrome"
PATIENCE = 60.0
"""Seconds."""


@contextmanager
def browser() -> Iterator[Browser]:
    """Start Chromium without a window, and end it."""
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        raise SystemExit("no Chromium is installed")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        words = ["--headless", "--no-sandbox", "--remote-debugging-port=0", f"--user-data-dir={profile}"]
        process = subprocess.Popen([program, *words, "about:blank"], stderr=subprocess.PIPE, text=True)
        try:
            said = iter(process.stderr.readline, "")
            address = next(found[0] for line in said if (found := re.search(r"ws://\S+", line)))
            with connect(address, max_size=None) as socket:
                yield Browser(socket, process.pid)
        finally:
            process.terminate()
            process.wait()
            process.stderr.close()


class Browser:
    """A browser that is running."""

    def __init__(self, socket: Any, process: int) -> None:
        self.socket, self.process, self._asked = socket, process, 0

    def ask(self, method: str, window: str = "", **given: Any) -> dict[str, Any]:
        """Return the answer to one call of the protocol."""
        self._asked += 1
        message = {"id": self._asked, "method": method, "params": given}
        self.socket.send(json.dumps(message | ({"sessionId": window} if window else {})))
        while True:
            answer = json.loads(self.socket.recv(PATIENCE))
            if answer.get("id") == self._asked:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return answer["result"]

    @property
    def version(self) -> str:
        return self.ask("Browser.getVersion")["product"]

    @property
    def used(self) -> float:
        """The processor seconds of all its processes."""
        of: dict[int, list[int]] = {}
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit() and (fields := _fields(entry.name)):
                of.setdefault(int(fields[1]), []).append(int(entry.name))
        below, found = [self.process], 0.0
        while below:
            one = below.pop()
            below += of.get(one, [])
            found += used(one)
        return found

    @contextmanager
    def window(self, width: int, height: int, before: str) -> Iterator[Window]:
        """Open a window that has nothing in its cache; `before` runs in it before any page's own scripts."""
        context = self.ask("Target.createBrowserContext")["browserContextId"]
        target = self.ask("Target.createTarget", url="about:blank", browserContextId=context)["targetId"]
        window = Window(self, self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"])
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        window.ask("Emulation.setDeviceMetricsOverride", **size)
        window.ask("Page.enable")
        window.ask("Page.addScriptToEvaluateOnNewDocument", source=before)
        try:
            yield window
        finally:
            self.ask("Target.disposeBrowserContext", browserContextId=context)


class Window:
    """A window with a page."""

    def __init__(self, of: Browser, session: str) -> None:
        self.of, self.session = of, session

    def ask(self, method: str, **given: Any) -> dict[str, Any]:
        return self.of.ask(method, self.session, **given)

    def goes(self, address: str) -> None:
        """Begin to load a page."""
        self.ask("Page.navigate", url=address)

    def value(self, expression: str) -> Any:
        """Return what an expression is on the page."""
        found = self.ask("Runtime.evaluate", expression=expression, returnByValue=True)
        if "exceptionDetails" in found:
            raise RuntimeError(f"{expression}: {found['exceptionDetails']}")
        return found["result"].get("value")

    def waits(self, expression: str) -> Any:
        """Return what an expression is as soon as it is something."""
        end = time.monotonic() + PATIENCE
        while not (found := self.value(expression)):
            if time.monotonic() > end:
                raise RuntimeError(f"in vain: {expression}")
            time.sleep(0.02)
        return found

    def mouse(self, kind: str, x: float, y: float) -> None:
        """Move, press or release the mouse."""
        pressed = {"button": "left", "buttons": 1, "clickCount": 1}
        self.ask("Input.dispatchMouseEvent", type=f"mouse{kind}", x=x, y=y, **pressed)


# processor time, as the system counts it ---------------------------------------------------------------------------


def used(process: int | str) -> float:
    """Return the processor seconds of a process and of those that it has waited for; 0 where it is gone."""
    return sum(map(int, _fields(process)[11:15])) / os.sysconf("SC_CLK_TCK")


def _fields(process: int | str) -> list[str]:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return []
