"""How the viewer feels over SSH: a real sshd on loopback, behind a relay that delays and limits bytes.

    python benchmarks/over_ssh.py [SCENE] [--outputs kitty,sixel,half] [--mbit 10,1] [--taps 20] [--round-trip 40]

The terminal is a program at this end of ssh, of 120 x 40 cells of 10 x 20 pixels: it answers what a terminal
answers, and taps keys. Exits with 0 when every floor holds, 1 when one does not, 2 when there is no sshd.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import re
import shutil
import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import ptyprocess
from rich.console import Console
from rich.table import Table

from relay import Relay
from sshd import Sshd

COLUMNS, ROWS, CELL = 120, 40, (10, 20)
START_SECONDS, TURN_SECONDS, STALL_SECONDS = 60.0, 4.0, 5.0
WIDTH = 120

MEDIAN_MS = {10: 200.0, 1: 400.0}
P95_MS, FRAMES_A_SECOND = {10: 350.0}, {10: 8.0}
"""Floors by Mbit/s; where nothing is written nothing is asked."""

QUESTION = b"\x1b[5n"
ANSWERS = {
    "kitty": b"\x1bP>|kitty(0.35.2)\x1b\\\x1b[6;20;10t\x1b[?2026;2$y\x1b_Gi=31;OK\x1b\\\x1b[?0u\x1b[?62;c",
    "sixel": b"\x1bP>|XTerm(379)\x1b\\\x1b[6;20;10t\x1b[?63;1;2;4c",
    "half": b"\x1bP>|foot(1.13.1)\x1b\\\x1b[6;20;10t\x1b[?2026;2$y\x1b[?62;22c",
}
"""What a terminal of each kind says when it is asked what it can do."""


class Terminal:
    """A terminal that draws nothing: it answers, and knows when each frame was complete."""

    def __init__(self, output: str, command: Sequence[str]) -> None:
        self.output = output
        self.process = ptyprocess.PtyProcess.spawn(list(command), dimensions=(ROWS, COLUMNS))
        self.frames: list[float] = []
        self.bytes = 0
        self.words: list[tuple[float, bytes]] = []
        self._rest = b""
        self._asked = False
        self._lock = threading.Condition()
        threading.Thread(target=self._read, daemon=True).start()

    def type(self, keys: bytes) -> None:
        """Send keys as they come from a keyboard."""
        os.write(self.process.fd, keys)

    def hold(self, seconds: float) -> None:
        """Hold the key that turns right."""
        end = time.perf_counter() + seconds
        if self.output == "kitty":
            self.type(b"\x1b[107;1:1u")
        while time.perf_counter() < end:
            if self.output != "kitty":
                self.type(b"k")
            time.sleep(0.033)
        if self.output == "kitty":
            self.type(b"\x1b[107;1:3u")

    def tap(self) -> float:
        """Turn a little and change the mode, which the next frame says in words; return when that was."""
        keys = b"\x1b[107;1:1u\x1b[107;1:3u\x1b[32;1:1u\x1b[32;1:3u" if self.output == "kitty" else b"k "
        start = time.perf_counter()
        self.type(keys)
        return start

    def wait_for_frame(self, start: float, word: bytes, timeout: float) -> float:
        """Return when the first frame that says ``word`` after ``start`` was complete."""
        with self._lock:
            found = self._lock.wait_for(lambda: any(t > start and w == word for t, w in self.words), timeout)
            if not found:
                raise TimeoutError(f"no frame says {word.decode()} within {timeout:.0f} s")
            return next(t for t, w in self.words if t > start and w == word)

    def wait_for_frames(self, count: int, timeout: float) -> None:
        """Wait until this many frames were complete."""
        with self._lock:
            if not self._lock.wait_for(lambda: len(self.frames) >= count, timeout):
                raise TimeoutError(f"{len(self.frames)} of {count} frames within {timeout:.0f} s")

    def close(self) -> None:
        """Hang up."""
        self.process.close(force=True)

    def _read(self) -> None:
        with contextlib.suppress(OSError):  # closed
            self._answer_for_ever()

    def _answer_for_ever(self) -> None:
        while True:
            received = os.read(self.process.fd, 1 << 16)
            now = time.perf_counter()
            data = self._rest + received
            if not self._asked and b"\x1b[c" in data:
                self._asked = True
                self.type(ANSWERS.get(self.output, ANSWERS["half"]))
            *frames, self._rest = data.split(QUESTION)
            with self._lock:
                self.bytes += len(received)
                for frame in frames:
                    self.frames.append(now)
                    if word := re.search(rb"flying|orbiting", frame):
                        self.words.append((now, word[0]))
                self._lock.notify_all()
            for _ in frames:
                self.type(b"\x1b[0n")


def measure(scene: str, output: str, mbit: float, round_trip: float, taps: int) -> dict[str, float]:
    """Return milliseconds from key to frame, frames a second while turning, and what a stall leaves behind."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        sshd = stack.enter_context(Sshd(folder))
        relay = stack.enter_context(Relay(sshd.port, mbit * 1e6 / 8, round_trip / 2e3))
        viewer = f"{sys.executable} -m tsplat {scene} --output {output}"
        environment = {name: text for name, text in os.environ.items() if name.startswith("PYTHON")}
        settings = " ".join(
            f"{name}='{text}'" for name, text in (environment | {"COLORTERM": "truecolor"}).items()
        )
        terminal = Terminal(output, sshd.client(relay.port, f"env {settings} {viewer}"))
        stack.callback(terminal.close)
        terminal.wait_for_frames(3, START_SECONDS)
        time.sleep(1.0)
        word, waits = b"flying", []
        for _ in range(taps):
            start = terminal.tap()
            waits.append(1e3 * (terminal.wait_for_frame(start, word, 30.0) - start))
            word = b"orbiting" if word == b"flying" else b"flying"
            time.sleep(random.uniform(0.3, 1.2))
        before, bytes_before, start = len(terminal.frames), terminal.bytes, time.perf_counter()
        terminal.hold(TURN_SECONDS)
        turning = time.perf_counter() - start
        frames = sum(start + 0.5 < moment for moment in terminal.frames[before:])
        sent = terminal.bytes - bytes_before
        stalled = _stall(terminal, relay, word)
        return {
            "median": statistics.median(waits),
            "p95": statistics.quantiles(waits, n=20)[-1],
            "fps": frames / (turning - 0.5),
            "kB": sent / max(1, len(terminal.frames) - before) / 1e3,
            "old": stalled[0],
            "back": stalled[1],
        }


