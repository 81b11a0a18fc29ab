"""Each word of the lanes against what it says it does, compiled and plain alike."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tsplat import _lanes as lanes
from tsplat._jit import claim, kernel

Eight = np.ndarray
eight = hnp.arrays(np.float32, 8, elements=st.floats(-100, 100, width=32))


@kernel
def _arithmetic(x, y, out):  # type: ignore[no-untyped-def]
    a, b = lanes.load(x, 0), lanes.load(y, 0)
    lanes.store(out, 0, a + b)
    lanes.store(out, 8, a - b)
    lanes.store(out, 16, a * b)
    lanes.store(out, 24, lanes.fma(a, b, lanes.splat(np.float32(3.0))))
    lanes.store(out, 32, lanes.minimum(a, b))
    lanes.store(out, 40, lanes.maximum(a, b))
    lanes.store(out, 48, lanes.where_at_least(a, b, lanes.splat(np.float32(7.0))))
    lanes.store(out, 56, lanes.where_above(a, b, a * b, b))
    lanes.store(out, 64, lanes.minus_abs(a))
    lanes.prefetch(x, 0)
    return lanes.largest(a)


@kernel
def _power(x, out):  # type: ignore[no-untyped-def]
    for at in range(0, len(x), 8):
        lanes.store(out, at, lanes.exp2(lanes.load(x, at)))


@kernel
def _take(counter):  # type: ignore[no-untyped-def]
    return claim(counter)


@given(x=eight, y=eight)
@settings(max_examples=50, deadline=None)
def test_lanes_do_what_their_names_say(x: Eight, y: Eight) -> None:
    out = np.zeros(72, np.float32)
    assert _arithmetic(x, y, out) == x.max()
    exact = x.astype(np.float64) * y
    expected = [x + y, x - y, exact, exact + 3, np.minimum(x, y), np.maximum(x, y), np.where(x >= y, 7, 0)]
    expected += [np.where(x > y, exact, y), -np.abs(x)]
    np.testing.assert_allclose(out, np.concatenate(expected), rtol=1e-5, atol=1e-5)


def test_exp2_is_within_its_error() -> None:
    x = np.linspace(-100, 100, 80_000, dtype=np.float32)
    out = np.zeros_like(x)
    _power(x, out)
    np.testing.assert_allclose(out, np.exp2(x.astype(np.float64)), rtol=1e-4)


def test_claims_are_counted_from_zero() -> None:
    counter = np.zeros(1, np.int64)
    assert [_take(counter) for _ in range(3)] == [0, 1, 2]
