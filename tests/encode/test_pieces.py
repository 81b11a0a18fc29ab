"""A frame in pieces is the same frame, and no piece ends within an escape sequence."""

from __future__ import annotations

import re

import numpy as np
import pyte
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.encode.frames import gradient
from tsplat.encode import encoder
from tsplat.encode.pieces import pieces, split

SEQUENCES = (
    b"\x1b[3;4H",
    b"\x1b[0m",
    b"text",
    b"\x1b_Ga=t;QUJD\x1b\\",
    b"\x1bPtmux;\x1b\x1b_Gm=0;QQ\x1b\x1b\\\x1b\\",
    b"\x1b7",
    b"\x1b8",
)


@given(st.lists(st.sampled_from(SEQUENCES), max_size=40), st.integers(1, 60))
@settings(max_examples=200, deadline=None)
def test_pieces_are_whole_sequences_and_together_the_screen(parts: list[bytes], size: int) -> None:
    screen = b"".join(parts)
    found = list(split(screen, size))
    assert b"".join(found) == screen
    assert all(found)
    for piece in found:
        rest = piece
        for sequence in sorted(SEQUENCES, key=len, reverse=True):
            rest = rest.replace(sequence, b"")
        assert rest == b""
        assert (
            len(piece) <= size or len(re.findall(rb"(?<!\x1b)\x1b(?![\x1b\\])", piece.removeprefix(b"\x1b"))) <= 1
        )


@pytest.mark.parametrize("name", ["half", "half256"])
def test_a_frame_of_cells_in_pieces_leaves_the_screen_that_the_whole_frame_leaves(name: str) -> None:
    frame = gradient(40, 48)
    screens = []
    for size in (1 << 30, 500):
        screen = pyte.Screen(42, 26)
        stream = pyte.ByteStream(screen)
        found = list(pieces(encoder(name), frame, 40, 24, (10, 20), size))
        assert (len(found) > 5) is (size == 500)
        for piece in found:
            stream.feed(piece)
        screens.append(
            [[(c.data, c.fg, c.bg) for c in map(screen.buffer[y].__getitem__, range(42))] for y in range(26)]
        )
    assert screens[0] == screens[1]


def test_a_picture_in_one_sequence_comes_in_bands_of_text_rows_that_cover_it() -> None:
    frame = np.random.default_rng(0).integers(0, 256, (120, 80, 3), np.uint8)
    found = list(pieces(encoder("sixel"), frame, 8, 6, (10, 20), 12_000))
    heights = [int(match[1]) for piece in found if (match := re.search(rb'"1;1;80;(\d+)', piece))]
    assert len(heights) == len(found) > 1
    assert sum(heights) == 120
    starts = [int(match[1]) if (match := re.match(rb"\x1b\[(\d+)B", piece)) else 0 for piece in found]
    assert [20 * start for start in starts] == [sum(heights[:place]) for place in range(len(heights))]