def _stall(terminal: Terminal, relay: Relay, word: bytes) -> tuple[float, float]:
    """Stop the link while the view turns; return how many old frames come back, and ms until the newest."""
    holding = threading.Thread(target=terminal.hold, args=(STALL_SECONDS,))
    time.sleep(1.0)
    holding.start()
    time.sleep(0.5)
    relay.stall(STALL_SECONDS)
    holding.join()
    start = terminal.tap()
    relay.wait_until_flowing()
    flowing, before = time.perf_counter(), len(terminal.frames)
    complete = terminal.wait_for_frame(start, word, 30.0)
    old = sum(moment < complete for moment in terminal.frames[before:])
    return float(old), 1e3 * (complete - flowing)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, return the exit status."""
    parser = argparse.ArgumentParser(description="Measure the viewer over a slow link.")
    parser.add_argument("scene", nargs="?", default="demo")
    parser.add_argument("--outputs", default="kitty,sixel,half")
    parser.add_argument("--mbit", default="10,1")
    parser.add_argument("--round-trip", type=float, default=40.0, metavar="MS")
    parser.add_argument("--taps", type=int, default=20)
    chosen = parser.parse_args(arguments)
    if not (shutil.which("ssh") and Sshd.program()):
        print(
            "over_ssh: looked for ssh and sshd, which are not both there; install openssh-server", file=sys.stderr
        )
        return 2
    table = Table(
        "link", "output", "key to frame, ms", "p95, ms", "frames/s", "kB a frame", "after a stall of 5 s"
    )
    missed = 0
    for mbit in map(float, chosen.mbit.split(",")):
        for output in chosen.outputs.split(","):
            found = measure(chosen.scene, output, mbit, chosen.round_trip, chosen.taps)
            marks = [
                found["median"] > MEDIAN_MS.get(int(mbit), 1e9),
                found["p95"] > P95_MS.get(int(mbit), 1e9),
                found["fps"] < FRAMES_A_SECOND.get(int(mbit), 0.0),
            ]
            missed += sum(marks)
            median, p95, fps = (
                f"{found[name]:.0f}{' !' if mark else ''}"
                for name, mark in zip(("median", "p95", "fps"), marks, strict=True)
            )
            after = f"{found['old']:.0f} old frames, newest after {found['back']:.0f} ms"
            table.add_row(f"{mbit:g} Mbit/s", output, median, p95, fps, f"{found['kB']:.0f}", after)
            print(f"{mbit:g} Mbit/s {output}: {found}", file=sys.stderr, flush=True)
    Console(width=None if sys.stdout.isatty() else WIDTH, highlight=False).print(table)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
