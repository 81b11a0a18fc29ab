"""Each word of the sets against what it says it does, compiled and plain alike."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tsplat import _bits as bits
from tsplat import _lanes as lanes
from tsplat._jit import kernel


@kernel
def _taken_apart(members, found):  # type: ignore[no-untyped-def]
    found[0], found[1], found[2] = bits.lowest(members), bits.count(members), bits.others(members)


@kernel
def _having(masks, bit):  # type: ignore[no-untyped-def]
    return bits.having(masks, bit)


@kernel
def _at_least(x, limit):  # type: ignore[no-untyped-def]
    return bits.lanes_at_least(lanes.load(x, 0), lanes.load(limit, 0))


@kernel
def _spans(ends):  # type: ignore[no-untyped-def]
    return bits.spans(lanes.load(ends, 0))


@given(st.sets(st.integers(0, 63)))
@settings(max_examples=50, deadline=None)
def test_the_lowest_member_the_others_and_their_number(members: set[int]) -> None:
    lowest = min(members, default=64)
    others = sum(1 << member for member in members - {lowest})
    found = np.empty(3, np.uint64)
    _taken_apart(np.uint64(sum(1 << member for member in members)), found)
    assert found.tolist() == [lowest, len(members), others]


@given(hnp.arrays(np.uint16, 64), st.integers(0, 15))
@settings(max_examples=50, deadline=None)
def test_sets_that_have_a_member(masks: np.ndarray, bit: int) -> None:
    assert int(_having(masks, bit)) == sum(1 << i for i, mask in enumerate(masks) if int(mask) & 1 << bit)


eight = hnp.arrays(np.float32, 8, elements=st.sampled_from([-2.0, -0.0, 0.0, 1.0, float("nan")]))


@given(x=eight, limit=eight)
@settings(max_examples=50, deadline=None)
def test_lanes_that_are_at_least_a_limit(x: np.ndarray, limit: np.ndarray) -> None:
    assert _at_least(x, limit) == sum(1 << lane for lane in range(8) if x[lane] >= limit[lane])


def four(low: int, high: int) -> st.SearchStrategy[list[int]]:
    return st.lists(st.integers(low, high), min_size=4, max_size=4)


@given(last=four(-1, 3), first=four(0, 4), more=st.sampled_from([0.0, 0.25, 0.99]))
@settings(max_examples=100, deadline=None)
def test_spans_are_the_cells_from_the_first_to_the_last_of_each_row(
    last: list[int], first: list[int], more: float
) -> None:
    ends = np.asarray(last + [-column for column in first], np.float32) + np.float32(more)
    expected = {4 * row + column for row in range(4) for column in range(first[row], last[row] + 1)}
    assert _spans(ends) == sum(1 << cell for cell in expected)
