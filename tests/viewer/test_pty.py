"""The whole viewer in a real pty: keys in, screen out, the terminal whole again afterwards."""

from __future__ import annotations

import os
import re
import select
import signal
import sys
import termios
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import ptyprocess
import pyte
import pytest

from tests.scenes import random_gaussians
from tsplat.io import save
from tsplat.lod import store

DEADLINE = 60.0
"""Seconds: kernels may have to be compiled."""

COLUMNS, ROWS = 80, 24


class Terminal:
    """A terminal emulator with the viewer in it, answering only what an old terminal answers."""

    def __init__(self, scene: Path, *args: str, piped: bool = False) -> None:
        self.screen = pyte.Screen(COLUMNS, ROWS)
        self.stream = pyte.ByteStream(self.screen)
        environment = {**os.environ, "TERM": "xterm-256color", "COLORTERM": "truecolor"}
        for name in ("TSPLAT_OUTPUT", "KITTY_WINDOW_ID", "TMUX", "COLUMNS", "LINES"):
            environment.pop(name, None)
        # A shell in between keeps the pty open, so that its modes can be read when the viewer has gone.
        named = f"'{sys.executable}' -m tsplat {' '.join(args)}"
        viewer = f"cat '{scene}' | {named} -" if piped else f"{named} '{scene}'"
        command = f"stty -a | head -c 0; {viewer}; echo status=$?; cat"
        self.process = ptyprocess.PtyProcess.spawn(
            ["/bin/sh", "-c", command], dimensions=(ROWS, COLUMNS), env=environment, cwd=scene.parent
        )
        self.modes = termios.tcgetattr(self.process.fd)
        self.received = b""

    def read(self, timeout: float) -> None:
        ready, _, _ = select.select([self.process.fd], [], [], timeout)
        if ready:
            received = os.read(self.process.fd, 1 << 16)
            if b"\x1b[c" in received:
                self.send(b"\x1b[?1;2c")
            self.received += received
            # pyte takes private CSI sequences with these prefixes for text.
            self.stream.feed(re.sub(rb"\x1b\[[>=<][0-9;]*[a-zA-Z]|\x1bP.*?\x1b\\|\x1b_.*?\x1b\\", b"", received))

    def until(self, met: Callable[[], bool], what: str) -> None:
        end = time.monotonic() + DEADLINE
        while not met():
            assert time.monotonic() < end, f"no {what} in {DEADLINE} s; the screen:\n{self.text}"
            self.read(0.1)

    def send(self, keys: bytes) -> None:
        os.write(self.process.fd, keys)

    @property
    def text(self) -> str:
        return "\n".join(self.screen.display)

    def colors(self) -> list[tuple[str, str]]:
        """Return the colours of the cells between the badge and the message."""
        rows = range(2, ROWS - 2)
        return [
            (cell.fg, cell.bg) for row in rows for cell in (self.screen.buffer[row][c] for c in range(COLUMNS))
        ]

    def until_it_rests(self) -> list[tuple[str, str]]:
        """Read until nothing comes for a while; return the colours."""
        end = time.monotonic() + DEADLINE
        size = -1
        while size != len(self.received):
            assert time.monotonic() < end, "the screen never comes to rest"
            size = len(self.received)
            self.read(0.5)
        return self.colors()

    def until_changed(self, before: list[tuple[str, str]], what: str) -> list[tuple[str, str]]:
        self.until(lambda: self.colors() != before, what)
        return self.until_it_rests()


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[Callable[..., Terminal]]:
    scene = save(tmp_path / "cloud.ply", random_gaussians(np.random.default_rng(8), 400, sh_degree=0))
    opened: list[Terminal] = []

    def open_it(*args: str, piped: bool = False) -> Terminal:
        opened.append(Terminal(scene, *args, piped=piped))
        opened[-1].until(lambda: "splats " in opened[-1].text or "status=" in opened[-1].text, "first frame")
        assert "splats " in opened[-1].text, opened[-1].text
        return opened[-1]

    yield open_it
    for each in opened:
        each.process.close(force=True)


def whole_again(terminal: Terminal, status: str) -> None:
    """Check that the shell has its terminal back: screen, cursor, mouse, modes."""
    terminal.until(lambda: status in terminal.text, status)
    assert terminal.received.rindex(b"\x1b[?1049l") > terminal.received.rindex(b"\x1b[?1049h")
    assert terminal.received.rindex(b"\x1b[?25h") > terminal.received.rindex(b"\x1b[?25l")
    for mode in set(re.findall(rb"\x1b\[\?(100[0-6]|1016|2004|1004)h", terminal.received)):
        assert terminal.received.rindex(b"\x1b[?%bl" % mode) > terminal.received.rindex(b"\x1b[?%bh" % mode)
    assert termios.tcgetattr(terminal.process.fd) == terminal.modes


