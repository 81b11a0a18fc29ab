"""Writing to a terminal that reads slowly, or not at all: nobody reads from these but when the test says so."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from tests.terminal.ptys import DEADLINE, Terminal
from tests.terminal.test_session import ECHO, KITTY, LEFT, assert_whole_again, started

LARGE = 1_000_000
WRITE_LARGE = f"""
from pathlib import Path
from tsplat.errors import TerminalError
from tsplat.terminal import Session, session as module
with Session() as session:
    session.write(b"<ready>")
    session.events(30)
    session.write(b"<large>" + b"A" * {LARGE} + b"<end>")
    session.write(b"<%d keys>" % len(session.events(0)))
"""


def type_all(terminal: Terminal, keys: bytes) -> None:
    """Type more than the terminal's input holds, so that all of it is taken only if someone reads it."""
    os.set_blocking(terminal.master, False)
    deadline = time.monotonic() + DEADLINE
    while keys:
        try:
            keys = keys[os.write(terminal.master, keys) :]
        except BlockingIOError:
            assert time.monotonic() < deadline, f"{len(keys)} keys were not read"
            time.sleep(0.01)


def wait_until(path: Path) -> None:
    deadline = time.monotonic() + DEADLINE
    while not path.exists():
        assert time.monotonic() < deadline, f"{path.name} was not written"
        time.sleep(0.01)


def test_keys_are_read_while_the_terminal_takes_nothing_and_kept_for_later() -> None:
    with Terminal.python(WRITE_LARGE) as terminal:
        started(terminal)
        terminal.type(b"g")
        terminal.wait_for(b"<large>")
        type_all(terminal, b"w" * 20_000)
        end = terminal.wait_for(b"A" * LARGE, b"<end>", b" keys>")
        assert int(terminal.seen[:end].rpartition(b"<")[2].split()[0]) == 20_000
        assert terminal.wait() == 0


def test_a_terminal_that_takes_nothing_for_long_ends_the_session_and_is_given_back(tmp_path: Path) -> None:
    said = tmp_path / "said"
    script = WRITE_LARGE.replace("with Session", "module.STALL_SECONDS = 0.6\ntry:\n  with Session")
    head, _, body = script.partition("as session:\n")
    body = "".join(f"    {line}\n" for line in body.splitlines())
    end = f"except TerminalError as error:\n  Path({str(said)!r}).write_text(str(error))\n"
    with Terminal.python(f"{head}as session:\n{body}{end}") as terminal:
        ready = started(terminal)
        terminal.type(b"g")
        terminal.wait_for(b"<large>")
        wait_until(said)
        assert said.read_text() == "the terminal has taken nothing for 1 s"
        assert terminal.wait() == 0
        assert b"<end>" not in terminal.seen
        assert_whole_again(terminal, ready)


def test_a_signal_ends_a_write_that_the_terminal_does_not_take() -> None:
    with Terminal.python(WRITE_LARGE) as terminal:
        ready = started(terminal)
        terminal.type(b"g")
        terminal.wait_for(b"<large>")
        terminal.process.send_signal(signal.SIGTERM)
        assert terminal.process.wait(DEADLINE) == 128 + signal.SIGTERM
        terminal.wait_for(LEFT, start=ready)
        assert_whole_again(terminal, ready)


def test_a_resize_during_a_write_does_not_get_into_the_middle_of_it() -> None:
    with Terminal.python(WRITE_LARGE) as terminal:
        terminal.wait_for(b"\x1b[c")
        terminal.type(b"\x1b[6;20;10t\x1b[?62c")
        ready = terminal.wait_for(b"<ready>")
        terminal.type(b"g")
        terminal.wait_for(b"<large>")
        terminal.resize(100, 30)
        terminal.wait_for(b"A" * LARGE + b"<end>", b"\x1b[16t", b"<1 keys>", start=ready)
        assert terminal.wait() == 0


def test_the_shell_s_open_file_stays_blocking() -> None:
    flags = "import os\nbefore = [os.get_blocking(fd) for fd in (0, 1, 2)]\n"
    says = 'session.write(b"<%r %r>" % (before, [os.get_blocking(fd) for fd in (0, 1, 2)])); '
    script = ECHO.replace("session.write(b", says + "session.write(b", 1)
    with Terminal.python(flags + script) as terminal:
        started(terminal)
        assert b"<[True, True, True] [True, True, True]>" in terminal.seen


def test_a_terminal_without_a_name_is_written_to_all_the_same() -> None:
    nameless = """
import os
def fails(*_): raise OSError
os.ttyname = os.tcgetpgrp = fails
"""
    with Terminal.python(nameless + WRITE_LARGE) as terminal:
        started(terminal)
        terminal.type(b"g")
        terminal.wait_for(b"<large>", b"A" * LARGE, b"<end>")
        assert terminal.wait() == 0


def test_an_answer_to_a_frame_is_an_event_and_one_that_comes_after_the_end_is_not_left_to_the_shell() -> None:
    script = """
import os, select
from tsplat.terminal import Session, session as module
module.REMOTE_SECONDS = 1000.0
with Session() as session:
    session.write(b"<ready>" + session.question)
    session.write(repr(session.events(30)).encode())
    session.write(b"<again>" + session.question)
os.write(1, b"left: %r" % select.select([0], [], [], 0.2)[0])
"""
    with Terminal.python(script, {"SSH_TTY": "1"}) as terminal:
        started(terminal)
        terminal.wait_for(b"\x1b[5n")
        terminal.type(b"\x1b[0n")
        terminal.wait_for(b"[Answered()]", b"<again>\x1b[5n", LEFT)
        terminal.type(b"\x1b[0n\n")
        terminal.wait_for(b"left: []")
        assert terminal.wait() == 0


def test_answers_that_come_late_while_the_terminal_takes_nothing_count_with_the_next_events() -> None:
    script = WRITE_LARGE.replace("len(session.events(0))", "session.profile.kitty_keyboard")
    script = script.replace('session.write(b"<%d', 'session.events(0); session.write(b"<%d')
    with Terminal.python(script) as terminal:
        terminal.wait_for(b"<ready>")
        terminal.type(b"g")
        terminal.wait_for(b"<large>")
        type_all(terminal, b"w" * 5_000 + KITTY)
        end = terminal.wait_for(b"A" * LARGE, b"<end>", b"\x1b[>31u", b"<1 keys>")
        assert b"\x1b[>31u" not in terminal.seen[: terminal.seen.index(b"<end>", end - 200)]
        assert terminal.wait() == 0
