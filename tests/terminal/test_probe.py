from __future__ import annotations

from dataclasses import dataclass, replace

import pytest

from tsplat.terminal.multiplexer import passes_pictures
from tsplat.terminal.outputs import outputs
from tsplat.terminal.probe import TRUECOLOR, Profile, detect, size_questions
from tsplat.terminal.questions import is_remote, questions

OK = b"\x1b_Gi=31;OK\x1b\\"
SHARED, FILE = OK.replace(b"31", b"32"), OK.replace(b"31", b"33")
NO_FILE = b"\x1b_Gi=33;EBADF:no such file\x1b\\"
CELL = b"\x1b[6;20;10t"
AREA = b"\x1b[4;480;800t"
KEYBOARD = b"\x1b[?0u"
EVERYWHERE = ("quadrant", "half", "braille", "ascii")
EVERYWHERE_256 = ("quadrant", "half256", "braille", "ascii")


def version(text: str) -> bytes:
    return b"\x1bP>|" + text.encode() + b"\x1b\\"


def mode(number: int, state: int) -> bytes:
    return b"\x1b[?%d;%d$y" % (number, state)


def da1(text: str) -> bytes:
    return b"\x1b[?" + text.encode() + b"c"


@dataclass(frozen=True)
class Case:
    """One terminal as it was measured or as its makers describe it: variables, answers, and what follows."""

    name: str
    environment: dict[str, str]
    replies: bytes
    profile: Profile
    best: tuple[str, ...]
    tmux: str = ""


COLORS = Profile(colors=TRUECOLOR)
MODERN = replace(COLORS, synchronized=True, kitty_keyboard=True, pixel_mouse=True, cell_size=(10, 20))
MODES = mode(2026, 2) + mode(1016, 2)


def named(program: str, version: str = "", of: Profile = COLORS, **more: object) -> Profile:
    return replace(of, program=program, version=version, **more)


