from __future__ import annotations

import re

import numpy as np
import pytest

from tests.encode.frames import gradient
from tsplat.encode import ENCODERS, encoder
from tsplat.errors import OptionError

TEXT = ("octant", "sextant", "quadrant", "half", "half256", "braille", "ascii")


@pytest.mark.parametrize("name", ["kitty", "iterm2", "sixel", *TEXT])
def test_every_encoder_answers_to_its_name_and_draws(name: str) -> None:
    chosen = encoder(name)
    assert chosen.name == name
    assert chosen.encode(gradient(4, 4), 3, 2, (10, 20)).draw
    assert (chosen.encode(gradient(4, 4), 3, 2, (10, 20)).upload != b"") == (name == "kitty")


def test_text_comes_last_and_has_as_many_colours_as_the_terminal() -> None:
    assert ENCODERS[-len(TEXT) :] == TEXT
    black = np.zeros((8, 2, 3), np.uint8)
    backgrounds = {1 << 24: b"48;2;0;0;0", 256: b"48;5;16", 16: b"40"}
    for name in TEXT:
        for colors in (256, 16) if name == "half256" else backgrounds:
            assert backgrounds[colors] + b"m" in encoder(name, colors).encode(black, 1, 1, (0, 0)).draw
        assert set(re.findall(rb"\x1b\[([\d;]*)m", encoder(name, 0).encode(black, 1, 1, (0, 0)).draw)) == {b"0"}


def test_an_unknown_encoder_is_refused_with_the_names_there_are() -> None:
    with pytest.raises(OptionError, match=r"one of kitty, iterm2, sixel, octant, .*, ascii, got 'ansi'"):
        encoder("ansi")


@pytest.mark.parametrize(
    ("name", "known", "unknown"),
    [
        ("kitty", (9, 18), (10, 20)),
        ("sixel", (9, 18), (10, 20)),
        ("half", (1, 2), (1, 2)),
        ("half256", (1, 2), (1, 2)),
        ("quadrant", (2, 2), (2, 2)),
        ("sextant", (2, 3), (2, 3)),
        ("octant", (2, 4), (2, 4)),
        ("braille", (2, 4), (2, 4)),
        ("ascii", (1, 2), (1, 2)),
    ],
)
def test_pixels_per_cell_follow_the_cell_only_for_pictures(
    name: str, known: tuple[int, int], unknown: tuple[int, int]
) -> None:
    assert encoder(name).pixels_per_cell(9, 18) == known
    assert encoder(name).pixels_per_cell(0, 0) == unknown
