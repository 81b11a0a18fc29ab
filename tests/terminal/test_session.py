from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.terminal.ptys import Terminal

ECHO = """
from tsplat.terminal import Session
with Session() as session:
    session.write(b"<ready>")
    running = True
    while running:
        for event in session.events(30):
            session.write(repr(event).encode() + b"<")
            running = running and getattr(event, "name", "") != "q"
            if getattr(event, "name", "") == "ctrl+z":
                session.suspend()
"""
KITTY = b"\x1bP>|kitty(0.26.5)\x1b\\\x1b[6;20;10t\x1b[?2026;2$y\x1b[?1016;2$y\x1b[?0u\x1b_Gi=31;OK\x1b\\\x1b[?62;c"
PLAIN = b"\x1b[?62c"
ENTERED = b"\x1b[?1049h"
LEFT = b"\x1b[?1049l"


def started(terminal: Terminal, replies: bytes = PLAIN) -> int:
    """Answer the questions and wait until the session is ready."""
    terminal.wait_for(b"\x1b[c")
    terminal.type(replies)
    return terminal.wait_for(b"<ready>")


def assert_whole_again(terminal: Terminal, after: int = 0) -> None:
    """What was turned on is off, in the order that gives the shell its screen back last."""
    assert terminal.attributes() == terminal.before
    end = terminal.seen[after:]
    order = [b"\x1b[?2004l", b"\x1b[?1004l", b"\x1b[?1006l", b"\x1b[?1002l", b"\x1b[?7h", b"\x1b[?25h", LEFT]
    places = [end.rindex(text) for text in order]
    assert places == sorted(places)
    assert b"\x1b[2J" not in end[places[-1] :]
    assert b"\x1b[J" not in end[places[-1] :]


def test_a_session_takes_the_terminal_and_gives_it_back() -> None:
    with Terminal.python(ECHO) as terminal:
        ready = started(terminal)
        assert terminal.attributes() != terminal.before
        on = terminal.seen[:ready]
        for mode in (ENTERED, b"\x1b[?25l", b"\x1b[?7l", b"\x1b[?1002h", b"\x1b[?1006h"):
            assert on.count(mode) == 1
        terminal.type(b"q")
        assert terminal.wait() == 0
        assert_whole_again(terminal, ready)
        assert terminal.seen.endswith(LEFT)
        assert b"\x1b\\" not in terminal.seen[ready:]


def test_an_exception_restores_the_terminal_before_its_traceback() -> None:
    script = ECHO.replace('session.write(b"<ready>")', 'session.write(b"<ready>"); raise RuntimeError("broken")')
    with Terminal.python(script) as terminal:
        ready = started(terminal)
        assert terminal.wait() == 1
        assert_whole_again(terminal, ready)
        assert b"broken" in terminal.seen.partition(LEFT)[2]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_restores_the_terminal_and_shows_in_the_exit_status(number: signal.Signals) -> None:
    with Terminal.python(ECHO) as terminal:
        ready = started(terminal)
        terminal.process.send_signal(number)
        assert terminal.wait() == 128 + number
        assert_whole_again(terminal, ready)


@pytest.mark.parametrize(("name", "sign"), [("SIGWINCH", b"Resize("), ("SIGTERM", LEFT)])
def test_a_signal_that_reaches_another_thread_still_wakes_the_session(name: str, sign: bytes) -> None:
    thread = f"""
import signal, threading
def strike():
    import select
    signal.pthread_kill(threading.get_ident(), signal.{name})
    select.select([], [], [], 60)
"""
    start = 'session.write(b"<ready>"); threading.Timer(0.1, strike).start()'
    with Terminal.python(thread + ECHO.replace('session.write(b"<ready>")', start)) as terminal:
        terminal.wait_for(sign, start=started(terminal))


def test_a_signal_in_the_middle_of_a_large_write_ends_the_picture_first() -> None:
    script = ECHO.replace(
        'session.write(b"<ready>")', 'session.write(b"<ready>" + b"\\x1b_G;" + b"A" * 10_000_000)'
    )
    with Terminal.python(script) as terminal:
        started(terminal)
        terminal.process.send_signal(signal.SIGTERM)
        assert terminal.wait() == 128 + signal.SIGTERM
        assert b"A\x1b\\\x1b[?2026l" in terminal.seen
        assert_whole_again(terminal)


def test_a_signal_while_the_questions_are_open_restores_the_terminal() -> None:
    with Terminal.python(ECHO, {"SSH_TTY": "1"}) as terminal:
        terminal.wait_for(b"\x1b[c")
        terminal.process.send_signal(signal.SIGTERM)
        assert terminal.wait() == 128 + signal.SIGTERM
        assert terminal.attributes() == terminal.before
        assert terminal.seen.endswith(LEFT)


def test_a_terminal_that_goes_away_ends_the_program() -> None:
    terminal = Terminal.python(ECHO)
    started(terminal)
    os.close(terminal.master)
    os.close(terminal.slave)
    assert terminal.process.wait(20) in (1, 128 + signal.SIGHUP)