CASES = [
    Case(
        "kitty 0.26.5",
        {"TERM": "xterm-kitty", "COLORTERM": "truecolor", "KITTY_WINDOW_ID": "1"},
        version("kitty(0.26.5)")
        + CELL
        + AREA
        + MODES
        + mode(2048, 0)
        + KEYBOARD
        + OK
        + SHARED
        + FILE
        + da1("62;"),
        named(
            "kitty",
            "0.26.5",
            MODERN,
            kitty_graphics=True,
            kitty_transports=("shared", "file", "direct"),
            window_size=(800, 480),
        ),
        ("kitty", "sextant", *EVERYWHERE),
    ),
    Case(
        "kitty 0.40 over SSH, which finds no files",
        {"TERM": "xterm-kitty", "SSH_CONNECTION": "a 1 b 2"},
        version("kitty(0.40.1)") + CELL + MODES + mode(2048, 2) + KEYBOARD + OK + da1("62;52;c"),
        named("kitty", "0.40.1", MODERN, kitty_graphics=True, in_band_resize=True, remote=True),
        ("kitty", "octant", "sextant", *EVERYWHERE),
    ),
    Case(
        "xterm 379 -ti vt340",
        {"TERM": "xterm"},
        version("XTerm(379)") + mode(2026, 0) + mode(1016, 2) + b"\x1b[?2;0;1000;900S" + da1("63;1;2;4;6;9;15;22"),
        named("XTerm", "379", sixel=True, pixel_mouse=True, sixel_size=(1000, 900)),
        ("sixel", *EVERYWHERE),
    ),
    Case(
        "xterm 379 with allowWindowOps",
        {"TERM": "xterm-256color"},
        version("XTerm(379)") + CELL + AREA + mode(2026, 0) + mode(1016, 2) + da1("64;1;2;6;9;15;18;21;22"),
        named("XTerm", "379", pixel_mouse=True, cell_size=(10, 20), window_size=(800, 480)),
        EVERYWHERE,
    ),
    Case(
        "foot 1.13.1",
        {"TERM": "foot", "COLORTERM": "truecolor"},
        version("foot(1.13.1)") + CELL + AREA + MODES + KEYBOARD + da1("62;4;22"),
        named("foot", "1.13.1", MODERN, sixel=True, window_size=(800, 480)),
        ("sixel", "sextant", *EVERYWHERE),
    ),
    Case(
        "mlterm 3.9",
        {"TERM": "mlterm", "MLTERM": "3.9.2", "COLORFGBG": "15;0"},
        CELL + mode(2026, 0) + mode(1016, 0) + da1("63;1;2;3;4;7;29"),
        named("mlterm", sixel=True, iterm2_pictures=True, cell_size=(10, 20)),
        ("sixel", "iterm2", *EVERYWHERE),
    ),
    Case(
        "konsole 22.12",
        {"TERM": "xterm-256color", "COLORTERM": "truecolor", "KONSOLE_VERSION": "221201"},
        version("Konsole 22.12.3") + CELL + OK + SHARED + NO_FILE + da1("62;1;4"),
        named(
            "Konsole",
            "22.12.3",
            kitty_graphics=True,
            sixel=True,
            kitty_transports=("shared", "direct"),
            cell_size=(10, 20),
        ),
        ("kitty", "sixel", *EVERYWHERE),
    ),
    Case(
        "alacritty 0.11",
        {"TERM": "alacritty", "COLORTERM": "truecolor"},
        AREA + da1("6"),
        named("alacritty", window_size=(800, 480)),
        EVERYWHERE,
    ),
    Case(
        "VTE 0.70",
        {"TERM": "xterm-256color", "VTE_VERSION": "7006"},
        AREA + mode(2026, 4) + mode(1016, 0) + da1("65;1;9"),
        named("VTE", "7006", window_size=(800, 480)),
        EVERYWHERE,
    ),
    Case(
        "tmux 3.3a in a kitty too old for placeholders, whose variables leak",
        {"TERM": "tmux-256color", "TMUX": "/tmp/t,1,0", "KITTY_WINDOW_ID": "1", "TERM_PROGRAM": "tmux"},
        version("tmux 3.3a") + OK + da1("1;2"),
        named("tmux", "3.3a", multiplexer="tmux"),
        EVERYWHERE,
        "1|kitty(0.26.5)",
    ),
    Case(
        "tmux that passes pictures on to Ghostty",
        {"TERM": "screen", "TMUX": "/tmp/t,1,0"},
        version("tmux 3.4") + da1("1;2"),
        named("tmux", "3.4", multiplexer="tmux", kitty_graphics=True),
        ("kitty", *EVERYWHERE),
        "on|ghostty 1.1.3",
    ),
    Case(
        "tmux 3.4 with sixel",
        {"TERM": "screen", "TMUX": "/tmp/t,1,0"},
        version("tmux 3.4") + CELL + da1("1;2;4"),
        named("tmux", "3.4", multiplexer="tmux", sixel=True, cell_size=(10, 20)),
        ("sixel", *EVERYWHERE),
        "off|xterm(390)",
    ),
    Case(
        "kitty started in tmux, whose variable leaks",
        {"TERM": "xterm-kitty", "TMUX": "/tmp/t,1,0"},
        version("kitty(0.26.5)") + KEYBOARD + da1("62;"),
        named("kitty", "0.26.5", kitty_keyboard=True),
        ("sextant", *EVERYWHERE),
    ),
    Case(
        "screen, into which COLORTERM leaks",
        {"TERM": "screen.xterm-256color", "STY": "1.pts", "COLORTERM": "truecolor", "TERM_PROGRAM": "iTerm.app"},
        da1("1;2"),
        Profile("screen", multiplexer="screen"),
        EVERYWHERE_256,
    ),
    Case(
        "screen without 256 colours",
        {"TERM": "screen", "STY": "1.pts"},
        da1("1;2"),
        Profile("screen", multiplexer="screen", colors=16),
        EVERYWHERE,
    ),
    Case(
        "mosh",
        {"TERM": "xterm-256color", "SSH_TTY": "/dev/pts/1"},
        da1("62"),
        Profile("xterm-256color", remote=True),
        EVERYWHERE_256,
    ),
    Case(
        "xterm.js with addon-image",
        {"TERM": "xterm-256color"},
        version("xterm.js(6.1.0)") + CELL + MODES + KEYBOARD + OK + da1("62;4;9;22"),
        named("xterm.js", "6.1.0", MODERN, kitty_graphics=True, sixel=True),
        ("sixel", "kitty", "sextant", *EVERYWHERE),
    ),
    Case(
        "iTerm2, which claims the kitty protocol",
        {"TERM": "xterm-256color", "COLORTERM": "truecolor", "TERM_PROGRAM": "iTerm.app"},
        version("iTerm2 3.5.0") + CELL + OK + SHARED + da1("62;4"),
        named("iTerm2", "3.5.0", iterm2_pictures=True, sixel=True, cell_size=(10, 20)),
        ("iterm2", "sixel", *EVERYWHERE),
    ),
    Case(
        "WezTerm",
        {"TERM": "xterm-256color", "COLORTERM": "truecolor"},
        version("WezTerm 20240203-110809-5046fc22") + CELL + OK + da1("65;4;6;18;22"),
        named("WezTerm", "20240203-110809-5046fc22", iterm2_pictures=True, sixel=True, cell_size=(10, 20)),
        ("iterm2", "sixel", "octant", "sextant", *EVERYWHERE),
    ),
    Case(
        "Ghostty",
        {"TERM": "xterm-ghostty", "COLORTERM": "truecolor", "TERM_PROGRAM": "ghostty"},
        version("ghostty 1.1.3") + CELL + AREA + MODES + mode(2048, 2) + KEYBOARD + OK + FILE + da1("62;22;52"),
        named(
            "ghostty",
            "1.1.3",
            MODERN,
            kitty_graphics=True,
            kitty_transports=("file", "direct"),
            in_band_resize=True,
            window_size=(800, 480),
        ),
        ("kitty", "octant", "sextant", *EVERYWHERE),
    ),
    Case(
        "Terminal.app",
        {"TERM": "xterm-256color", "TERM_PROGRAM": "Apple_Terminal", "TERM_PROGRAM_VERSION": "455"},
        da1("1;2"),
        Profile("Apple_Terminal", "455"),
        EVERYWHERE_256,
    ),
    Case("the Linux console", {"TERM": "linux"}, da1("6"), Profile("linux", colors=16), ("half", "ascii")),
    Case(
        "a VT340", {"TERM": "vt340"}, da1("63;4"), Profile("vt340", sixel=True, colors=16), ("sixel", *EVERYWHERE)
    ),
    Case(
        "a terminal named after VTE, which is no VT",
        {"TERM": "vte-256color"},
        da1("65"),
        Profile("vte-256color", colors=TRUECOLOR),
        EVERYWHERE,
    ),
    Case(
        "kitty for a person who wants no colour",
        {"TERM": "xterm-kitty", "NO_COLOR": "1"},
        version("kitty(0.40.0)") + OK + da1("62;4"),
        Profile("kitty", "0.40.0", colors=0, kitty_graphics=True, sixel=True),
        ("octant", "braille", "sextant", "quadrant", "half", "ascii"),
    ),
    Case("NO_COLOR of no length", {"TERM": "xterm", "NO_COLOR": ""}, b"", Profile("xterm"), EVERYWHERE_256),
    Case("nothing answers", {"TERM": "xterm"}, b"", Profile("xterm"), EVERYWHERE_256),
    Case("xterm-direct, silent", {"TERM": "xterm-direct"}, b"", named("xterm-direct"), EVERYWHERE),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_terminal_is_recognised_by_its_answers(case: Case) -> None:
    profile = detect(case.environment, case.replies, case.tmux)
    assert replace(profile, replies={}) == case.profile
    assert outputs(profile) == case.best


def written(environment: dict[str, str]) -> bytes:
    return b"".join(question.asks for question in questions(environment))


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
        {"TERM": "xterm-256color", "ZELLIJ": "0"},
        {"TERM": "linux"},
        {"TERM": "dumb"},
        {},
    ],
)
def test_terminals_that_print_the_graphics_question_are_not_asked_it(environment: dict[str, str]) -> None:
    assert b"\x1b_G" not in written(environment)
    assert written(environment).endswith(b"\x1b[c")


