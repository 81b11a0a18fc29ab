"""Terminals that lie, rave or never stop: what they say is bounded, and what was not asked is not believed."""

from __future__ import annotations

from random import Random

import pytest

from tests.io.mutants import mutant
from tests.terminal.outcomes import WINDOWS, check_drawable, outcome
from tests.terminal.ptys import Terminal
from tests.terminal.test_parser import SEQUENCES
from tests.terminal.test_probe import CASES
from tests.terminal.test_session import ECHO, KITTY, started
from tests.viewer.states import a_state
from tsplat.encode import ENCODERS
from tsplat.terminal.hearing import Hearing
from tsplat.terminal.keys import Key, Resize, TerminalSize
from tsplat.terminal.limits import MOST_HELD, MOST_REPLIES
from tsplat.terminal.multiplexer import version_numbers
from tsplat.terminal.parser import Parser, PixelReport, SizeReport
from tsplat.terminal.probe import Profile, detect
from tsplat.terminal.sizes import Sizes
from tsplat.viewer.update import update

BAND = Profile(in_band_resize=True, cell_size=(10, 20))


def sizes(*window: int, profile: Profile | None = None) -> Sizes:
    return Sizes(lambda: (window[0], window[1], window[2], window[3]), profile or Profile())


@pytest.mark.parametrize(
    ("window", "profile", "believed"),
    [
        ((10_000, 10_000, 0, 0), Profile(), TerminalSize(2000, 262, 5, 10)),
        ((65535, 65535, 65535, 65535), Profile(), TerminalSize(2000, 262, 1, 1)),
        ((65535, 1, 0, 0), Profile(), TerminalSize(2000, 1)),
        ((1, 65535, 1, 65535), Profile(), TerminalSize(1, 1000, 1, 1)),
        ((80, 24, 65535, 65535), Profile(), TerminalSize(80, 24)),
        ((80, 24, 79, 23), Profile(), TerminalSize(80, 24)),
        ((400, 300, 0, 0), Profile(cell_size=(200, 250)), TerminalSize(400, 300)),
        ((0, 0, 65535, 65535), Profile(window_size=(99999, 99999)), TerminalSize(80, 24)),
    ],
)
def test_no_terminal_is_larger_than_any_screen(
    window: tuple[int, ...], profile: Profile, believed: TerminalSize
) -> None:
    said = sizes(*window, profile=profile).now()
    assert said == believed
    for output in ENCODERS:
        for density in (0.25, 1.0, 3.0):
            check_drawable(a_state(size=said, output=output, density=density))


@pytest.mark.parametrize(
    ("columns", "rows", "cell"),
    [(1920, 273, (4, 8)), (960, 270, (8, 16)), (640, 180, (12, 24)), (300, 80, (0, 0)), (480, 135, (16, 32))],
)
def test_the_largest_screens_there_are_are_filled(columns: int, rows: int, cell: tuple[int, int]) -> None:
    profile = Profile(cell_size=cell) if all(cell) else Profile()
    assert sizes(columns, rows, 0, 0, profile=profile).now() == TerminalSize(columns, rows, *cell)


def test_a_new_size_that_is_absurd_is_bounded_like_any_other() -> None:
    of = sizes(80, 24, 800, 480, profile=BAND)
    assert of.take(SizeReport(10_000, 10_000, 100_000, 200_000))
    check_drawable(update(a_state(), Resize(of.now())))
    for width, height in ((0, 0), (1, 16_000_000), (257, 5)):
        of.take(PixelReport(6, width, height))
        assert max(of.now().cell_size) <= 20


def test_a_size_that_nobody_asked_for_is_not_believed() -> None:
    with Terminal.python(ECHO) as terminal:
        ready = started(terminal, KITTY)
        terminal.type(b"\x1b[48;10000;10000;65535;65535t\x1b[48;30;100;900;1500t\x1b[6;1;1t\x1b[4;9;9tw")
        end = terminal.wait_for(b"Key(name='w', action='press')<", start=ready)
        assert b"Resize" not in terminal.seen[ready:end]
        terminal.resize(90, 20)
        first = terminal.wait_for(
            b"\x1b[16t", b"Resize(size=TerminalSize(columns=90, rows=20, cell_width=10", start=end
        )
        terminal.type(b"\x1b[6;30;15t\x1b[6;40;20tw")
        last = terminal.wait_for(b"cell_width=15, cell_height=30", b"Key(", start=first)
        assert b"cell_width=20" not in terminal.seen[first:last]
        terminal.type(b"q")
        assert terminal.wait() == 0


