from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any

import pytest

from tests.terminal.ptys import Terminal
from tests.terminal.test_session import KITTY
from tsplat.doctor.examination import document, readable
from tsplat.doctor.report import report
from tsplat.terminal.hearing import Hearing
from tsplat.terminal.interview import Interview
from tsplat.terminal.questions import questions

DOCTOR = (sys.executable, "-m", "tsplat", "doctor")


def examined(replies: bytes, environment: dict[str, str], seconds: float = 0.01, tmux: str = "") -> dict[str, Any]:
    hearing = Hearing(questions(environment), remote=False, tmux=tmux)
    hearing.take(replies, seconds)
    return document(environment, Interview(hearing, (100, 30, 0, 0)))


def shown(examination: dict[str, Any]) -> str:
    from rich.console import Console

    console = Console(width=160)
    with console.capture() as capture:
        console.print(report(examination))
    return " ".join(capture.get().split())


def test_the_report_says_what_was_asked_what_came_back_and_what_was_chosen() -> None:
    with Terminal(*DOCTOR, environment={"COLORTERM": "truecolor"}) as terminal:
        terminal.resize(130, 50)
        terminal.wait_for(b"\x1b[c")
        terminal.type(KITTY)
        assert terminal.wait() == 0
        assert terminal.attributes() == terminal.before
        text = terminal.seen.decode().partition("\x1b[c")[2]
        for part in (
            "kitty 0.26.5",
            "TERM=xterm-256color, COLORTERM=truecolor",
            "130 x 50 cells",
            "a cell 10 x 20",
        ):
            assert part in text
        for part in ("ESC [>0q", "ESC P>|kitty(0.26.5) ESC \\", "ESC _Gi=31;OK ESC \\", "no answer", "numba"):
            assert part in text
        assert text.rpartition("chosen: ")[2].startswith("\x1b[0m\x1b[1;32mkitty")
        assert "\x1b[?1049h" not in terminal.seen.decode()


def test_as_json_every_question_has_its_answer_and_its_time() -> None:
    with Terminal(*DOCTOR, "--json") as terminal:
        terminal.wait_for(b"\x1b[c")
        terminal.type(b"x" + KITTY)
        assert terminal.wait() == 0
        examination = json.loads(terminal.seen.decode().partition("\x1b[K")[2])
    answers = {row["name"]: row for row in examination["questions"]}
    assert answers["XTVERSION"]["asked"] == "ESC [>0q"
    assert answers["XTVERSION"]["reply"] == "ESC P>|kitty(0.26.5) ESC \\"
    assert 0 <= answers["XTVERSION"]["milliseconds"] < 20_000
    assert answers["window 14t"]["reply"] is answers["window 14t"]["milliseconds"] is None
    assert examination["asked"] is True
    assert examination["also_came"] == "x"
    assert examination["chosen"]["output"] == "kitty"
    assert [row["offered"] for row in examination["outputs"] if row["name"] == "sextant"] == [True]
    assert set(examination["machine"]) >= {"tsplat", "python", "numpy", "numba", "processors", "system"}


def test_a_terminal_that_answers_nothing_is_reported_and_left_as_it_was() -> None:
    with Terminal(*DOCTOR) as terminal:
        assert terminal.wait() == 0
        assert terminal.attributes() == terminal.before
        assert b"every terminal answers" in terminal.seen
        assert b"quadrant" in terminal.seen.rpartition(b"chosen: ")[2]


@pytest.mark.parametrize("options", [(), ("--json",)])
def test_into_a_pipe_it_says_that_nothing_was_asked_and_what_the_environment_tells(
    options: tuple[str, ...],
) -> None:
    environment = {**os.environ, "TERM": "xterm-kitty", "COLORTERM": "truecolor", "SSH_TTY": "/dev/pts/secret"}
    environment.pop("NO_COLOR", None)
    ran = subprocess.run([*DOCTOR, *options], env=environment, capture_output=True, text=True, timeout=60)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert "standard output is not a terminal" in ran.stdout
    assert "xterm-kitty" in ran.stdout
    assert "SSH_TTY" in ran.stdout
    assert "secret" not in ran.stdout
    assert "\x1b" not in ran.stdout


def test_late_answers_are_said_to_be_late() -> None:
    late = "the answers were late"
    assert late in shown(examined(KITTY, {"TERM": "xterm"}, seconds=0.4))
    assert late not in shown(examined(KITTY, {"TERM": "xterm"}, seconds=0.1))
    assert late not in shown(examined(KITTY, {"TERM": "xterm", "SSH_TTY": "1"}, seconds=0.4))


def test_what_was_asked_for_by_name_is_chosen_and_a_wrong_name_is_explained() -> None:
    chosen = examined(KITTY, {"TERM": "xterm-kitty", "TSPLAT_OUTPUT": "half"})["chosen"]
    assert chosen == {"output": "half", "why": "TSPLAT_OUTPUT says so; else it would be kitty"}
    wrong = examined(KITTY, {"TERM": "xterm-kitty", "TSPLAT_OUTPUT": "gif"})
    assert wrong["chosen"]["output"] == ""
    assert "chosen: nothing, TSPLAT_OUTPUT must be one of" in shown(wrong)


def test_no_colour_and_tmux_show_in_the_report() -> None:
    text = shown(
        examined(b"\x1bP>|tmux 3.4\x1b\\\x1b[?1;2c", {"TMUX": "/tmp/t", "NO_COLOR": "1"}, tmux="0|XTerm(379)")
    )
    for part in ("behind tmux", "colours none, NO_COLOR is set", "tmux says 0|XTerm(379)", "TMUX=set"):
        assert part in text


def test_control_characters_are_made_readable() -> None:
    assert readable(b"\x1b]11;rgb\x07\r\xff\x1b\\") == r"ESC ]11;rgb BEL \r\xff ESC \ ".strip()


def test_asking_the_command_line_for_help_imports_nothing_of_it() -> None:
    code = "import sys, tsplat.cli; print([m for m in sys.modules if m.startswith('tsplat.terminal')])"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout == "[]\n"