def test_the_last_question_is_the_one_everybody_answers() -> None:
    asked = written({"TERM": "xterm-256color"})
    assert b"\x1b_Gi=31" in asked
    assert asked.endswith(b"\x1b[c")


def test_a_terminal_is_far_where_ssh_says_so() -> None:
    assert is_remote({"SSH_CONNECTION": "1 2 3 4"})
    assert is_remote({"SSH_TTY": "/dev/pts/0"})
    assert not is_remote({"SSH_TTY": "", "SSH_AUTH_SOCK": "/tmp/agent"})


@pytest.mark.parametrize(
    ("told", "passed"),
    [
        ("1|kitty(0.28.0)", True),
        ("all|kitty(0.41.1)", True),
        ("on|ghostty 1.0.0", True),
        ("0|kitty(0.41.1)", False),
        ("off|ghostty 1.0.0", False),
        ("1|kitty(0.27.1)", False),
        ("1|XTerm(379)", False),
        ("1|", False),
        ("|kitty(0.41.1)", False),
        ("", False),
    ],
)
def test_pictures_get_through_tmux_only_where_it_lets_them_and_they_are_drawn(told: str, passed: bool) -> None:
    assert passes_pictures(told) is passed
    assert detect({"TMUX": "/tmp/t"}, version("tmux 3.5"), told).kitty_graphics is passed


def test_files_of_this_machine_are_nothing_to_a_terminal_far_away() -> None:
    replies = version("kitty(0.40.1)") + OK + SHARED + FILE + da1("62")
    assert detect({}, replies).kitty_transports == ("shared", "file", "direct")
    assert detect({"SSH_TTY": "/dev/pts/0"}, replies).kitty_transports == ("direct",)


def test_only_sizes_that_were_answered_are_asked_again() -> None:
    assert size_questions(Profile()) == {}
    assert size_questions(Profile(cell_size=(9, 18))) == {6: b"\x1b[16t"}
    assert size_questions(Profile(window_size=(9, 18))) == {4: b"\x1b[14t"}
