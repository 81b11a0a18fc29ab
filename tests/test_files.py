"""Files that are whole or not there at all."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from tsplat.errors import SaveError, TerminalError
from tsplat.files import replacing, tidy_end


def test_the_file_is_there_only_when_all_went_well(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"old")
    with replacing(path) as file:
        file.write(b"new")
        assert path.read_bytes() == b"old"
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ZeroDivisionError, SystemExit])
def test_whatever_ends_the_writing_leaves_the_old_file(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"old")

    def write_half() -> None:
        with replacing(path) as file:
            file.write(b"half")
            raise error

    with pytest.raises(error):
        write_half()
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_an_error_that_is_not_about_the_file_keeps_its_words(tmp_path: Path) -> None:
    with pytest.raises(TerminalError, match=r"^the terminal went away$"), replacing(tmp_path / "x"):
        raise TerminalError("the terminal went away")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["none/x", ""])
def test_a_place_that_takes_no_file_is_known_before_anything_is_done(tmp_path: Path, name: str) -> None:
    reached = False
    with pytest.raises(SaveError, match="cannot be written"), replacing(tmp_path / name):
        reached = True
    assert not reached


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_that_ends_the_process_leaves_no_half_file(tmp_path: Path, number: signal.Signals) -> None:
    def write_half() -> None:
        with tidy_end(), replacing(tmp_path / "x") as file:
            file.write(b"half")
            os.kill(os.getpid(), number)

    before = signal.signal(number, signal.SIG_DFL)
    try:
        with pytest.raises(SystemExit) as caught:
            write_half()
        assert signal.getsignal(number) is signal.SIG_DFL
    finally:
        signal.signal(number, before)
    assert caught.value.code == 128 + number
    assert not list(tmp_path.iterdir())


def test_a_signal_that_somebody_ignores_or_heeds_stays_theirs() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with tidy_end():
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_signals_are_left_alone_on_other_threads() -> None:
    failed: list[BaseException] = []

    def end() -> None:
        try:
            with tidy_end():
                pass
        except ValueError as error:
            failed.append(error)

    thread = threading.Thread(target=end)
    thread.start()
    thread.join()
    assert not failed


def test_a_thread_that_nobody_waits_for_leaves_nothing_behind(tmp_path: Path) -> None:
    code = f"""
import threading
from pathlib import Path
from tsplat.files import replacing
written = threading.Event()
def write():
    with replacing(Path({str(tmp_path / "x")!r})) as file:
        file.write(b"half")
        file.flush()
        written.set()
        threading.Event().wait()
threading.Thread(target=write, daemon=True).start()
assert written.wait(10.0)
assert list(Path({str(tmp_path)!r}).iterdir())
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
    assert list(tmp_path.iterdir()) == []
