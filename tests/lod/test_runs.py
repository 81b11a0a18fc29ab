"""Runs of splats against slow and obvious ways to pack and to describe them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from tests.lod.slow import area
from tests.scenes import random_gaussians
from tsplat._jit import JIT
from tsplat.io.arrays import Arrays
from tsplat.lod.runs import lost, pack_runs, summarize
from tsplat.raster.prepare import BLOCK, empty, prepared
from tsplat.scene import Gaussians

pytestmark = pytest.mark.skipif(not JIT, reason="slow without a compiler")

COUNTS = (1, 256, 0, 300, 513)
FIRST = 2
"""Block of the first run."""


@pytest.fixture
def runs() -> tuple[list[Gaussians], Arrays, np.ndarray]:
    """Return runs, one of them of no splats, the splats of all and one more, and where the runs end."""
    scene = random_gaussians(np.random.default_rng(0), sum(COUNTS) + 1, 1)
    scene.opacities.flags.writeable = True
    scene.opacities[-1] = 0.0
    ends = np.cumsum([0, *COUNTS])
    parts = [scene.take(np.arange(first, last)) for first, last in pairwise(ends)]
    return parts, Arrays(*scene.arrays), ends


@pytest.mark.parametrize("threads", [1, 3])
def test_a_run_is_packed_as_a_scene_of_its_own(
    runs: tuple[list[Gaussians], Arrays, np.ndarray], threads: int
) -> None:
    parts, splats, ends = runs
    # A block for the run of none: it had a splat in the file.
    blocks = FIRST + np.cumsum([0, 1, 1, 1, 2, 3], dtype=np.int32)
    scene = empty(int(blocks[-1]) + 1, 3)
    before = np.copy(scene.log2_opacities)
    pack_runs(splats, ends, blocks, scene.target(), threads)
    for part, first, last in zip(parts, blocks, blocks[1:], strict=False):
        own = slice(int(first) * BLOCK, int(last) * BLOCK)
        if not len(part):
            assert (scene.log2_opacities[own] <= -126).all()
            middle = scene.bounds.reshape(len(scene.blocks), -1)[first, :3]
            np.testing.assert_allclose(middle, splats.means[-1], 1e-6)
            continue
        alone = prepared(part, 1)
        np.testing.assert_array_equal(scene.log2_opacities[own], alone.log2_opacities)
        for name, rows in (("means", 3), ("covars", 6), ("base_colors", 3)):
            ours, theirs = (getattr(each, name).reshape(rows, -1) for each in (scene, alone))
            np.testing.assert_array_equal(ours[:, own], theirs, err_msg=name)
        for name in ("bounds", "sh_rest"):
            ours, theirs = getattr(scene, name).reshape(len(scene.blocks), -1), getattr(alone, name)
            np.testing.assert_array_equal(ours[first:last].ravel(), theirs, err_msg=name)
    for outside in (slice(0, FIRST * BLOCK), slice(int(blocks[-1]) * BLOCK, None)):
        np.testing.assert_array_equal(scene.log2_opacities[outside], before[outside])


def test_runs_are_described_as_splat_by_splat(runs: tuple[list[Gaussians], Arrays, np.ndarray]) -> None:
    parts, splats, ends = runs
    found = summarize(splats, ends)
    for run, part in enumerate(parts):
        if not len(part):
            assert found.boxes[run, 0] > found.boxes[run, 3]
            assert not found.masses[run].any()
            assert found.sizes[run] == found.largest[run] == 0.0
            continue
        areas = np.array([area(np.diag(scale.astype(np.float64) ** 2)) for scale in part.scales])
        masses = part.opacities * areas
        np.testing.assert_allclose(found.masses[run], [masses.sum(), (part.opacities * masses).sum()], 1e-5)
        np.testing.assert_allclose(found.sizes[run], np.sqrt((masses * areas).sum() / masses.sum()), 1e-5)
        np.testing.assert_array_equal(found.boxes[run], [*part.means.min(axis=0), *part.means.max(axis=0)])
        assert found.largest[run] == part.scales.max()


def test_nothing_is_lost_by_the_same_splats_and_more_by_fewer(
    runs: tuple[list[Gaussians], Arrays, np.ndarray],
) -> None:
    _, splats, _ = runs
    whole, half, tenth = (summarize(splats, np.array([0, count])).masses for count in (1000, 500, 100))
    assert lost(whole, whole) == 0.0
    assert 0.0 < lost(half, whole) < lost(tenth, whole)