def test_keys_typed_while_the_questions_are_open_arrive_and_answers_do_not() -> None:
    with Terminal.python(ECHO) as terminal:
        terminal.wait_for(b"\x1b[c")
        terminal.type(b"w" + PLAIN)
        end = terminal.wait_for(b"<ready>", b"Key(name='w', action='press')<")
        assert terminal.seen[:end].count(b"Key(") == 1
        terminal.type(b"q")
        assert terminal.wait() == 0


def test_a_terminal_that_answers_nothing_is_used_all_the_same() -> None:
    with Terminal.python(ECHO) as terminal:
        terminal.wait_for(b"<ready>")
        terminal.type(b"q")
        assert terminal.wait() == 0
        assert b"\x1b[>31u" not in terminal.seen


def test_the_kitty_keyboard_and_the_pixel_mouse_are_used_where_announced_and_undone() -> None:
    with Terminal.python(ECHO) as terminal:
        ready = started(terminal, KITTY)
        assert terminal.seen.count(b"\x1b[>31u") == terminal.seen.count(b"\x1b[?1016h") == 1
        terminal.type(b"\x1b[<0;26;11M\x1b[119;1:3u")
        terminal.wait_for(b"Mouse(action='press', button='left', x=2.5, y=0.5", b"Key(name='w', action='release')")
        terminal.type(b"\x1b[113u")
        assert terminal.wait() == 0
        off = terminal.seen[ready:]
        assert off.count(b"\x1b[<u") == off.count(b"\x1b[?1016l") == off.count(b"\x1b_Ga=d,d=A") == 1
        assert off.index(b"\x1b[<u") < off.index(LEFT)
        assert_whole_again(terminal, ready)


def test_ctrl_c_is_a_key_and_escape_alone_is_one_too() -> None:
    with Terminal.python(ECHO) as terminal:
        started(terminal)
        terminal.type(b"\x03")
        end = terminal.wait_for(b"Key(name='ctrl+c', action='press')<")
        terminal.type(b"\x1b")
        terminal.wait_for(b"Key(name='escape', action='press')<", start=end)
        terminal.type(b"q")
        assert terminal.wait() == 0


def test_a_resize_arrives_with_the_size_and_the_cells_that_the_terminal_says() -> None:
    with Terminal.python(ECHO) as terminal:
        ready = started(terminal, KITTY)
        terminal.resize(100, 30)
        old_cell = b"Resize(size=TerminalSize(columns=100, rows=30, cell_width=10, cell_height=20))<"
        terminal.wait_for(b"\x1b[16t", old_cell, start=ready)
        terminal.type(b"\x1b[6;30;15t")
        terminal.wait_for(b"Resize(size=TerminalSize(columns=100, rows=30, cell_width=15, cell_height=30))<")
        terminal.type(b"q")
        assert terminal.wait() == 0


@pytest.mark.parametrize(
    ("replies", "pixels", "cell"),
    [
        (b"\x1b[4;480;800t\x1b[?62c", (0, 0), (10, 20)),
        (b"\x1b[?62c", (640, 384), (8, 16)),
        (b"\x1b[6;18;9t\x1b[4;480;800t\x1b[?62c", (640, 384), (9, 18)),
        (b"\x1b[?62c", (0, 0), (0, 0)),
    ],
)
def test_a_cell_is_what_16t_says_else_14t_else_the_window(
    replies: bytes, pixels: tuple[int, int], cell: tuple[int, int]
) -> None:
    script = "from tsplat.terminal import Session\nwith Session() as it: it.write(repr(it.size()).encode())"
    with Terminal.python(script) as terminal:
        terminal.resize(80, 24, *pixels)
        terminal.wait_for(b"\x1b[c")
        terminal.type(replies)
        terminal.wait_for(b"columns=80, rows=24, cell_width=%d, cell_height=%d" % cell)
        assert terminal.wait() == 0


def test_a_new_size_may_come_like_a_key_before_the_kernel_knows_it() -> None:
    with Terminal.python(ECHO) as terminal:
        ready = started(terminal, b"\x1b[?2048;2$y" + KITTY)
        assert b"\x1b[?2048h" in terminal.seen[:ready]
        # Terminals report the size at once when told to; that is no news.
        terminal.type(b"\x1b[48;24;80;480;800t" + b"w")
        first = terminal.wait_for(b"Key(name='w', action='press')<", start=ready)
        assert b"Resize" not in terminal.seen[ready:first]
        terminal.type(b"\x1b[48;30;100;900;1500t")
        size = b"Resize(size=TerminalSize(columns=100, rows=30, cell_width=15, cell_height=30))<"
        reported = terminal.wait_for(size, start=first)
        terminal.resize(90, 20)
        terminal.wait_for(b"Resize(size=TerminalSize(columns=90, rows=20, cell_width=15", start=reported)
        terminal.type(b"q")
        assert terminal.wait() == 0
        assert terminal.seen.count(b"\x1b[?2048l") == 1


