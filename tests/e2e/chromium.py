"""Headless Chromium by its DevTools protocol over a pair of pipes.

Source: https://chromedevtools.github.io/devtools-protocol/.
"""

from __future__ import annotations

import fcntl
import itertools
import json
import os
import subprocess
import threading
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

PATIENCE = 60.0
START = 'exec 3<&"$0" 4>&"$1"; shift; exec "$@"'
"""The browser reads commands from file 3 and answers in file 4. Only bash copies files with numbers above 9."""


class Chromium:
    """A browser with one page.

    Parameters
    ----------
    folder : Path
        Its home.
    page : Path
        The HTML to open.
    size : tuple of 2 ints
        Width and height of the page in pixels.
    bindings : dict of str to callable
        Functions that the page may call with one string; they run on the thread that reads.
    """

    def __init__(
        self, folder: Path, page: Path, size: tuple[int, int], bindings: dict[str, Callable[[str], None]]
    ) -> None:
        self._bindings, self._waiting = bindings, dict[int, Future[dict[str, Any]]]()
        self._numbers, self._session = itertools.count(1), ""
        commands, self._to_browser = map(_out_of_the_way, os.pipe())
        self._from_browser, answers = map(_out_of_the_way, os.pipe())
        with (folder / "log").open("w") as log:
            self._process = subprocess.Popen(
                ["bash", "-c", START, str(commands), str(answers), "chromium", "--headless=new", "--no-sandbox",
                 "--remote-debugging-pipe", f"--user-data-dir={folder}",
                 "--disable-gpu", "--hide-scrollbars", "about:blank"],
                env={**os.environ, "HOME": str(folder)}, stdout=log, stderr=log, pass_fds=[commands, answers],
            )  # fmt: skip
        os.close(commands)
        os.close(answers)
        self._reader = threading.Thread(target=self._read)
        self._reader.start()
        self._open(page, *size)

    def _open(self, page: Path, width: int, height: int) -> None:
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        self.call("Page.enable")
        self.call("Runtime.enable")
        screen = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **screen)
        self.call("Emulation.setFocusEmulationEnabled", enabled=True)
        for name in self._bindings:
            self.call("Runtime.addBinding", name=name)
        self.loaded = threading.Event()
        self.call("Page.navigate", url=page.as_uri())
        assert self.loaded.wait(PATIENCE), "the page did not load"

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Return the answer to a command."""
        number = next(self._numbers)
        self._waiting[number] = answer = Future[dict[str, Any]]()
        command = {"id": number, "method": method, "params": parameters}
        if self._session:
            command["sessionId"] = self._session
        os.write(self._to_browser, json.dumps(command).encode() + b"\0")
        told = answer.result(PATIENCE)
        assert "error" not in told, f"{method}: {told['error']}"
        result: dict[str, Any] = told["result"]
        return result

    def evaluate(self, expression: str) -> Any:
        """Return the value of an expression in the page, awaited where it is a promise."""
        told = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in told, told["exceptionDetails"]
        return told["result"].get("value")

    def close(self) -> None:
        """End the browser."""
        self._process.terminate()
        self._process.wait()
        self._reader.join()
        os.close(self._to_browser)
        os.close(self._from_browser)

    def _read(self) -> None:
        received = b""
        while more := os.read(self._from_browser, 1 << 20):
            *messages, received = (received + more).split(b"\0")
            for message in map(json.loads, messages):
                if answer := self._waiting.pop(message.get("id", 0), None):
                    answer.set_result(message)
                elif message.get("method") == "Runtime.bindingCalled":
                    self._bindings[message["params"]["name"]](message["params"]["payload"])
                elif message.get("method") == "Page.loadEventFired":
                    self.loaded.set()
        for answer in self._waiting.values():
            answer.set_result({"error": "the browser ended"})


def _out_of_the_way(file: int) -> int:
    """Return a copy of a file with a number above those that the browser expects; close the original."""
    copy = fcntl.fcntl(file, fcntl.F_DUPFD_CLOEXEC, 10)
    os.close(file)
    return copy
