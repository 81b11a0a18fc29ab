"""xterm.js, the terminal of VS Code, in headless Chromium."""

from __future__ import annotations

import base64
import contextlib
import io
import os
import shutil
import subprocess
import threading
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import platformdirs
import ptyprocess
from PIL import Image

from tests.e2e.chromium import Chromium
from tests.e2e.display import U8

COLUMNS, ROWS = 80, 24  # as page.html has them
PAGE = 720, 432
SMALLER = 60, 20
HERE = Path(__file__).parent

KEYS = {"Left": ("ArrowLeft", 37), "Right": ("ArrowRight", 39)}
"""What the browser calls a key, and its number."""


class XtermJs:
    """Run a program in a terminal in a web page; see `tests.e2e.terminals.Terminal`.

    Parameters
    ----------
    folder : Path
        Home of the browser, empty.
    program : sequence of str
        What runs in the terminal.
    environment : dict of str to str
        What the program needs to know.
    """

    def __init__(self, folder: Path, program: Sequence[str], environment: dict[str, str]) -> None:
        terminal = {**environment, "HOME": str(folder), "TERM": "xterm-256color", "COLORTERM": "truecolor"}
        typed = {"typed": lambda text: self._type(text.encode()),
                 "typedBytes": lambda text: self._type(text.encode("latin-1"))}  # fmt: skip
        self._browser = Chromium(folder, installed(), PAGE, typed)
        self._pty = ptyprocess.PtyProcess.spawn(list(program), dimensions=(ROWS, COLUMNS), env=terminal)
        self._pump = threading.Thread(target=self._show)
        self._pump.start()

    def screen(self) -> U8:
        """Return the page as a picture."""
        shot = self._browser.call("Page.captureScreenshot", format="png")["data"]
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(shot))).convert("RGB"))

    def tap(self, key: str) -> None:
        """Press a key and let it go."""
        self.press(key)
        self.let_go(key)

    def press(self, key: str) -> None:
        """Press a key."""
        name, number = KEYS.get(key, (key, ord(key[0].upper())))
        text = {} if key in KEYS else {"text": key}
        self._browser.call(
            "Input.dispatchKeyEvent",
            type="keyDown",
            key=name,
            code=_code(key),
            windowsVirtualKeyCode=number,
            **text,
        )

    def let_go(self, key: str) -> None:
        """Let a key go."""
        name, number = KEYS.get(key, (key, ord(key[0].upper())))
        self._browser.call(
            "Input.dispatchKeyEvent", type="keyUp", key=name, code=_code(key), windowsVirtualKeyCode=number
        )

    def resize(self) -> None:
        """Take columns and rows away."""
        columns, rows = SMALLER
        self._browser.evaluate(f"terminal.resize({columns}, {rows})")
        self._pty.setwinsize(rows, columns)

    def close(self) -> None:
        """End the program and the browser."""
        self._pty.close(force=True)
        self._pump.join()
        self._browser.close()

    def _type(self, keys: bytes) -> None:
        # The page may answer what the program asked just before it was ended.
        with contextlib.suppress(OSError):
            os.write(self._pty.fd, keys)

    def _show(self) -> None:
        while True:
            try:
                written = os.read(self._pty.fd, 1 << 16)
            except OSError:
                return  # the program ended, or the terminal was closed
            if not written:
                return
            self._browser.evaluate(f"show('{base64.b64encode(written).decode()}')")


def _code(key: str) -> str:
    return KEYS[key][0] if key in KEYS else f"Key{key.upper()}"


def installed() -> Path:
    """Return the page, beside the packages that it needs, installed once in the user's cache."""
    folder = platformdirs.user_cache_path("tsplat-tests") / "xtermjs"
    folder.mkdir(parents=True, exist_ok=True)
    wanted = (HERE / "package-lock.json").read_bytes()
    done = folder / "installed"
    if not done.exists() or done.read_bytes() != wanted:
        for name in ("package.json", "package-lock.json"):
            shutil.copy(HERE / name, folder)
        subprocess.run(["npm", "ci", "--ignore-scripts", "--silent"], cwd=folder, check=True)
        done.write_bytes(wanted)
    return Path(shutil.copy(HERE / "page.html", folder))
