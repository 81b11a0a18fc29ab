from __future__ import annotations

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsplat.terminal.keys import Answered, Focus, Key, Mouse
from tsplat.terminal.parser import Parser, PixelReport, Reported, SizeReport

SEQUENCES: dict[bytes, list[Reported]] = {
    b"a": [Key("a")],
    b"A": [Key("A")],
    b"+?": [Key("+"), Key("?")],
    b" ": [Key("space")],
    b"\t\r\n": [Key("tab"), Key("enter"), Key("enter")],
    b"\x7f\x08": [Key("backspace"), Key("backspace")],
    b"\x03\x1a\x00\x1c": [Key("ctrl+c"), Key("ctrl+z"), Key("ctrl+space"), Key("ctrl+\\")],
    "\u00e9\u20ac\U0001f600".encode(): [Key("\u00e9"), Key("\u20ac"), Key("\U0001f600")],
    b"\x1b[A\x1b[B\x1b[C\x1b[D": [Key("up"), Key("down"), Key("right"), Key("left")],
    b"\x1bOA\x1bOH\x1bOF": [Key("up"), Key("home"), Key("end")],
    b"\x1bOk\x1bOm\x1bOM\x1bOq": [Key("+"), Key("-"), Key("enter"), Key("1")],
    b"\x1b[H\x1b[1~\x1b[7~": [Key("home")] * 3,
    b"\x1b[3~\x1b[5~\x1b[6~": [Key("delete"), Key("pageup"), Key("pagedown")],
    b"\x1bOP\x1b[11~\x1b[[A\x1b[24~": [Key("f1"), Key("f1"), Key("f1"), Key("f12")],
    b"\x1b[1;2A\x1b[1;5C\x1b[3;3~": [Key("shift+up"), Key("ctrl+right"), Key("alt+delete")],
    b"\x1b[1;8A": [Key("ctrl+alt+shift+up")],
    b"\x1b[Z": [Key("shift+tab")],
    b"\x1bx\x1b\r": [Key("alt+x"), Key("alt+enter")],
    b"\x1b\x1b[A": [Key("escape"), Key("up")],
    # The kitty keyboard: code:shifted;modifiers:action.
    b"\x1b[27u\x1b[99;5u": [Key("escape"), Key("ctrl+c")],
    b"\x1b[119;1:3u\x1b[119;1:2u": [Key("w", "release"), Key("w", "repeat")],
    b"\x1b[119:87;2:3u\x1b[119;2:3u": [Key("W", "release"), Key("W", "release")],
    b"\x1b[61:43;2:3u": [Key("+", "release")],
    b"\x1b[97;65:3u\x1b[97;129u": [Key("a", "release"), Key("a")],
    b"\x1b[1;1:3A\x1b[5;1:2~\x1b[1;2:3D": [
        Key("up", "release"),
        Key("pageup", "repeat"),
        Key("shift+left", "release"),
    ],
    b"\x1b[57413u\x1b[57414;1:3u\x1b[57417u": [Key("+"), Key("enter", "release"), Key("left")],
    # What went down comes up, though shift was let go first; the third field is the text typed.
    b"\x1b[61:43;2;43u\x1b[61:43;2:2;43u\x1b[61;1:3u": [Key("+"), Key("+", "repeat"), Key("+", "release")],
    b"\x1b[97:65;2;65u\x1b[97;1:3u\x1b[97;;97u": [Key("A"), Key("A", "release"), Key("a")],
    b"\x1b[1;2D\x1b[1;1:3D\x1b[3;5~\x1b[3;1:3~": [
        *(Key("shift+left"), Key("shift+left", "release"), Key("ctrl+delete"), Key("ctrl+delete", "release")),
    ],
    b"\x1b[99;5u\x1b[99;1:3u": [Key("ctrl+c"), Key("ctrl+c", "release")],
    b"\x1b[97;65;65u": [Key("A")],
    b"\x1b[57441;2u\x1b[57441;1:3u": [],
    b"\x1b[32;2u\x1b[9;2u": [Key("shift+space"), Key("shift+tab")],
    b"\x1b[27;5;99~": [Key("ctrl+c")],
    # The mouse counts from one.
    b"\x1b[<0;1;1M\x1b[<0;3;2m": [Mouse("press", "left", 0, 0), Mouse("release", "left", 2, 1)],
    b"\x1b[<32;10;5M\x1b[<34;10;5M": [Mouse("drag", "left", 9, 4), Mouse("drag", "right", 9, 4)],
    b"\x1b[<35;300;200M": [Mouse("move", "none", 299, 199)],
    b"\x1b[<64;1;1M\x1b[<65;1;1M\x1b[<66;1;1M": [
        Mouse("wheel", "none", 0, 0, 1),
        Mouse("wheel", "none", 0, 0, -1),
    ],
    b"\x1b[<4;1;1M\x1b[<68;1;1M": [Mouse("press", "left", 0, 0, 0, True), Mouse("wheel", "none", 0, 0, 1, True)],
    b"\x1b[I\x1b[O": [Focus(True), Focus(False)],
    # Replies, late or not, are no keys.
    b"\x1b[?62;4;22c\x1b[?2026;2$y\x1b[?5u\x1b[24;80R": [],
    b"\x1bP>|kitty(0.26.5)\x1b\\\x1b_Gi=31;OK\x1b\\\x1b]11;rgb:0000/0000/0000\x07q": [Key("q")],
    b"\x1b[6;20;10t\x1b[4;480;800t\x1b[8;24;80t": [PixelReport(6, 10, 20), PixelReport(4, 800, 480)],
    b"a\x1b[0nb\x1b[3n\x1b[?0n": [Key("a"), Answered(), Key("b")],
    b"\x1b[200~q\x1b[0nq\x1b[201~": [Answered()],
    b"\x1b[48;30;100;600;1000t\x1b[48;30;100;0;0tq": [
        SizeReport(100, 30, 1000, 600),
        SizeReport(100, 30, 0, 0),
        Key("q"),
    ],
    b"\x1b[200~q\x03\x1b[A\x1b[201~x": [Key("x")],
    b"\xff\xc3(\x80z": [Key("("), Key("z")],
}


