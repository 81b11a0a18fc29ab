from __future__ import annotations

import os
import subprocess
import tempfile
from base64 import b64decode
from multiprocessing import shared_memory
from pathlib import Path

import pytest

from tsplat.terminal.hearing import LOCAL_SECONDS, REMOTE_SECONDS, Hearing, ask
from tsplat.terminal.multiplexer import ask_tmux
from tsplat.terminal.questions import questions
from tsplat.terminal.trials import Trials

ASKED = questions({"TERM": "xterm"})
VERSION, DA1 = b"\x1bP>|kitty(1)\x1b\\", b"\x1b[?62;4c"


def test_listening_ends_with_the_last_answer() -> None:
    hearing = Hearing(ASKED, remote=False)
    hearing.take(VERSION + b"\x1b[?0u", 0.01)
    assert hearing.left(0.01) > 0
    hearing.take(DA1[:3], 0.02)
    assert not hearing.answered
    hearing.take(DA1[3:], 0.03)
    assert hearing.left(0.03) == 0


def test_a_terminal_on_this_machine_has_150_ms_in_all() -> None:
    hearing = Hearing(ASKED, remote=False)
    hearing.take(VERSION, 0.1)
    assert hearing.left(0.1) == pytest.approx(0.05)
    assert hearing.left(LOCAL_SECONDS) == 0
    assert LOCAL_SECONDS == 0.15


def test_a_terminal_far_away_has_three_times_the_time_of_its_first_answer() -> None:
    hearing = Hearing(ASKED, remote=True)
    assert hearing.left(0.0) == REMOTE_SECONDS == 1.5
    hearing.take(b"w", 0.1)
    assert hearing.left(0.1) == pytest.approx(1.4)
    hearing.take(VERSION, 0.3)
    hearing.take(b"\x1b[?0u", 0.8)
    assert hearing.left(0.8) == pytest.approx(0.1)


def test_a_quick_terminal_far_away_has_no_less_time_than_a_near_one() -> None:
    hearing = Hearing(ASKED, remote=True)
    hearing.take(VERSION, 0.001)
    assert hearing.left(0.0) == LOCAL_SECONDS


def test_an_answer_took_as_long_as_its_last_byte() -> None:
    hearing = Hearing(ASKED, remote=False)
    hearing.take(VERSION + DA1[:2], 0.02)
    hearing.take(DA1[2:], 0.05)
    answers = {question.name: hearing.answer(question) for question in ASKED}
    assert answers["XTVERSION"] == (VERSION, 0.02)
    assert answers["DA1"] == (DA1, 0.05)
    assert answers["cell 16t"] is None


def test_all_is_asked_in_one_write_and_what_was_tried_is_gone_afterwards() -> None:
    written: list[bytes] = []
    hearing = ask({"TERM": "xterm"}, written.append, lambda _: DA1)
    assert len(written) == 1
    assert hearing.replies == DA1
    names = {question.name: question for question in hearing.questions}
    assert written[0].index(names["kitty shared"].asks) < written[0].index(names["DA1"].asks)
    path = b64decode(names["kitty file"].asks.split(b";")[1].rstrip(b"\x1b\\"))
    assert not os.path.exists(path)


def payload(trials: Trials, name: str) -> str:
    asks = next(question.asks for question in trials.questions if question.name == name)
    return b64decode(asks.split(b";")[1].removesuffix(b"\x1b\\")).decode()


def test_a_terminal_finds_one_pixel_in_shared_memory_and_in_a_file_it_may_delete() -> None:
    with Trials({"TERM": "xterm"}) as trials:
        memory = shared_memory.SharedMemory(payload(trials, "kitty shared"))
        assert memory.buf is not None
        assert bytes(memory.buf[:3]) == bytes(3)
        memory.close()
        path = Path(payload(trials, "kitty file"))
        assert path.read_bytes() == bytes(3)
        assert path.parent == Path(tempfile.gettempdir())
        assert "tty-graphics-protocol" in path.name
        assert [b",t=s;" in question.asks for question in trials.questions] == [True, False]
        assert [b",t=t;" in question.asks for question in trials.questions] == [False, True]
        name = payload(trials, "kitty shared")
    assert not path.exists()
    with pytest.raises(FileNotFoundError):
        shared_memory.SharedMemory(name)


def test_what_the_terminal_removed_is_not_missed() -> None:
    with Trials({"TERM": "xterm"}) as trials:
        os.unlink(payload(trials, "kitty file"))
        memory = shared_memory.SharedMemory(payload(trials, "kitty shared"))
        memory.close()
        memory.unlink()


@pytest.mark.parametrize("environment", [{"SSH_TTY": "/dev/pts/0"}, {"TMUX": "/tmp/t"}])
def test_nothing_is_tried_where_the_terminal_cannot_see_this_machine(environment: dict[str, str]) -> None:
    with Trials({"TERM": "xterm", **environment}) as trials:
        assert trials.questions == []


def tmux(folder: Path, *arguments: str) -> None:
    subprocess.run(["tmux", "-S", str(folder / "socket"), *arguments], check=True, timeout=20)


def test_tmux_says_whether_it_lets_pictures_through(tmp_path: Path) -> None:
    (tmp_path / "conf").write_text("set -g allow-passthrough on\n")
    tmux(tmp_path, "-f", str(tmp_path / "conf"), "new-session", "-d", "sleep 60")
    try:
        asked = ask_tmux({"TMUX": f"{tmp_path}/socket,1,0", "PATH": os.environ["PATH"]})
    finally:
        tmux(tmp_path, "kill-server")
    assert asked.split("|") in (["1", ""], ["on", ""])


def test_a_tmux_that_is_gone_says_nothing(tmp_path: Path) -> None:
    assert ask_tmux({"TMUX": f"{tmp_path}/socket,1,0", "PATH": os.environ["PATH"]}) == ""
    assert ask_tmux({"TMUX": f"{tmp_path}/socket,1,0", "PATH": str(tmp_path)}) == ""
    assert ask_tmux({}) == ""
