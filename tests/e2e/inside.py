"""What a shell would do in the terminal: text on the screen, the viewer, then the terminal as it was left.

Runs in the terminal under test. The tests talk to it through files in a folder: ``size`` says that the
screen is ready, ``go`` starts the viewer, ``after`` says that it has ended.

    python inside.py FOLDER COMMAND...
"""

from __future__ import annotations

import fcntl
import json
import os
import signal
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path

from tsplat.terminal import Session, TerminalSize

PATIENCE = 60.0
"""Seconds until the tests must have given the word, so that a killed run leaves nobody waiting."""

SAID_BEFORE = "\x1b[?25h\x1b[H\x1b[2Jtotal 3\r\ncloud.ply  garden.ply  notes.txt\r\n$ tsplat\r\n"


def main(folder: Path, command: list[str]) -> None:
    """Show a shell's text, run the command when told to, keep the terminal open until it is closed."""
    with Session() as session:
        size = session.size()
    print(SAID_BEFORE, end="", flush=True)
    save(folder / "before", modes())
    save(folder / "size", json.dumps([size.columns, size.rows, *size.cell_size]))
    signal.signal(signal.SIGWINCH, lambda *_: save(folder / "size", json.dumps(resized(size))))
    wait_for(folder / "go")
    process = subprocess.Popen(command)
    save(folder / "pid", str(process.pid))
    save(folder / "after", f"{process.wait()}\n{modes()}")
    signal.pause()


def resized(before: TerminalSize) -> list[int]:
    """Return columns, rows and the size of a cell, as before where the terminal does not tell pixels."""
    rows, columns, width, height = struct.unpack("HHHH", fcntl.ioctl(0, termios.TIOCGWINSZ, bytes(8)))
    return [columns, rows, *((width // columns, height // rows) if width and height else before.cell_size)]


def modes() -> str:
    """Return the settings of the tty, without the size that the first line tells."""
    told = subprocess.run(["stty", "-a"], check=True, stdin=0, capture_output=True, text=True).stdout
    return told.partition("\n")[2]


def save(path: Path, text: str) -> None:
    """Write a file that is whole from the moment it is there."""
    unfinished = path.with_suffix(".unfinished")
    unfinished.write_text(text)
    unfinished.rename(path)


def wait_for(path: Path) -> None:
    """Return when the file is there; give up together with the tests."""
    end = time.monotonic() + PATIENCE
    while not path.exists() and time.monotonic() < end and os.getppid() > 1:
        time.sleep(0.02)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
