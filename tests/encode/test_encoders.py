from __future__ import annotations

import pytest

from tests.encode.frames import gradient
from tsplat.encode import ENCODERS, encoder
from tsplat.errors import OptionError


@pytest.mark.parametrize("name", ENCODERS)
def test_every_encoder_answers_to_its_name_and_draws(name: str) -> None:
    chosen = encoder(name)
    assert chosen.name == name
    assert chosen.encode(gradient(4, 4), 3, 2, (10, 20)).draw
    assert (chosen.encode(gradient(4, 4), 3, 2, (10, 20)).upload != b"") == (name == "kitty")


def test_an_unknown_encoder_is_refused_with_the_names_there_are() -> None:
    with pytest.raises(OptionError, match="kitty, sixel, half, half256, got 'octant'"):
        encoder("octant")


@pytest.mark.parametrize(
    ("name", "known", "unknown"),
    [
        ("kitty", (9, 18), (10, 20)),
        ("sixel", (9, 18), (10, 20)),
        ("half", (1, 2), (1, 2)),
        ("half256", (1, 2), (1, 2)),
    ],
)
def test_pixels_per_cell_follow_the_cell_only_for_pictures(
    name: str, known: tuple[int, int], unknown: tuple[int, int]
) -> None:
    assert encoder(name).pixels_per_cell(9, 18) == known
    assert encoder(name).pixels_per_cell(0, 0) == unknown
