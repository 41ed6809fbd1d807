"""A headless Chromium driven over its DevTools pipe with the standard library alone.

The browser reads commands from file descriptor 3 and writes answers and events to 4, JSON ended by a zero byte
(`--remote-debugging-pipe`): no port, no websocket, nothing to poll.
"""

from __future__ import annotations

import json
import os
import select
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from samples import HANG

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-extensions",
    "--no-default-browser-check", "--hide-scrollbars", "--remote-debugging-pipe",
)  # fmt: skip
# Puts the two pipe ends where the browser looks for them, then becomes the browser. First out of the way: an end that
# is 3 already would be left alone by dup2, and closed on exec.
LAUNCHER = (
    "import fcntl, os, sys\n"
    "a, b = (fcntl.fcntl(int(x), fcntl.F_DUPFD, 10) for x in sys.argv[1:3])\n"
    "os.dup2(a, 3); os.dup2(b, 4)\n"
    "os.execv(sys.argv[3], sys.argv[3:])\n"
)
MEASURE = """(async () => {
  const images = [...document.images];
  await Promise.all(images.map(image => image.decode().catch(() => null)));
  const root = document.documentElement;
  return {
    scroll: root.scrollWidth, width: root.clientWidth, height: root.scrollHeight,
    images: images.map(image => ({
      natural: image.naturalWidth, shown: image.getBoundingClientRect().width, alt: image.alt.trim(),
    })),
    dead: [...document.querySelectorAll('a[href^="#"]')].map(link => link.getAttribute('href'))
      .filter(href => !document.getElementById(href.slice(1))),
    anchors: document.querySelectorAll('a[href^="#"]').length,
    paper: getComputedStyle(document.body).backgroundColor,
  };
})()"""


def find_browser() -> str | None:
    """The browser that FITBALL_BROWSER names, or the first one on PATH."""
    return next(filter(None, map(shutil.which, (os.environ.get("FITBALL_BROWSER") or "", *NAMES))), None)


@dataclass(frozen=True)
class Visit:
    """What a page did and how it lies: console errors, addresses asked for, and the answer of `MEASURE`."""

    errors: tuple[str, ...]
    requests: tuple[str, ...]
    layout: dict


class Browser:
    """One browser process; close it, or use it in a `with`."""

    def __init__(self, executable: str, profile: Path) -> None:
        down, self._out = os.pipe()
        self._in, up = os.pipe()
        command = [executable, *FLAGS, f"--user-data-dir={profile}", "about:blank"]
        self._process = subprocess.Popen(
            [sys.executable, "-c", LAUNCHER, str(down), str(up), *command],
            pass_fds=(down, up),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "HOME": str(profile)},
        )
        os.close(down)
        os.close(up)
        self._count, self._buffer, self._events = 0, b"", []

    def __enter__(self):
        return self

    def __exit__(self, *_error):
        self.close()

    def close(self) -> None:
        """End the process."""
        if self._process.poll() is None:
            try:
                self.call("Browser.close")
                self._process.wait(timeout=HANG)
            except (OSError, RuntimeError, TimeoutError, subprocess.TimeoutExpired):
                self._process.kill()
                self._process.wait()
        for end in (self._out, self._in):
            os.close(end)

    def call(self, method: str, session: str | None = None, **params):
        """The result of a command; events that come meanwhile are kept."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": params}
        if session is not None:
            message["sessionId"] = session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        until = time.monotonic() + HANG
        while True:
            found = self._next(until)
            if found.get("id") == self._count:
                if "error" in found:
                    raise RuntimeError(f"{method}: {found['error']['message']}")
                return found["result"]
            self._events.append(found)

    def wait(self, method: str, session: str) -> None:
        """Until such an event has come."""
        until = time.monotonic() + HANG
        while not any(item.get("method") == method and item.get("sessionId") == session for item in self._events):
            self._events.append(self._next(until))

    def _next(self, until: float):
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._in], [], [], max(0.0, until - time.monotonic()))
            if not ready:
                raise TimeoutError("the browser does not answer")
            part = os.read(self._in, 1 << 20)
            if not part:
                raise RuntimeError("the browser has ended")
            self._buffer += part
        head, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(head)

    def open(self, page: Path, width: int, scheme: str = "light", media: str = "screen") -> str:
        """Open a page in a window of that width and colour scheme; returns the session."""
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable", session)
        self.call(
            "Emulation.setDeviceMetricsOverride", session, width=width, height=900, deviceScaleFactor=1, mobile=False
        )
        self.call(
            "Emulation.setEmulatedMedia",
            session,
            media=media,
            features=[{"name": "prefers-color-scheme", "value": scheme}],
        )
        self._events.clear()
        self.call("Page.navigate", session, url=page.as_uri())
        self.wait("Page.loadEventFired", session)
        return session

    def visit(self, page: Path, width: int, scheme: str = "light") -> Visit:
        """Open a page, measure it, close it."""
        session = self.open(page, width, scheme)
        answer = self.call("Runtime.evaluate", session, expression=MEASURE, awaitPromise=True, returnByValue=True)
        mine = [item for item in self._events if item.get("sessionId") == session]
        self.call("Page.close", session)
        return Visit(
            tuple(_errors(mine)),
            tuple(item["params"]["request"]["url"] for item in mine if item["method"] == "Network.requestWillBeSent"),
            answer["result"]["value"],
        )


def _errors(events):
    """What the console would show in red or yellow."""
    for item in events:
        params = item.get("params", {})
        if item["method"] == "Runtime.exceptionThrown":
            yield params["exceptionDetails"]["text"]
        if item["method"] == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning", "assert"):
            yield str(params["args"])
        if item["method"] == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
            yield params["entry"]["text"]
