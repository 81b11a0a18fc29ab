"""A program in a pseudo terminal, driven from outside: bytes in, bytes out, no emulator."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from types import TracebackType
from typing import Any

DEADLINE = 20.0
TAKE_CONTROL = "import fcntl, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0)\n"


def _inherited() -> dict[str, str]:
    # Nothing of the terminal the tests run in, but the Python they run with.
    return {name: text for name, text in os.environ.items() if name == "PATH" or name.startswith("PYTHON")}


class Terminal:
    """Start a program on a new terminal of 80 x 24 and talk to it; everything it writes is in ``seen``."""

    def __init__(self, *command: str, environment: dict[str, str] | None = None) -> None:
        self.master, self.slave = pty.openpty()
        self.resize(80, 24)
        self.before: list[Any] = termios.tcgetattr(self.slave)
        self.seen = b""
        self.process = subprocess.Popen(
            command,
            stdin=self.slave,
            stdout=self.slave,
            stderr=self.slave,
            start_new_session=True,
            env=_inherited() | {"TERM": "xterm-256color"} | (environment or {}),
        )

    @classmethod
    def python(cls, script: str, environment: dict[str, str] | None = None) -> Terminal:
        """Run a script that has the terminal for its own, as a shell's child would."""
        return cls(sys.executable, "-c", TAKE_CONTROL + script, environment=environment)

    def __enter__(self) -> Terminal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait(DEADLINE)
        os.close(self.master)
        os.close(self.slave)

    def resize(self, columns: int, rows: int, width: int = 0, height: int = 0) -> None:
        fcntl.ioctl(self.master, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, width, height))

    def type(self, keys: bytes) -> None:
        os.write(self.master, keys)

    def attributes(self) -> list[Any]:
        return termios.tcgetattr(self.slave)

    def wait_for(self, *texts: bytes, start: int = 0) -> int:
        """Read until all texts were seen, in this order, from ``start`` on; return where the last one ends."""
        end = start
        deadline = time.monotonic() + DEADLINE
        for text in texts:
            while (at := self.seen.find(text, end)) < 0:
                assert self._read(deadline), f"{text!r} did not come after {self.seen[end:]!r}"
            end = at + len(text)
        return end

    def wait(self) -> int:
        """Read until the program ended; return its exit status."""
        deadline = time.monotonic() + DEADLINE
        while self.process.poll() is None:
            self._read(min(deadline, time.monotonic() + 0.02))
            assert time.monotonic() < deadline, f"still running after {self.seen!r}"
        while self._read(time.monotonic()):
            pass
        return self.process.returncode

    def _read(self, deadline: float) -> bool:
        ready = select.select([self.master], [], [], max(0.0, deadline - time.monotonic()))[0]
        if ready:
            self.seen += os.read(self.master, 1 << 16)
        return bool(ready)
