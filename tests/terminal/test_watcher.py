"""Whatever ends a session, the terminal is given back, and the exit status says what it was."""

from __future__ import annotations

import os
import re
import signal
import sys
import time
from pathlib import Path

import pytest

from tests.terminal.ptys import DEADLINE, Terminal
from tests.terminal.test_session import BASH, ECHO, KITTY, LEFT, assert_whole_again, shell_settings, started

DEADLY = ["QUIT", "ILL", "TRAP", "ABRT", "BUS", "FPE", "USR1", "SEGV", "USR2", "ALRM", "VTALRM", "PROF"]
DEADLY += ["XCPU", "SYS"] + ["RTMIN", "RTMAX"] * hasattr(signal, "SIGRTMIN")

FAULTS = {
    "no such address": ("import ctypes; ctypes.string_at(0)", signal.SIGSEGV),
    "abort": ("import os; os.abort()", signal.SIGABRT),
    "a map of a file that shrank": (
        "import mmap, os, tempfile; file = tempfile.TemporaryFile(); file.truncate(9999);"
        "memory = mmap.mmap(file.fileno(), 9999); file.truncate(0); memory[5000]",
        signal.SIGBUS,
    ),
    "a thread": (
        "import ctypes, threading, time;"
        "threading.Thread(target=ctypes.string_at, args=(0,)).start(); time.sleep(9)",
        signal.SIGSEGV,
    ),
}
"""Ways to die that nobody sends."""


def when_ready(statement: str) -> str:
    return ECHO.replace("    running = True\n", f"    exec({statement!r})\n    running = True\n")


def until_restored(terminal: Terminal) -> None:
    """Wait until somebody has set the terminal back."""
    deadline = time.monotonic() + DEADLINE
    while terminal.attributes() != terminal.before:
        assert time.monotonic() < deadline
        time.sleep(0.005)


@pytest.mark.parametrize("name", DEADLY)
def test_a_deadly_signal_waits_until_the_terminal_was_given_back(name: str) -> None:
    number = getattr(signal, f"SIG{name}")
    with Terminal.python(ECHO) as terminal:
        ready = started(terminal, KITTY)
        terminal.process.send_signal(number)
        assert terminal.wait() == -number
        assert_whole_again(terminal, ready)
        assert terminal.seen[ready:].count(b"\x1b[<u") == 1
        assert terminal.seen.endswith(LEFT)


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_gives_the_terminal_back_first(name: str) -> None:
    statement, number = FAULTS[name]
    with Terminal.python(when_ready(statement)) as terminal:
        ready = started(terminal)
        assert terminal.wait() == -number
        assert_whole_again(terminal, ready)


@pytest.mark.parametrize("end", ["import os; os._exit(3)", "import os; os.kill(os.getpid(), 9)"])
def test_an_end_that_nothing_can_delay_is_followed_by_the_terminals_own(end: str) -> None:
    with Terminal.python(when_ready(end)) as terminal:
        ready = started(terminal)
        assert terminal.wait() in (3, -signal.SIGKILL)
        terminal.wait_for(LEFT, start=ready)
        until_restored(terminal)
        assert_whole_again(terminal, ready)


def test_a_shell_that_takes_the_terminal_meanwhile_keeps_it(tmp_path: Path) -> None:
    script = tmp_path / "echo.py"
    script.write_text("import os; print('pid', os.getpid(), 'pid')\n" + ECHO)
    with Terminal.python(BASH, {"HOME": str(tmp_path), "PS1": "prompt> "}) as shell:
        before = shell_settings(shell, 0)
        shell.type(f"{sys.executable} {script}\n".encode())
        end = started(shell)
        os.kill(int(re.findall(rb"pid (\d+) pid", shell.seen)[-1]), signal.SIGKILL)
        shell.wait_for(LEFT, start=end)
        assert shell_settings(shell, end) == before
        # The next line is edited by the shell, so nothing is shown twice.
        end = shell.wait_for(b"prompt> ", start=shell.seen.rindex(b"settings2="))
        shell.type(b"true\n")
        shell.wait_for(b"prompt> ", start=end)
        assert shell.seen[end:].count(b"true") == 1


