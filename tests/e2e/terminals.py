"""How each terminal is started without a monitor, and what a person does in front of it."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from tests.e2e.display import HEIGHT, U8, WIDTH, Display

TMUX_CONFIGURATION = Path(__file__).with_name("tmux.conf")

KITTY = ("kitty", "--config", "NONE", "-o", "update_check_interval=0", "-o", "remember_window_size=no",
         "-o", "initial_window_width=800", "-o", "initial_window_height=480", "-o", "cursor_blink_interval=0",
         "-o", "placement_strategy=top-left", "-o", "window_padding_width=0")  # fmt: skip
XTERM = ("xterm", "-b", "0", "-bw", "0", "+sb", "-fa", "DejaVu Sans Mono", "-fs", "10", "-geometry", "100x30")
XTERM_SIXEL = (*XTERM, "-ti", "vt340", "-xrm", "XTerm*numColorRegisters: 256", "-xrm",
               "XTerm*allowWindowOps: true", "-xrm", "XTerm*maxGraphicSize: 4096x4096", "-e")  # fmt: skip
TMUX = (*XTERM, "-e", "tmux", "-f", str(TMUX_CONFIGURATION), "new-session")
MLTERM = ("mlterm", "-g", "90x28", "--sbmod=none", "--border=0", "-e")
ALACRITTY = ("alacritty", "-o", "window.dimensions.columns=100", "-o", "window.dimensions.lines=30", "-e")
FOOT = ("/bin/sh", "-c", f"""
weston --backend=x11-backend.so --use-pixman --width={WIDTH} --height={HEIGHT} --socket=wayland-0 \\
    --shell=kiosk-shell.so --idle-time=0 --no-config &
until [ -S "$XDG_RUNTIME_DIR/wayland-0" ]; do sleep 0.02; done
exec env WAYLAND_DISPLAY=wayland-0 foot -c /dev/null -o pad=0x0 "$@"
""", "foot")  # fmt: skip


class NotInstallableError(Exception):
    """A terminal that comes from a package registry did not come."""


class Terminal(Protocol):
    """A terminal with a program in it, seen and used from outside."""

    def screen(self) -> U8:
        """Return the screen as it is now, the terminal at its top left, uint8 [H, W, 3]."""

    def tap(self, key: str) -> None:
        """Press a key and let it go; keys have their names of X."""

    def press(self, key: str) -> None:
        """Press a key."""

    def let_go(self, key: str) -> None:
        """Let a key go."""

    def resize(self) -> None:
        """Make the terminal smaller."""

    def close(self) -> None:
        """Close the terminal, whatever runs in it."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """How to start a terminal, and the Debian packages by the commands that they bring.

    Attributes
    ----------
    start : callable
        Given an empty folder, the command to run and its environment, returns the terminal with it.
    needs : mapping of str to str
    """

    start: Callable[[Path, Sequence[str], dict[str, str]], Terminal]
    needs: dict[str, str]

    def missing(self) -> list[str]:
        """Return the packages to install first."""
        return [package for command, package in self.needs.items() if shutil.which(command) is None]


class Window:
    """A terminal in a window of its own X server.

    Parameters
    ----------
    folder : Path
        Home of the terminal, empty.
    command : sequence of str
        The terminal with the program in it.
    environment : dict of str to str
        What the program needs to know.
    zooms : bool
        Whether its window always fills the screen, so that only larger letters make it smaller.
    """

    def __init__(self, folder: Path, command: Sequence[str], environment: dict[str, str], zooms: bool) -> None:
        self._display, self._zooms = Display(folder), zooms
        there = {
            **environment,
            "DISPLAY": self._display.name,
            "HOME": str(folder),
            "XDG_RUNTIME_DIR": str(folder),
            "TMUX_TMPDIR": str(folder),
            "LIBGL_ALWAYS_SOFTWARE": "1",
        }
        with (folder / "log").open("w") as log:
            self._process = subprocess.Popen(
                command, env=there, cwd=folder, stdout=log, stderr=log, start_new_session=True
            )
        # Keys go to the window under the pointer: there is no window manager to give it the keyboard. Up
        # here a pointer that the terminal draws itself, as on Wayland, covers nothing that is compared.
        self._display.do("mousemove", "60", "1")

    def screen(self) -> U8:
        """Return the screen as it is now; see `Terminal`."""
        return self._display.pixels.copy()

    @property
    def pixels(self) -> U8:
        """The screen, which changes by itself."""
        return self._display.pixels

    def tap(self, key: str) -> None:
        """Press a key and let it go at once."""
        self._display.do("key", "--delay", "0", key)

    def press(self, key: str) -> None:
        """Press a key."""
        self._display.do("keydown", key)

    def let_go(self, key: str) -> None:
        """Let a key go."""
        self._display.do("keyup", key)

    def resize(self) -> None:
        """Make the window smaller, or, where it fills the screen, the letters larger."""
        if self._zooms:
            self._display.do("key", "ctrl+plus")
        else:
            self._display.do("windowsize", self._display.window(), "600", "400")

    def close(self) -> None:
        """Close the terminal and its display."""
        os.killpg(self._process.pid, signal.SIGTERM)
        self._process.wait()
        self._display.close()


def windowed(*command: str, zooms: bool = False) -> Callable[[Path, Sequence[str], dict[str, str]], Terminal]:
    """Return what starts a program in this terminal."""

    def start(folder: Path, program: Sequence[str], environment: dict[str, str]) -> Terminal:
        return Window(folder, [*command, *program], environment, zooms)

    return start


def browser(folder: Path, program: Sequence[str], environment: dict[str, str]) -> Terminal:
    """Start a program in xterm.js."""
    from tests.e2e.xtermjs import XtermJs, installed

    try:
        installed()
    except subprocess.CalledProcessError as error:
        raise NotInstallableError(f"xterm.js needs its packages: {error}") from error
    return XtermJs(folder, program, environment)


X = {"Xvfb": "xvfb", "xdotool": "xdotool"}
RECIPES: dict[str, Recipe] = {
    "kitty": Recipe(windowed(*KITTY), {**X, "kitty": "kitty"}),
    "xterm": Recipe(windowed(*XTERM_SIXEL), {**X, "xterm": "xterm"}),
    "mlterm": Recipe(windowed(*MLTERM), {**X, "mlterm": "mlterm"}),
    "foot": Recipe(windowed(*FOOT, zooms=True), {**X, "weston": "weston", "foot": "foot"}),
    "alacritty": Recipe(windowed(*ALACRITTY), {**X, "alacritty": "alacritty"}),
    "tmux": Recipe(windowed(*TMUX), {**X, "xterm": "xterm", "tmux": "tmux"}),
    "xterm.js": Recipe(browser, {"chromium": "chromium", "npm": "npm"}),
}


def clean_environment() -> dict[str, str]:
    """Return nothing of the terminal that the tests run in, but the Python they run with."""
    kept = {name: text for name, text in os.environ.items() if name == "PATH" or name.startswith("PYTHON")}
    return {**kept, "LANG": "C.UTF-8"}
