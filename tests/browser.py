"""A headless browser for tests, driven over its DevTools protocol by Tornado's web sockets."""

from __future__ import annotations

import asyncio
import base64
import json
import os
import shutil
import signal
import subprocess
import urllib.request
from contextlib import asynccontextmanager

BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), ""
)

_QUIET = [
    *("headless", "no-sandbox", "disable-gpu", "disable-quic", "no-first-run", "disable-sync"),
    *("disable-background-networking", "disable-component-update"),
]


def command(profile, *switches):
    """What starts the browser, for one page and without asking the network for anything else."""
    own = [*_QUIET, f"user-data-dir={profile}", *switches]
    return [BROWSER, *(f"--{switch}" for switch in own)]


class Page:
    """A page that can be asked, and pressed."""

    def __init__(self, socket):
        self._socket, self._number = socket, 0

    async def call(self, method, **parameters):
        """Call the browser and return its answer; events are dropped."""
        self._number += 1
        asked = {"id": self._number, "method": method, "params": parameters}
        await self._socket.write_message(json.dumps(asked))
        while True:
            text = await self._socket.read_message()
            assert text is not None, "the browser is gone"
            answer = json.loads(text)
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]

    async def run(self, script):
        """Return what a script's last expression is, or becomes."""
        done = await self.call(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in done, done["exceptionDetails"]
        return done["result"].get("value")

    async def until(self, script, seconds=60):
        """Wait until an expression is true."""
        for _ in range(10 * seconds):
            if await self.run(f"Boolean({script})"):
                return
            await asyncio.sleep(0.1)
        raise TimeoutError(f"not within {seconds} s: {script}")

    async def mouse(self, kind, x, y, **more):
        """Move, press or release the left button."""
        event = {"type": f"mouse{kind}", "x": x, "y": y, "button": "left", "buttons": 1}
        await self.call("Input.dispatchMouseEvent", **event, clickCount=1, **more)

    async def picture(self, path):
        """Write what is seen as a PNG."""
        shot = await self.call("Page.captureScreenshot")
        path.write_bytes(base64.b64decode(shot["data"]))


@asynccontextmanager
async def opened(url, profile, size="1000,900"):
    """A page of a browser that ends with the block."""
    from tornado.websocket import websocket_connect

    switches = ["remote-debugging-port=0", f"window-size={size}"]
    nothing = subprocess.DEVNULL  # a pipe that nobody reads would stop it
    with subprocess.Popen(
        [*command(profile, *switches), url], stdout=nothing, stderr=nothing, start_new_session=True
    ) as process:
        try:
            port = await _port(profile / "DevToolsActivePort")
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as answer:
                pages = [page for page in json.load(answer) if page["type"] == "page"]
            socket = await websocket_connect(
                pages[0]["webSocketDebuggerUrl"], max_message_size=100_000_000
            )
            yield Page(socket)
            socket.close()
        finally:
            os.killpg(process.pid, signal.SIGKILL)


async def _port(file, seconds=60):
    """Wait for the file in which a browser says where it listens."""
    for _ in range(10 * seconds):
        if file.exists() and (text := file.read_text()).count("\n"):
            return int(text.splitlines()[0])
        await asyncio.sleep(0.1)
    raise TimeoutError(f"no browser within {seconds} s")


def printed(arguments, seconds=120):
    """What a browser prints; its children end with it, whatever it does."""
    with subprocess.Popen(
        arguments,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            return process.communicate(timeout=seconds)[0]
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            raise
