"""Kernels that decode, against their slow twins, bit for bit; and against what is worked out by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from tsplat.decode import kernels, plain

F32 = npt.NDArray[np.float32]
COUNTS = [0, 1, 255, 256, 257, 700]
TOPS = np.array([2047, 1023, 2047], np.uint32)
SHIFTS = np.array([21, 11, 0], np.uint32)
LEVELS = ((np.arange(1024) / 1023 - 0.5) * math.sqrt(2.0)).astype(np.float32)
PLACES = np.array([[0, 1, 2, 3], [1, 0, 2, 3], [2, 0, 1, 3], [3, 0, 1, 2]], np.uint8)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def both(name: str, shape: tuple[int, ...], *arguments: Any) -> F32:
    """Return what the twin makes of it, once the kernel made the same bits."""
    found, wanted = (np.full(shape, -7.0, np.float32) for _ in range(2))
    with np.errstate(all="ignore"):
        getattr(kernels, name)(*arguments, found)
        getattr(plain, name)(*arguments, wanted)
    np.testing.assert_array_equal(found, wanted)
    same = found.view(np.uint32) == wanted.view(np.uint32)
    assert (same | np.isnan(wanted)).all()
    return wanted


def words(rng: np.random.Generator, count: int) -> npt.NDArray[np.uint32]:
    return rng.integers(0, 1 << 32, count, dtype=np.uint32)


def groups(rng: np.random.Generator, count: int, spread: float) -> F32:
    return rng.normal(0.0, spread, (-(-count // 256), 3)).astype(np.float32)


@pytest.mark.parametrize("count", COUNTS)
def test_bytes_are_looked_up_in_the_columns_that_are_wanted(rng: np.random.Generator, count: int) -> None:
    steps = rng.integers(0, 256, (count, 9), dtype=np.uint8)
    columns = rng.permutation(9).astype(np.uint8)
    levels = rng.normal(size=256).astype(np.float32)
    found = both("look_up", (count, 12), steps, columns, levels, 3)
    np.testing.assert_array_equal(found[:, 3:], levels[steps[:, columns]])
    assert (found[:, :3] == -7.0).all(), "other columns stay"


@pytest.mark.parametrize("count", COUNTS)
def test_bytes_are_scaled_from_the_middle(rng: np.random.Generator, count: int) -> None:
    steps = rng.integers(0, 256, (count, 45), dtype=np.uint8)
    factors = rng.normal(size=45).astype(np.float32)
    found = both("scale", (count, 50), steps, np.float32(127.5), factors, 2)
    np.testing.assert_allclose(found[:, 2:47], (steps.astype(np.float64) - 127.5) * factors, rtol=1e-7)
    assert (found[:, [0, 1, 47, 48, 49]] == -7.0).all(), "other columns stay"


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("spread", [1e-3, 1.0, 1e30])
def test_fields_lie_between_the_bounds_of_their_group(rng: np.random.Generator, count: int, spread: float) -> None:
    low, high = groups(rng, count, spread), groups(rng, count, spread)
    packed = words(rng, count)
    found = both("between", (count, 5), packed, SHIFTS, TOPS, low, high, 256)
    group = np.arange(count) // 256
    part = (packed[:, None] >> SHIFTS & TOPS) / TOPS
    wanted = low[group] * (1.0 - part) + high[group].astype(np.float64) * part
    np.testing.assert_allclose(found[:, :3], wanted, rtol=1e-6, atol=1e-7 * spread)
    assert (found[:, 3:] == -7.0).all(), "other columns stay"


def test_the_ends_of_a_field_are_the_bounds_to_the_bit(rng: np.random.Generator) -> None:
    low, high = groups(rng, 256, 1.0), groups(rng, 256, 1.0)
    packed = np.array([0, 2**32 - 1], np.uint32)
    found = both("between", (2, 3), packed, SHIFTS, TOPS, low, high, 256)
    np.testing.assert_array_equal(found, np.concatenate([low, high]))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, np.finfo(np.float32).max])
def test_bounds_that_are_no_numbers_reach_their_own_group_only(rng: np.random.Generator, bad: float) -> None:
    low, high = groups(rng, 700, 1.0).copy(), groups(rng, 700, 1.0)
    low[1] = bad
    found = both("between", (700, 3), words(rng, 700), SHIFTS, TOPS, low, high, 256)
    assert np.isfinite(found[:256]).all()
    assert np.isfinite(found[512:]).all()
    assert np.isfinite(found[256:512]).any() == np.isfinite(bad)


@pytest.mark.parametrize("count", COUNTS)
def test_three_components_become_a_unit_quat(rng: np.random.Generator, count: int) -> None:
    packed = words(rng, count)
    found = both("smallest_three", (count, 4), packed, LEVELS, PLACES)
    np.testing.assert_allclose(np.linalg.norm(found.astype(np.float64), axis=1), 1.0, atol=1e-6)
    for word, quat in zip(packed.tolist(), found.tolist(), strict=True):
        others = [float(LEVELS[word >> shift & 1023]) for shift in (20, 10, 0)]
        length = math.hypot(*others)
        wanted = [each / max(1.0, length) for each in others]
        wanted.insert(word >> 30, math.sqrt(max(0.0, 1.0 - length * length)))
        np.testing.assert_allclose(quat, wanted, rtol=1e-6, atol=1e-6)
