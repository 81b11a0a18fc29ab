"""Each word of the lanes against what it says it does, compiled and plain alike."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tsplat import _lanes as lanes
from tsplat import _moves as moves
from tsplat._jit import kernel
from tsplat.raster.buffers import aligned

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
    lanes.store(out, 72, a / lanes.splat(np.float32(4.0)))
    lanes.store(out, 80, lanes.sqrt(a * a))
    lanes.store(out, 88, lanes.eighth_power(a))
    lanes.store(out, 96, lanes.eighth_power(a * lanes.splat(np.float32(1e6))))
    lanes.store(out, 104, lanes.sqrt(lanes.minus_abs(a) - lanes.splat(np.float32(1.0))))
    moves.prefetch(x, 0)


@kernel
def _power(x, out):  # type: ignore[no-untyped-def]
    for at in range(0, len(x), 8):
        lanes.store(out, at, lanes.exp2(lanes.load(x, at)))


@kernel
def _move(x, halves, mixed, pixels, transposed):  # type: ignore[no-untyped-def]
    moves.store_half(halves, 0, lanes.load(x, 0))
    lanes.store(x, 64, moves.load_half(halves, 0))
    lanes.store(mixed, 0, moves.first_halves(lanes.load(x, 0), lanes.load(x, 8)))
    lanes.store(mixed, 8, moves.second_halves(lanes.load(x, 0), lanes.load(x, 8)))
    first, second, third = moves.interleaved(lanes.load(x, 0), lanes.load(x, 8), lanes.load(x, 16))
    lanes.store(pixels, 0, first)
    lanes.store(pixels, 8, second)
    lanes.store(pixels, 16, third)
    moves.store_transposed(transposed, 0, 10, x, 0, 8)


@kernel
def _pair(x, pairs):  # type: ignore[no-untyped-def]
    moves.store_paired_halves(pairs, 2, lanes.load(x, 0), lanes.load(x, 8))


@kernel
def _bypass(x, out):  # type: ignore[no-untyped-def]
    moves.store_past_caches(out, 8, lanes.load(x, 3))


@given(x=eight, y=eight)
@settings(max_examples=50, deadline=None)
def test_lanes_do_what_their_names_say(x: Eight, y: Eight) -> None:
    out = np.zeros(112, np.float32)
    _arithmetic(x, y, out)
    exact = x.astype(np.float64) * y
    expected = [x + y, x - y, exact, exact + 3, np.minimum(x, y), np.maximum(x, y), np.where(x >= y, 7, 0)]
    expected += [np.where(x > y, exact, y), -np.abs(x), x / 4, np.abs(x)]
    with np.errstate(over="ignore"):
        expected += [x.astype(np.float64) ** 8, (x * np.float32(1e6)) ** 8]
    expected += [np.full(8, np.nan)]
    np.testing.assert_allclose(out, np.concatenate(expected), rtol=1e-5, atol=1e-5)


def test_exp2_is_within_its_error() -> None:
    x = np.linspace(-100, 100, 80_000, dtype=np.float32)
    out = np.zeros_like(x)
    _power(x, out)
    np.testing.assert_allclose(out, np.exp2(x.astype(np.float64)), rtol=1e-4)


def test_values_that_go_past_the_caches_arrive() -> None:
    x, out = np.arange(16, dtype=np.float32), aligned(24, np.float32)
    out[:] = -1
    _bypass(x, out)
    np.testing.assert_array_equal(out, [-1] * 8 + list(range(3, 11)) + [-1] * 8)


def test_paired_halves_lie_side_by_side() -> None:
    x, pairs = np.arange(16, dtype=np.float32) / 3, np.zeros(12, np.float32)
    _pair(x, pairs)
    np.testing.assert_array_equal(pairs[2:10].view(np.float16).reshape(8, 2), x.reshape(2, 8).T.astype(np.float16))
    assert not pairs[:2].any()
    assert not pairs[10:].any()


def test_values_move_where_the_names_say() -> None:
    x = np.linspace(-3, 60, 72, dtype=np.float32)
    given = x[:64].reshape(8, 8).copy()
    halves = np.zeros(8, np.uint16)
    mixed, pixels, transposed = (np.zeros(length, np.float32) for length in (16, 24, 80))
    _move(x, halves, mixed, pixels, transposed)
    np.testing.assert_array_equal(halves.view(np.float16), given[0].astype(np.float16))
    np.testing.assert_array_equal(x[64:], given[0].astype(np.float16).astype(np.float32))
    np.testing.assert_array_equal(mixed.reshape(2, 2, 4), given[:2].reshape(2, 2, 4).swapaxes(0, 1))
    np.testing.assert_array_equal(pixels.reshape(8, 3), given[:3].T)
    np.testing.assert_array_equal(transposed.reshape(8, 10)[:, :8], given.T)