def test_once_the_terminal_was_given_back_nothing_more_is_written(tmp_path: Path) -> None:
    script = tmp_path / "echo.py"
    script.write_text("import os; print('pid', os.getpid(), 'pid')\n" + ECHO)
    with Terminal.python(BASH, {"HOME": str(tmp_path), "PS1": "prompt> "}) as shell:
        shell.type(f"{sys.executable} {script}\n".encode())
        end = started(shell)
        shell.type(b"\x1a")
        end = shell.wait_for(LEFT, b"Stopped", b"prompt> ", start=end)
        shell.type(b"kill -9 %1; wait; echo ended$((1 + 1))\n")
        last = shell.wait_for(b"ended2", b"prompt> ", start=end)
        assert b"\x1b[?1049l" not in shell.seen[end:last]


def test_no_process_stays_when_a_session_ends() -> None:
    script = ECHO.replace('b"<ready>"', 'b"<%d><ready>" % session._watcher._pid')
    with Terminal.python(script) as terminal:
        ready = started(terminal)
        pid = int(re.findall(rb"<(\d+)><ready>", terminal.seen[:ready])[0])
        os.kill(pid, 0)
        terminal.type(b"q")
        assert terminal.wait() == 0
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


NONE = "import tsplat.terminal.watcher as watcher\nwatcher.{} = {!r}\n"


@pytest.mark.parametrize(
    ("name", "value"), [("SHELL", "/nowhere/sh"), ("_SCRIPT", "exit 3"), ("_SCRIPT", "kill -9 $$")]
)
def test_where_there_is_no_such_process_a_session_is_as_before(name: str, value: str) -> None:
    with Terminal.python(NONE.format(name, value) + ECHO) as terminal:
        ready = started(terminal)
        terminal.type(b"q")
        assert terminal.wait() == 0
        assert_whole_again(terminal, ready)


def test_no_program_in_the_current_folder_is_run(tmp_path: Path) -> None:
    for name in ("stty", "printf", "sh"):
        (tmp_path / name).write_text("#!/bin/sh\ntouch RAN\n")
        (tmp_path / name).chmod(0o755)
    path = f".::{os.environ['PATH']}"
    with Terminal.python(f"import os; os.chdir({str(tmp_path)!r})\n" + ECHO, {"PATH": path}) as terminal:
        ready = started(terminal)
        terminal.process.send_signal(signal.SIGSEGV)
        assert terminal.wait() == -signal.SIGSEGV
        assert_whole_again(terminal, ready)
    assert not (tmp_path / "RAN").exists()


def test_signals_that_somebody_handles_are_left_to_him() -> None:
    own = "import signal\nsignal.signal(signal.SIGUSR1, lambda *_: print('<mine>', flush=True))\n"
    own += "signal.signal(signal.SIGUSR2, signal.SIG_IGN)\n"
    after = "\nimport os\nos.kill(os.getpid(), signal.SIGUSR1)\nos.kill(os.getpid(), signal.SIGQUIT)\n"
    with Terminal.python(own + ECHO + after) as terminal:
        end = started(terminal)
        terminal.process.send_signal(signal.SIGUSR2)
        terminal.process.send_signal(signal.SIGUSR1)
        end = terminal.wait_for(b"<mine>", start=end)
        terminal.type(b"q")
        terminal.wait_for(LEFT, b"<mine>", start=end)
        assert terminal.wait() == -signal.SIGQUIT
        assert terminal.seen.count(LEFT) == 1


def test_what_else_tells_of_a_fault_still_does_on_the_shells_screen() -> None:
    with Terminal.python(
        "import faulthandler; faulthandler.enable()\n" + when_ready(FAULTS["abort"][0])
    ) as terminal:
        started(terminal)
        assert terminal.wait() == -signal.SIGABRT
        assert b"Fatal Python error: Aborted" in terminal.seen.rpartition(LEFT)[2]


def test_a_fault_while_a_terminal_is_only_asked_gives_it_back() -> None:
    script = "import os\nfrom tsplat.terminal.interview import interview\ninterview(os.environ)"
    with Terminal.python(script) as terminal:
        terminal.wait_for(b"\x1b[c")
        assert terminal.attributes() != terminal.before
        terminal.process.send_signal(signal.SIGSEGV)
        assert terminal.wait() == -signal.SIGSEGV
        assert terminal.attributes() == terminal.before
