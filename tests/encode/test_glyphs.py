from __future__ import annotations

import numpy as np
import pytest

from tests.encode.screens import OCTANT_GAPS, lit
from tsplat.encode.glyphs import RAMP, shape

SHAPES = ["half", "quadrant", "sextant", "octant", "braille"]


@pytest.mark.parametrize("name", SHAPES)
def test_each_glyph_lights_what_its_name_says_and_no_other_does(name: str) -> None:
    chosen = shape(name)
    assert len(set(chosen.glyphs)) == len(chosen.glyphs) == 1 << chosen.across * chosen.down
    for pattern, glyph in enumerate(chosen.glyphs):
        shown = lit(glyph, chosen.across, chosen.down).ravel()
        assert [bool(pattern >> i & 1) for i in range(len(shown))] == shown.tolist()
        assert np.array_equal(chosen.lit[pattern], shown)


def test_octants_stand_in_ascending_order_but_for_those_that_exist_elsewhere() -> None:
    glyphs = shape("octant").glyphs
    ordered = [glyph for pattern, glyph in enumerate(glyphs) if pattern not in OCTANT_GAPS]
    assert "".join(ordered) == "".join(map(chr, range(0x1CD00, 0x1CDE6)))
    assert not any("\U0001cd00" <= glyphs[pattern] <= "\U0001cde5" for pattern in OCTANT_GAPS)


def test_the_ramp_is_ascii_from_a_space_to_the_brightest() -> None:
    ink = list(RAMP.values())
    assert "".join(RAMP).isascii()
    assert next(iter(RAMP)) == " "
    assert ink == sorted(set(ink))
    assert (ink[0], ink[-1]) == (0.0, 1.0)
