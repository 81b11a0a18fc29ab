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
def _transpose_sets(sets, found):  # type: ignore[no-untyped-def]
    bits.transpose_sets(sets, found)


@kernel
def _at_least(x, limit):  # type: ignore[no-untyped-def]
    return bits.lanes_at_least(lanes.load(x, 0), lanes.load(limit, 0))


@kernel
def _add_spans(sets, at, row, before, after):  # type: ignore[no-untyped-def]
    bits.add_spans(sets, at, row, lanes.load(before, 0), lanes.load(after, 0))


@given(st.sets(st.integers(0, 63)))
@settings(max_examples=50, deadline=None)
def test_the_lowest_member_the_others_and_their_number(members: set[int]) -> None:
    lowest = min(members, default=64)
    others = sum(1 << member for member in members - {lowest})
    found = np.empty(3, np.uint64)
    _taken_apart(np.uint64(sum(1 << member for member in members)), found)
    assert found.tolist() == [lowest, len(members), others]


@given(hnp.arrays(np.uint16, 64))
@settings(max_examples=50, deadline=None)
def test_transposed_sets_say_which_sets_have_each_member(sets: np.ndarray) -> None:
    found = np.zeros(16, np.uint64)
    _transpose_sets(sets, found)
    expected = [sum(1 << i for i, each in enumerate(sets) if int(each) & 1 << member) for member in range(16)]
    assert found.tolist() == expected


eight = hnp.arrays(np.float32, 8, elements=st.sampled_from([-2.0, -0.0, 0.0, 1.0, float("nan")]))


@given(x=eight, limit=eight)
@settings(max_examples=50, deadline=None)
def test_lanes_that_are_at_least_a_limit(x: np.ndarray, limit: np.ndarray) -> None:
    assert _at_least(x, limit) == sum(1 << lane for lane in range(8) if x[lane] >= limit[lane])


left_out = hnp.arrays(np.int64, 8, elements=st.integers(0, 4))


@given(
    sets=hnp.arrays(np.uint16, 12), row=st.integers(0, 3), before=left_out, after=left_out, more=st.floats(0, 0.99)
)
@settings(max_examples=100, deadline=None)
def test_spans_add_the_cells_of_a_row_but_those_left_out_and_change_no_other_set(
    sets: np.ndarray, row: int, before: np.ndarray, after: np.ndarray, more: float
) -> None:
    expected = sets.copy()
    for lane in range(8):
        for column in range(before[lane], 4 - after[lane]):
            expected[2 + lane] |= 1 << 4 * row + column
    _add_spans(sets, 2, row, (before + more).astype(np.float32), (after + more).astype(np.float32))
    np.testing.assert_array_equal(sets, expected)
