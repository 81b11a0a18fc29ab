"""Commands that a signal ends leave nothing behind, whatever they write and wherever they get scenes from."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals are POSIX'")

COMMANDS = {
    "convert": ["convert", "-", "out.ply"],
    "optimize": ["optimize", "-", "-o", "out.tsplat"],
    "record": ["record", "out.gif", "-"],
    "record a cast": ["record", "out.cast", "-"],
    "render": ["render", "-", "-o", "out.png"],
    "info": ["info", "-"],
    "bench": ["bench", "-"],
    "view": ["-"],
}
"""They wait for a scene on standard input, so they have begun all that is begun before one is read."""

PLACES = "temporary/tsplat-*/*"
"""Where what comes from standard input is laid."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with one for temporary files in it, and old files."""
    (tmp_path / "temporary").mkdir()
    for suffix in ("ply", "tsplat", "gif", "cast", "png"):
        (tmp_path / f"out.{suffix}").write_bytes(b"old")
    return tmp_path


def waiting(command: list[str], folder: Path) -> subprocess.Popen[bytes]:
    """Start a command, and wait until it waits for its scene."""
    there = set(folder.glob(PLACES))
    process = subprocess.Popen(
        [sys.executable, "-m", "tsplat", *command],
        cwd=folder,
        env={**os.environ, "TMPDIR": str(folder / "temporary")},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    end = time.monotonic() + 60
    while not set(folder.glob(PLACES)) - there:
        assert process.poll() is None
        assert time.monotonic() < end
        time.sleep(0.01)
    return process


def left(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("command", "number"),
    [*((command, signal.SIGTERM) for command in COMMANDS), ("convert", signal.SIGHUP), ("render", signal.SIGHUP)],
)
def test_a_command_that_is_ended_leaves_nothing_behind(folder: Path, command: str, number: signal.Signals) -> None:
    before = left(folder)
    process = waiting(COMMANDS[command], folder)
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (128 + number, b"", b"")
    assert left(folder) == before
    assert not list(folder.glob("temporary/*"))


@pytest.mark.parametrize("command", ["convert", "optimize", "record"])
def test_what_a_command_leaves_that_is_killed_goes_with_the_next(folder: Path, command: str) -> None:
    before = left(folder)
    process = waiting(COMMANDS[command], folder)
    process.kill()
    process.communicate(timeout=60)
    assert len(left(folder)) == len(before) + 2
    process = waiting(COMMANDS[command], folder)
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=60)
    assert left(folder) == before
    assert not list(folder.glob("temporary/*"))


def test_a_signal_that_whoever_started_it_ignores_stays_ignored(folder: Path) -> None:
    """As `nohup` does."""
    code = "import signal, sys; signal.signal(signal.SIGHUP, signal.SIG_IGN); from tsplat.cli import main; "
    process = subprocess.Popen(
        [sys.executable, "-c", code + "sys.exit(main(sys.argv[1:]))", "convert", "-", "out.ply"],
        cwd=folder,
        env={**os.environ, "TMPDIR": str(folder / "temporary")},
        stdin=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    while not list(folder.glob(PLACES)):
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGHUP)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 2
    assert b"standard input" in err