@pytest.mark.parametrize("received", SEQUENCES, ids=repr)
def test_a_sequence_means_its_events(received: bytes) -> None:
    parser = Parser()
    assert parser.feed(received) == SEQUENCES[received]
    assert not parser.pending


@given(st.lists(st.sampled_from(sorted(SEQUENCES)), max_size=6), st.integers(1, 5))
def test_pieces_of_any_size_mean_the_same(sequences: list[bytes], size: int) -> None:
    received, parser = b"".join(sequences), Parser()
    pieces = [received[start : start + size] for start in range(0, len(received), size)]
    assert [event for piece in pieces for event in parser.feed(piece)] == Parser().feed(received)


@given(st.binary(max_size=60))
def test_garbage_is_swallowed_and_the_next_key_still_arrives(garbage: bytes) -> None:
    parser = Parser()
    parser.feed(garbage + b"\x1b[201~")
    parser.flush()
    parser.feed(b"\x1b\\@")
    assert parser.feed(b"q") == [Key("q")]


def test_a_lone_escape_is_the_key_only_when_nothing_follows() -> None:
    parser = Parser()
    assert parser.feed(b"\x1b") == []
    assert parser.pending
    assert parser.flush() == [Key("escape")]
    assert not parser.pending
    assert parser.feed(b"\x1b") + parser.feed(b"[A") == [Key("up")]


def test_alt_and_a_bracket_is_a_key_when_nothing_follows() -> None:
    parser = Parser()
    assert parser.feed(b"\x1b[") == []
    assert parser.flush() == [Key("alt+[")]


def test_a_string_that_never_ends_is_given_up() -> None:
    parser = Parser()
    assert parser.feed(b"\x1b]11;half a reply") == []
    parser.flush()
    assert parser.feed(b"q") == [Key("q")]


@pytest.mark.parametrize("reply", [b"\x1bP>|kitty(0.26.5)\x1b\\", b"\x1b_Gi=31;OK\x1b\\", b"\x1b[6;20;10t"])
def test_a_late_reply_torn_in_two_by_a_slow_line_is_no_key(reply: bytes) -> None:
    for cut in range(4, len(reply)):
        parser = Parser()
        events = parser.feed(reply[:cut]) + parser.flush() + parser.feed(reply[cut:] + b"q")
        assert [event for event in events if isinstance(event, Key)] == [Key("q")]


def test_each_late_reply_may_be_torn() -> None:
    parser, reply = Parser(), b"\x1bP>|kitty(0.26.5)\x1b\\"
    for _ in range(3):
        assert parser.feed(reply[:9]) + parser.flush() + parser.feed(reply[9:]) == []


def test_a_reply_that_never_ends_costs_one_key() -> None:
    parser = Parser()
    for _ in range(2):
        assert parser.feed(b"\x1bP>|half a reply") + parser.flush() + parser.feed(b"q") + parser.flush() == []
        assert parser.feed(b"q") == [Key("q")]


def test_a_reply_torn_in_two_by_a_slow_line_is_no_key() -> None:
    parser = Parser()
    assert parser.feed(b"\x1b[?62;4") + parser.flush() + parser.feed(b";22c") == []


def test_mouse_positions_in_pixels_become_fractions_of_cells() -> None:
    parser = Parser()
    parser.mouse_unit = (10, 20)
    assert parser.feed(b"\x1b[<32;26;11M") == [Mouse("drag", "left", 2.5, 0.5)]


def test_a_mouse_motion_costs_less_than_a_tenth_of_a_millisecond() -> None:
    received, parser = b"\x1b[<35;12;7M" * 1000, Parser()
    best = float("inf")
    for _ in range(3):
        start = time.perf_counter()
        assert len(parser.feed(received)) == 1000
        best = min(best, time.perf_counter() - start)
    assert best < 0.1