def test_keys_change_the_screen_and_q_gives_the_terminal_back(terminal: Callable[..., Terminal]) -> None:
    shown = terminal("--output", "half")
    start = shown.until_it_rests()
    assert len(set(start)) > 20

    shown.send(b"k")
    turned = shown.until_changed(start, "picture from another side")
    shown.send(b"z")
    shown.until(lambda: shown.colors() == start, "start view again")

    shown.send(b"\t")
    shown.until(lambda: "antialias" in shown.text, "HUD")
    shown.send(b"\x1b[B\x1b[B\x1b[B")
    shown.until(lambda: "◂ relative ▸" in shown.text, "selected row")
    shown.send(b"\x1b[C")
    shown.until(lambda: "◂ classic ▸" in shown.text, "changed value")
    shown.send(b"\t")
    shown.until(lambda: "antialias" not in shown.text, "end of the HUD")

    shown.send(b"?")
    shown.until(lambda: "Orbiting" in shown.text, "keys")
    shown.send(b" ")
    shown.until(lambda: "Flying" in shown.text, "keys of the flight")
    shown.send(b"?p")
    shown.until(lambda: "saved tsplat-cloud-001.png" in shown.text, "saved picture")
    assert turned != start

    shown.send(b"q")
    whole_again(shown, "status=0")


def test_a_resized_terminal_gets_a_picture_of_its_size(terminal: Callable[..., Terminal]) -> None:
    shown = terminal("--output", "half256")
    shown.until_it_rests()
    shown.screen.resize(12, 40)
    shown.screen.reset()
    shown.process.setwinsize(12, 40)
    shown.until(lambda: shown.screen.display[0].endswith("splats "), "badge at the new edge")
    shown.until(lambda: "▀" * 40 in shown.screen.display[6], "picture over the new width")
    shown.send(b"q")
    shown.until(lambda: "status=0" in shown.text, "end")


@pytest.mark.parametrize(
    ("keys", "status"), [(b"\x03", "status=0"), (b"\x1b", "status=0"), (b"?\x03", "status=0")], ids=repr
)
def test_every_way_to_quit_gives_the_terminal_back(
    terminal: Callable[..., Terminal], keys: bytes, status: str
) -> None:
    shown = terminal("--output", "half")
    shown.send(keys)
    whole_again(shown, status)


def test_a_piped_scene_leaves_the_keys_to_the_terminal(terminal: Callable[..., Terminal]) -> None:
    shown = terminal("--output", "half", piped=True)
    start = shown.until_it_rests()
    shown.send(b"k")
    shown.until_changed(start, "picture from another side")
    shown.send(b"p")
    shown.until(lambda: "saved tsplat-stdin-001.png" in shown.text, "saved picture")
    shown.send(b"q")
    whole_again(shown, "status=0")


def largest(pid: int) -> int:
    """Return the most kilobytes that a process has had in memory."""
    status = Path(f"/proc/{pid}/status")
    lines = status.read_text().splitlines() if status.exists() else []
    return next((int(line.split()[1]) for line in lines if line.startswith("VmHWM")), 0)


def child_of(pid: int) -> int:
    (child,) = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return int(child)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGBUS, signal.SIGUSR1])
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs Linux's list of child processes")
def test_a_signal_ends_the_viewer_and_gives_the_terminal_back(
    terminal: Callable[..., Terminal], number: signal.Signals
) -> None:
    shown = terminal("--output", "half")
    os.kill(child_of(shown.process.pid), number)
    whole_again(shown, f"status={128 + number}")


def test_a_scene_on_disk_that_shrinks_while_it_turns_is_a_line_and_a_key_loads_it_again(tmp_path: Path) -> None:
    scene = tmp_path / "x.tsplat"
    with scene.open("wb") as file:
        store(file, random_gaussians(np.random.default_rng(8), 3000, sh_degree=1), 1, lambda _: None)
    whole = scene.read_bytes()
    shown = Terminal(scene, "--output", "half", "--budget", "500")
    shown.until(lambda: "splats" in shown.text, "first frame")
    shown.send(b"o")
    turning = shown.colors()
    shown.until(lambda: shown.colors() != turning, "motion")
    os.truncate(scene, 5000)
    shown.until(lambda: "the file changed; Ctrl-R loads it again" in shown.text, "notice")
    shown.send(b"\x12")
    shown.until(lambda: "but ends at 5000" in shown.text, "reason")
    scene.write_bytes(whole)
    shown.send(b"\x12")
    shown.until(lambda: "loaded again" in shown.text, "scene")
    turning = shown.colors()
    shown.until(lambda: shown.colors() != turning, "motion again")
    shown.send(b"q")
    whole_again(shown, "status=0")
    shown.process.close(force=True)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="only Linux tells")
def test_a_terminal_that_claims_to_be_larger_than_any_screen_takes_little_memory(
    terminal: Callable[..., Terminal],
) -> None:
    shown = terminal("--output", "half")
    viewer = child_of(shown.process.pid)
    shown.until_it_rests()
    shown.stream = pyte.ByteStream(pyte.Screen(COLUMNS, ROWS))  # which need not draw what follows
    before, seen = largest(viewer), len(shown.received)
    shown.process.setwinsize(10_000, 10_000)
    shown.until(lambda: len(shown.received) > seen + (1 << 20), "large picture")
    assert largest(viewer) - before < 300_000
    os.kill(viewer, signal.SIGKILL)
