"""The order keeps neighbours together, level by level."""

from __future__ import annotations

import numpy as np
import pytest

from tsplat._jit import JIT
from tsplat.lod.kd import kd_order
from tsplat.raster.prepare import BLOCK

BLOCKS = 37 if JIT else 5


@pytest.mark.parametrize("n", [0, 1, BLOCK, BLOCK + 1, BLOCKS * BLOCK - 3])
@pytest.mark.parametrize("threads", [1, 3])
def test_every_splat_is_there_once(n: int, threads: int) -> None:
    means = np.random.default_rng(0).normal(size=(n, 3)).astype(np.float32)
    np.testing.assert_array_equal(np.sort(kd_order(means, threads)), np.arange(n))


def test_every_two_cells_side_by_side_are_parted_by_a_plane() -> None:
    n = BLOCKS * BLOCK - 3
    means = np.random.default_rng(1).normal(size=(n, 3)).astype(np.float32)
    ordered = means[kd_order(means, 2)]
    size = BLOCK
    while size < n:
        for start in range(0, n - size, 2 * size):
            left, right = ordered[start : start + size], ordered[start + size : start + 2 * size]
            assert (left.max(0) <= right.min(0)).any() or (left.min(0) >= right.max(0)).any()
        size *= 2


def test_splats_at_one_place_are_no_trouble() -> None:
    means = np.zeros((3 * BLOCK, 3), np.float32)
    np.testing.assert_array_equal(np.sort(kd_order(means, 1)), np.arange(3 * BLOCK))
