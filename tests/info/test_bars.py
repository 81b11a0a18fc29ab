from __future__ import annotations

import pytest

from tsplat.info.bars import ASCII, BLOCKS, bars


def test_the_highest_bar_is_full_and_the_least_can_be_seen() -> None:
    assert bars([0, 1, 500, 1000], 4, blocks=True) == " ▁▄█"
    assert bars([0, 1, 500, 1000], 4, blocks=False) == " .=@"


@pytest.mark.parametrize("blocks", [True, False])
def test_more_is_never_drawn_lower(blocks: bool) -> None:
    levels = BLOCKS if blocks else ASCII
    drawn = [levels.index(each) for each in bars(range(1, 101), 100, blocks=blocks)]
    assert drawn == sorted(drawn)
    assert set(drawn) == set(range(8))


def test_a_narrow_chart_sums_neighbours() -> None:
    assert bars([1, 1, 4, 0, 0, 0], 3, blocks=True) == bars([2, 4, 0], 3, blocks=True) == "▄█ "


def test_nothing_at_all_is_drawn_as_nothing() -> None:
    assert bars([0] * 6, 3, blocks=True) == "   "


def test_one_of_all_splats_in_the_world_can_be_seen() -> None:
    assert bars([1, 10**18], 2, blocks=True) == "▁█"
