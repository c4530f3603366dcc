"""A real Chromium without a window, by its own protocol over a pair of pipes; it needs no package and no network.

Pages are drawn by software, as on a machine without a graphics card.
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import deque
from pathlib import Path
from typing import Any, Self

import pytest

with contextlib.suppress(ModuleNotFoundError):  # Windows, where `chromium` finds none
    import fcntl

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
OPTIONS = """--headless=new --no-sandbox --no-first-run --disable-extensions --disable-background-networking --hide-scrollbars
    --enable-unsafe-swiftshader --remote-debugging-pipe""".split()


def chromium() -> str | None:
    """The program, or None where there is none, or no pipes as it wants them."""
    found = (shutil.which(name) for name in NAMES)
    return None if sys.platform == "win32" else next(filter(None, found), None)


CHROMIUM = pytest.mark.skipif(chromium() is None, reason="needs Chromium: apt install chromium")


class Browser:
    """One page in a browser of its own, as a context.

    problems: what its console and its scripts complained of; requests: addresses that it asked for, after Network.enable.
    """

    def __init__(self, width: int = 1280, height: int = 800, scale: float = 1.0, dark: bool = False, touch: bool = False):
        self.problems: list[str] = []
        self.requests: list[str] = []
        self._metrics = {"width": width, "height": height, "deviceScaleFactor": scale, "mobile": touch}
        self._dark, self._number, self._events = dark, 0, deque[dict[str, Any]]()
        self._received = b""

    def __enter__(self) -> Self:
        self._home = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        theirs, self._write = os.pipe()
        self._read, ours = os.pipe()

        def pipes():  # the browser reads commands from 3 and writes answers to 4
            kept = [fcntl.fcntl(one, fcntl.F_DUPFD, 5) for one in (theirs, ours)]  # above both, which may be free or in use
            os.dup2(kept[0], 3)
            os.dup2(kept[1], 4)

        command = [str(chromium()), *OPTIONS, f"--user-data-dir={self._home.name}", "about:blank"]
        quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self._process = subprocess.Popen(command, preexec_fn=pipes, close_fds=False, start_new_session=True, **quiet)
        os.close(theirs)
        os.close(ours)
        self._session = None
        targets = self.call("Target.getTargets")["targetInfos"]
        page = next(target["targetId"] for target in targets if target["type"] == "page")
        self._session = self.call("Target.attachToTarget", targetId=page, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setDeviceMetricsOverride", **self._metrics)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if self._dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        return self

    def __exit__(self, *_) -> None:
        try:
            self._session = None
            self.call("Browser.close")
            self._process.wait(10)
        except (OSError, EOFError, subprocess.TimeoutExpired):
            self._process.kill()
            self._process.wait()
        os.close(self._write)
        os.close(self._read)
        self._home.cleanup()

    def call(self, method: str, **parameters) -> dict[str, Any]:
        """A command of the protocol and its answer.  Raises RuntimeError with the browser's words."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']['message']}")
                return answer["result"]
            self._note(answer)

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._received:
            more = os.read(self._read, 1 << 20)
            if not more:
                raise EOFError("the browser has ended")
            self._received += more
        message, self._received = self._received.split(b"\0", 1)
        return json.loads(message)

    def _note(self, event: dict[str, Any]) -> None:
        told = event.get("params", {})
        if event.get("method") == "Runtime.exceptionThrown":
            details = told["exceptionDetails"]
            self.problems.append(details.get("exception", {}).get("description") or details["text"])
        elif "GL Driver Message (OpenGL, Performance" in json.dumps(told):
            return  # the browser's own, where it takes WebGL's pictures to the processor
        elif event.get("method") == "Network.requestWillBeSent":
            self.requests.append(told["request"]["url"])
        elif event.get("method") == "Runtime.consoleAPICalled" and told["type"] in ("error", "warning", "assert"):
            self.problems.append(" ".join(str(one.get("value", one.get("description"))) for one in told["args"]))
        elif event.get("method") == "Log.entryAdded" and told["entry"]["level"] in ("error", "warning"):
            self.problems.append(told["entry"]["text"])

    def run(self, script: str) -> Any:
        """The value of an expression in the page; of a promise, what it comes to."""
        answer = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(answer["exceptionDetails"]["exception"]["description"])
        return answer["result"].get("value")

    def open(self, path: Path, ready: str = "document.documentElement?.dataset.ready", hash: str = "") -> None:
        """Load a file and wait until an expression is true.  hash: of the address, with its #."""
        self.go(path.resolve().as_uri() + hash, ready)

    def go(self, address: str, ready: str) -> None:
        """Load what is at an address and wait until an expression is true."""
        self.call("Page.navigate", url="about:blank")
        self.call("Page.navigate", url=address)
        self.wait(ready)

    def wait(self, condition: str, seconds: float = 60.0) -> None:
        """Until an expression is true.  Raises TimeoutError."""
        until = time.monotonic() + seconds
        while not self.run(condition):
            if time.monotonic() > until:
                raise TimeoutError(f"{condition} is not true after {seconds} s; problems: {self.problems}")
            time.sleep(0.03)

    def mouse(self, kind: str, x: float, y: float, buttons: int = 0) -> None:
        """kind: mousePressed, mouseMoved or mouseReleased; buttons: those that are down, 1 the left one."""
        button = {} if kind == "mouseMoved" else {"button": "left", "clickCount": 1}
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, buttons=buttons, **button)

    def touch(self, kind: str, *points: tuple[float, float]) -> None:
        """kind: touchStart, touchMove or touchEnd."""
        self.call("Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": y} for x, y in points])

    def key(self, key: str, text: str = "") -> None:
        """Press and release a key, by its name in the DOM."""
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, text=text or (key if len(key) == 1 else ""))
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key)

    def picture(self, path: Path | None = None) -> bytes:
        """What it shows, as a PNG."""
        content = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        if path:
            path.write_bytes(content)
        return content
