from __future__ import annotations

from dataclasses import dataclass

import pytest

from tsplat.encode import ENCODERS
from tsplat.errors import OptionError
from tsplat.terminal import probe
from tsplat.terminal.probe import Profile, choose_output, detect, outputs, questions

OK = b"\x1b_Gi=31;OK\x1b\\"
CELL = b"\x1b[6;20;10t"
AREA = b"\x1b[4;480;800t"
KEYBOARD = b"\x1b[?0u"


def version(text: str) -> bytes:
    return b"\x1bP>|" + text.encode() + b"\x1b\\"


def mode(number: int, state: int) -> bytes:
    return b"\x1b[?%d;%d$y" % (number, state)


def da1(text: str) -> bytes:
    return b"\x1b[?" + text.encode() + b"c"


@dataclass(frozen=True)
class Case:
    """One terminal as it was measured: its variables, what it answers, and what follows."""

    name: str
    environment: dict[str, str]
    replies: bytes
    program: tuple[str, str]
    best: tuple[str, ...]
    synchronized: bool = False
    keyboard: bool = False
    pixel_mouse: bool = False
    cell: tuple[int, int] | None = None
    window: tuple[int, int] | None = None


CASES = [
    Case(
        "kitty 0.26.5",
        {"TERM": "xterm-kitty", "COLORTERM": "truecolor", "KITTY_WINDOW_ID": "1"},
        version("kitty(0.26.5)") + CELL + AREA + mode(2026, 2) + mode(1016, 2) + KEYBOARD + OK + da1("62;"),
        ("kitty", "0.26.5"),
        ("kitty", "half", "half256"),
        *(True, True, True, (10, 20), (800, 480)),
    ),
    Case(
        "xterm 379 -ti vt340",
        {"TERM": "xterm"},
        version("XTerm(379)") + mode(2026, 0) + mode(1016, 2) + da1("63;1;2;4;6;9;15;22"),
        ("XTerm", "379"),
        ("sixel", "half", "half256"),
        pixel_mouse=True,
    ),
    Case(
        "xterm 379 with allowWindowOps",
        {"TERM": "xterm-256color"},
        version("XTerm(379)") + CELL + AREA + mode(2026, 0) + mode(1016, 2) + da1("64;1;2;6;9;15;18;21;22"),
        ("XTerm", "379"),
        ("half", "half256"),
        *(False, False, True, (10, 20), (800, 480)),
    ),
    Case(
        "foot 1.13.1",
        {"TERM": "foot", "COLORTERM": "truecolor"},
        version("foot(1.13.1)") + CELL + AREA + mode(2026, 2) + mode(1016, 2) + KEYBOARD + da1("62;4;22"),
        ("foot", "1.13.1"),
        ("sixel", "half", "half256"),
        *(True, True, True, (10, 20), (800, 480)),
    ),
    Case(
        "mlterm 3.9",
        {"TERM": "mlterm", "MLTERM": "3.9.2", "COLORFGBG": "15;0"},
        CELL + mode(2026, 0) + mode(1016, 0) + da1("63;1;2;3;4;7;29"),
        ("mlterm", ""),
        ("sixel", "half", "half256"),
        cell=(10, 20),
    ),
    Case(
        "konsole 22.12",
        {"TERM": "xterm-256color", "COLORTERM": "truecolor", "KONSOLE_VERSION": "221201"},
        version("Konsole 22.12.3") + CELL + OK + da1("62;1;4"),
        ("Konsole", "22.12.3"),
        ("kitty", "sixel", "half", "half256"),
        cell=(10, 20),
    ),
    Case(
        "alacritty 0.11",
        {"TERM": "alacritty", "COLORTERM": "truecolor"},
        AREA + da1("6"),
        ("alacritty", ""),
        ("half", "half256"),
        window=(800, 480),
    ),
    Case(
        "VTE 0.70",
        {"TERM": "xterm-256color", "VTE_VERSION": "7006"},
        AREA + mode(2026, 4) + mode(1016, 0) + da1("65;1;9"),
        ("VTE", "7006"),
        ("half", "half256"),
        window=(800, 480),
    ),
    Case(
        "tmux 3.3a in kitty, whose variables leak",
        {"TERM": "tmux-256color", "TMUX": "/tmp/t,1,0", "KITTY_WINDOW_ID": "1", "TERM_PROGRAM": "tmux"},
        version("tmux 3.3a") + OK + da1("1;2"),
        ("tmux", "3.3a"),
        ("half", "half256"),
    ),
    Case(
        "tmux 3.4 with sixel",
        {"TERM": "screen", "TMUX": "/tmp/t,1,0"},
        version("tmux 3.4") + CELL + da1("1;2;4"),
        ("tmux", "3.4"),
        ("sixel", "half", "half256"),
        cell=(10, 20),
    ),
    Case(
        "screen, into which COLORTERM leaks",
        {"TERM": "screen.xterm-256color", "STY": "1.pts", "COLORTERM": "truecolor"},
        da1("1;2"),
        ("screen.xterm-256color", ""),
        ("half256",),
    ),
    Case(
        "mosh",
        {"TERM": "xterm-256color", "SSH_TTY": "/dev/pts/1"},
        da1("62"),
        ("xterm-256color", ""),
        ("half256",),
    ),
    Case(
        "xterm.js with addon-image",
        {"TERM": "xterm-256color"},
        version("xterm.js(6.1.0)") + CELL + mode(2026, 2) + mode(1016, 2) + KEYBOARD + OK + da1("62;4;9;22"),
        ("xterm.js", "6.1.0"),
        ("kitty", "sixel", "half", "half256"),
        *(True, True, True, (10, 20)),
    ),
    Case(
        "iTerm2, which claims the kitty protocol",
        {"TERM": "xterm-256color", "COLORTERM": "truecolor", "TERM_PROGRAM": "iTerm.app"},
        version("iTerm2 3.5.0") + CELL + OK + da1("62;4"),
        ("iTerm2", "3.5.0"),
        ("sixel", "half", "half256"),
        cell=(10, 20),
    ),
    Case(
        "WezTerm",
        {"TERM": "xterm-256color", "COLORTERM": "truecolor"},
        version("WezTerm 20240203-110809-5046fc22") + CELL + OK + da1("65;4;6;18;22"),
        ("WezTerm", "20240203-110809-5046fc22"),
        ("sixel", "half", "half256"),
        cell=(10, 20),
    ),
    Case(
        "Terminal.app",
        {"TERM": "xterm-256color", "TERM_PROGRAM": "Apple_Terminal", "TERM_PROGRAM_VERSION": "455"},
        da1("1;2"),
        ("Apple_Terminal", "455"),
        ("half256",),
    ),
    Case("nothing answers", {"TERM": "xterm"}, b"", ("xterm", ""), ("half256",)),
    Case("xterm-direct, silent", {"TERM": "xterm-direct"}, b"", ("xterm-direct", ""), ("half", "half256")),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_terminal_is_recognised_by_its_answers(case: Case) -> None:
    profile = detect(case.environment, case.replies)
    assert (profile.program, profile.version) == case.program
    assert outputs(profile) == case.best
    assert profile.synchronized is case.synchronized
    assert profile.kitty_keyboard is case.keyboard
    assert profile.pixel_mouse is case.pixel_mouse
    assert (profile.cell_size, profile.window_size) == (case.cell, case.window)


def test_answers_count_in_any_order_and_between_keys() -> None:
    replies = da1("62;4") + b"jj\x1b[A" + version("foot(1)") + b"q" + mode(2026, 1) + b"\x1b]11;rgb:0/0/0\x07"
    profile = detect({"TERM": "foot"}, replies)
    assert (profile.program, profile.sixel, profile.synchronized) == ("foot", True, True)
    assert profile.replies == {"XTVERSION": "foot(1)", "DA1": "62;4", "mode 2026": "1"}


def test_a_sixel_attribute_is_4_and_not_the_class_or_44() -> None:
    assert not detect({}, da1("4")).sixel
    assert not detect({}, da1("62;44;14")).sixel


def test_an_error_to_the_graphics_question_is_no_graphics() -> None:
    assert not detect({"TERM": "xterm"}, b"\x1b_Gi=31;ENOSYS:no\x1b\\" + da1("62")).kitty_graphics


def test_a_cell_of_no_size_is_no_cell() -> None:
    assert detect({}, b"\x1b[6;0;0t").cell_size is None


@pytest.mark.parametrize(
    "environment",
    [
        {"TERM": "xterm-256color", "TERM_PROGRAM": "Apple_Terminal"},
        {"TERM": "tmux-256color", "TMUX": "/tmp/t"},
        {"TERM": "screen", "STY": "1"},
        {"TERM": "linux"},
        {"TERM": "dumb"},
        {},
    ],
)
def test_terminals_that_print_the_graphics_question_are_not_asked_it(environment: dict[str, str]) -> None:
    assert b"\x1b_G" not in questions(environment)
    assert questions(environment).endswith(b"\x1b[c")


def test_the_last_question_is_the_one_everybody_answers() -> None:
    asked = questions({"TERM": "xterm-256color"})
    assert b"\x1b_Gi=31" in asked
    assert asked.endswith(b"\x1b[c")
    assert not probe.answered(version("kitty(1)") + b"\x1b[?0u")
    assert probe.answered(version("kitty(1)") + da1("62;4"))


def test_answers_over_ssh_are_given_more_time() -> None:
    assert probe.patience({"SSH_CONNECTION": "1 2 3 4"}) > probe.patience({})
    assert probe.patience({"SSH_TTY": "/dev/pts/0"}) > probe.patience({})


def test_only_sizes_that_were_answered_are_asked_again() -> None:
    assert probe.size_questions(Profile()) == b""
    assert probe.size_questions(Profile(cell_size=(9, 18))) == b"\x1b[16t"
    assert probe.size_questions(Profile(window_size=(9, 18))) == b"\x1b[14t"


def test_an_output_is_what_was_asked_for_then_the_variable_then_the_best() -> None:
    kitty = Profile(kitty_graphics=True, colors=1 << 24)
    assert choose_output(None, {}, kitty) == "kitty"
    assert choose_output(None, {"TSPLAT_OUTPUT": "half"}, kitty) == "half"
    assert choose_output("half256", {"TSPLAT_OUTPUT": "half"}, kitty) == "half256"
    assert choose_output("sixel", {}, kitty) == "sixel"
    assert choose_output(None, {"TSPLAT_OUTPUT": ""}, Profile()) == "half256"


def test_an_unknown_output_is_refused_by_the_name_of_where_it_stands() -> None:
    with pytest.raises(OptionError, match="output must be one of kitty, sixel, half, half256, got 'ascii'"):
        choose_output("ascii", {}, Profile())
    with pytest.raises(OptionError, match="TSPLAT_OUTPUT must be"):
        choose_output(None, {"TSPLAT_OUTPUT": "ascii"}, Profile())


def test_every_encoder_is_an_output_and_the_other_way_round() -> None:
    assert probe.OUTPUTS == ENCODERS