def test_an_answer_to_no_question_is_none() -> None:
    with Terminal.python(ECHO) as terminal:
        ready = started(terminal)
        terminal.type(b"\x1b[0n\x1b[0nw")
        end = terminal.wait_for(b"Key(name='w', action='press')<", start=ready)
        assert b"Answered" not in terminal.seen[ready:end]
        terminal.type(b"q")
        assert terminal.wait() == 0


@pytest.mark.parametrize(
    ("start", "end"), [(b"\x1b]52;c;", b"\x07"), (b"\x1bPq", b"\x1b\\"), (b"\x1b_G", b"\x1b\\"), (b"\x1b[", b"m")]
)
def test_a_sequence_without_end_is_not_held_and_what_comes_after_it_is_heard(start: bytes, end: bytes) -> None:
    parser = Parser()
    events = parser.feed(start)
    for _ in range(50):
        events += parser.feed(b"1;" * 5000)
        assert len(parser._rest) <= MOST_HELD
    assert parser.pending
    assert events + parser.feed(end + b"q") == [Key("q")]


def test_a_sequence_that_is_given_up_swallows_no_key() -> None:
    parser = Parser()
    assert parser.feed(b"\x1b]52;" + b"A" * 10_000) + parser.flush() == []
    assert parser.feed(b"q") == [Key("q")]


def test_a_terminal_that_never_stops_is_not_listened_to_for_ever() -> None:
    hearing = Hearing((), remote=True)
    hearing.take(b"x" * MOST_REPLIES, 0.0)
    assert hearing.left(0.0) > 0
    hearing.take(b"x", 0.0)
    assert hearing.left(0.0) == 0


def test_keys_that_never_come_up_are_not_remembered_for_ever() -> None:
    parser = Parser()
    for code in range(0x4E00, 0x4E00 + 5000):
        parser.feed(b"\x1b[%du" % code)
    assert len(parser._down) < 100


ENDLESS = [b"9" * 5000, b"1;" * 3000, b"x\x07\r\n\x9b31m", b"k" * 101, b""]


@pytest.mark.parametrize("text", ENDLESS, ids=lambda text: text[:9].hex())
def test_no_answer_is_longer_than_terminals_say_it_nor_shown_raw(text: bytes) -> None:
    sizes_said = b"\x1b[6;%b;%bt\x1b[4;%b;9t\x1b[?2;0;%b;1S" % ((text,) * 4)
    others = b"\x1bP>|%b\x1b\\\x1b[?2026;%b$y\x1b[?%bu\x1b_Gi=31;%b\x1b\\\x1b[?6%bc" % ((text,) * 5)
    profile = detect({"TERM": "xterm"}, sizes_said + others)
    assert all(reply.isprintable() and len(reply) <= 200 for reply in profile.replies.values())
    assert profile.cell_size is profile.window_size is profile.sixel_size is None


@pytest.mark.parametrize("version", ["9" * 5000, "1." * 5000, "²", "\N{ARABIC-INDIC DIGIT ONE}.2", "", ".", "-1"])
def test_no_version_is_more_than_a_few_numbers(version: str) -> None:
    assert len(version_numbers(version)) <= 10
    assert detect({"TERM": "x", "TERM_PROGRAM": "kitty", "TERM_PROGRAM_VERSION": version}, b"").program == "kitty"
    detect({"TMUX": "x"}, b"", f"1|kitty({version})")


@pytest.mark.parametrize("size", [(1, 1), (99, 4000), (4000, 99), (0, 0)])
def test_a_sixel_picture_that_must_be_tiny_is_not_believed(size: tuple[int, int]) -> None:
    assert detect({}, b"\x1b[?2;0;%d;%dS" % size).sixel_size is None


@pytest.mark.parametrize("window", WINDOWS)
def test_whatever_a_terminal_sends_the_next_frame_can_be_drawn(window: tuple[int, int, int, int]) -> None:
    honest = [*SEQUENCES, *(case.replies for case in CASES)]
    for number in range(300):
        random = Random(number)
        outcome(bytes([random.randrange(256)]) + mutant(random, random.choice(honest), honest), window)