def test_pasted_text_is_no_keys() -> None:
    with Terminal.python(ECHO) as terminal:
        ready = started(terminal)
        assert b"\x1b[?2004h" in terminal.seen[:ready]
        terminal.type(b"\x1b[200~q quits\r\x03\x1b[201~w")
        end = terminal.wait_for(b"<", start=ready)
        assert terminal.seen[ready:end] == b"Key(name='w', action='press')<"
        terminal.type(b"q")
        assert terminal.wait() == 0


def test_answers_that_come_late_are_no_keys_and_still_count() -> None:
    script = ECHO.replace("repr(event)", "repr((session.profile.program, event))")
    with Terminal.python(script) as terminal:
        ready = terminal.wait_for(b"<ready>")
        assert b"\x1b[>31u" not in terminal.seen
        terminal.type(KITTY[:30])
        terminal.type(KITTY[30:])
        end = terminal.wait_for(
            b"\x1b[>31u", b"('kitty', Resize(size=TerminalSize(columns=80, rows=24, cell_width=10", start=ready
        )
        assert b"Key(" not in terminal.seen[:end]
        terminal.type(b"q")
        assert terminal.wait() == 0
        assert terminal.seen.count(b"\x1b[?1002h") == terminal.seen.count(b"\x1b[>31u") == 1
        assert terminal.seen.count(b"\x1b[<u") == 1
        assert_whole_again(terminal, ready)


BASH = """
import os
assert os.path.exists("/bin/bash"), "install the Debian package bash"
os.execv("/bin/bash", ["bash", "--norc", "--noprofile", "-i"])
"""


def shell_settings(shell: Terminal, end: int) -> bytes:
    """Return the terminal's settings as the shell's children see them."""
    # Input typed before the prompt may be dropped with what the session did not read.
    end = shell.wait_for(b"prompt> ", start=end)
    shell.type(b"echo settings$((1 + 1))=$(stty -g)=\n")
    start = shell.wait_for(b"settings2=", start=end)
    return shell.seen[start : shell.wait_for(b"=", start=start)]


def test_ctrl_z_gives_the_shell_its_terminal_and_fg_takes_it_again(tmp_path: Path) -> None:
    script = tmp_path / "echo.py"
    script.write_text(ECHO)
    with Terminal.python(BASH, {"HOME": str(tmp_path), "PS1": "prompt> "}) as shell:
        before = shell_settings(shell, 0)
        shell.type(f"{sys.executable} {script}\n".encode())
        end = started(shell)
        shell.type(b"\x1a")
        end = shell.wait_for(b"ctrl+z", LEFT, b"Stopped", start=end)
        assert shell_settings(shell, end) == before
        end = shell.wait_for(b"prompt> ", start=shell.seen.rindex(b"settings2="))
        shell.type(b"fg\n")
        end = shell.wait_for(ENTERED, b"\x1b[?1002h", b"Resize(size=TerminalSize(columns=80", start=end)
        shell.type(b"w")
        end = shell.wait_for(b"Key(name='w', action='press')<", start=end)
        shell.type(b"q")
        end = shell.wait_for(b"\x1b[?1002l", LEFT, start=end)
        assert shell_settings(shell, end) == before


@pytest.mark.parametrize("stop", [signal.SIGTSTP, signal.SIGSTOP])
def test_a_stop_from_outside_ends_with_the_terminal_taken_again(stop: signal.Signals, tmp_path: Path) -> None:
    script = tmp_path / "echo.py"
    script.write_text("import os; print('pid', os.getpid(), 'pid')\n" + ECHO)
    with Terminal.python(BASH, {"HOME": str(tmp_path), "PS1": "prompt> "}) as shell:
        before = shell_settings(shell, 0)
        shell.type(f"{sys.executable} {script}\n".encode())
        end = started(shell)
        os.kill(int(re.findall(rb"pid (\d+) pid", shell.seen)[-1]), stop)
        end = shell.wait_for(b"Stopped", b"prompt> ", start=end)
        shell.type(b"fg\n")
        end = shell.wait_for(ENTERED, b"Resize(size=TerminalSize(columns=80", start=end)
        shell.type(b"q")
        end = shell.wait_for(LEFT, start=end)
        assert shell_settings(shell, end) == before


def test_no_terminal_is_one_clear_line() -> None:
    script = "from tsplat.terminal import Session\nwith Session(): pass"
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, stdin=subprocess.DEVNULL, text=True)
    assert ran.returncode == 1
    assert ran.stderr.splitlines()[-1].startswith("tsplat.errors.TerminalError: standard output is not a terminal")


def test_keys_come_from_the_terminal_when_standard_input_is_a_file() -> None:
    script = 'import os; os.dup2(os.open("/dev/null", os.O_RDONLY), 0)\n' + ECHO
    with Terminal.python(script) as terminal:
        started(terminal)
        terminal.type(b"q")
        assert terminal.wait() == 0
        assert_whole_again(terminal)


def test_importing_asks_the_terminal_nothing() -> None:
    with Terminal.python("import tsplat.terminal, tsplat.encode; print('imported')") as terminal:
        assert terminal.wait() == 0
        assert terminal.seen == b"imported\r\n"
