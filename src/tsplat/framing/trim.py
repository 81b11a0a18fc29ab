"""A sample without what is far from its middle, but with thin parts that hang together with the rest."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from tsplat.framing.sample import Mask, Sample, quantile, sample
from tsplat.scene import Gaussians

F64 = npt.NDArray[np.float64]

REACH = 2.5
"""The bulk ends this many median distances from its middle: beyond a uniform rod, disc or ball, whose
edges lie at 2, 1.4 and 1.3, and far inside the backdrop of an outdoor capture. At 2.2, a rod of a few
hundred splats loses its ends one after the other."""

FARTHEST = 2.0
"""A thin part ends within this many reaches of the middle."""

CELLS = 12
"""Cells of a reach: splats hang together where they lie in one, or in two that touch."""

OPAQUE = 0.3
FEWEST = 8
"""A part is opaque, and more than a few splats."""

PARTS, CONE = 3, 0.93
THIN = 0.95
"""Seen from the middle, such parts lie within three cones of 22 degrees to either side, all but a twentieth of
them: what goes on in all directions, as a ground does, is no part."""


_trimmed: WeakKeyDictionary[Gaussians, Sample] = WeakKeyDictionary()


def trimmed_sample(gaussians: Gaussians) -> Sample:
    """Return the trimmed sample of a scene; it is made once and goes with the scene."""
    found = _trimmed.get(gaussians)
    if found is None:
        found = _trimmed[gaussians] = trimmed(sample(gaussians))
    return found


def trimmed(sample: Sample) -> Sample:
    """Return what is near the middle, and thin parts of it: the neck of a guitar, a mast."""
    inner, middle, reach = _near(sample)
    if not reach > 0.0 or len(inner.means) == len(sample.means):
        return inner
    parts = _parts(sample, middle, reach)
    if not parts.any():
        return inner
    return sample.only(parts | (np.linalg.norm(sample.means - middle, axis=1) <= reach))


def _near(sample: Sample) -> tuple[Sample, F64, float]:
    # Trim what is far from the middle, find the middle again, until nothing changes.
    inner, middle, reach = sample, np.zeros(3), 0.0
    for _ in range(16):
        if not len(inner.means):
            break
        middle = np.array([quantile(column, inner.weights, 0.5) for column in inner.means.T])
        reach = REACH * quantile(np.linalg.norm(inner.means - middle, axis=1), inner.weights, 0.5)
        kept = sample.only(np.linalg.norm(sample.means - middle, axis=1) <= reach)
        if len(kept.means) == len(inner.means):
            break
        inner = kept
    return inner, middle, reach


def _parts(sample: Sample, middle: F64, reach: float) -> Mask:
    """Mark what lies farther than the reach, hangs together with what does not, and is thin."""
    offsets = (sample.means - middle) / reach
    distances = np.linalg.norm(offsets, axis=1)
    # One cell more on every side is empty, so that nothing is taken for a neighbour across the grid.
    side = 2 * (int(FARTHEST * CELLS) + 1) + 1
    size_fits = sample.sizes <= reach / CELLS
    solid = (sample.opacities >= OPAQUE) & (distances <= FARTHEST) & size_fits
    x, y, z = (np.floor(offsets[solid] * CELLS).astype(np.int64) + side // 2).T
    grid = np.zeros((side, side, side), np.bool_)
    grid[x, y, z] = True
    reached = np.zeros(len(offsets), np.bool_)
    reached[solid] = _flooded(grid, (x, y, z), distances[solid] <= 1.0)[x, y, z]
    outside = reached & (distances > 1.0)
    if np.count_nonzero(outside) < FEWEST:
        return np.zeros(len(offsets), np.bool_)
    return _in_cones(offsets, distances, outside, sample.weights)


def _flooded(grid: Mask, places: tuple[npt.NDArray[np.int64], ...], first: Mask) -> Mask:
    """Return the filled cells that can be reached from those of the first places through filled cells."""
    flooded = np.zeros_like(grid)
    flooded[tuple(each[first] for each in places)] = True
    count = 0
    while (now := int(np.count_nonzero(flooded))) != count:
        count = now
        wider = flooded
        for axis in range(3):
            wider = wider | np.roll(wider, 1, axis) | np.roll(wider, -1, axis)
        flooded = wider & grid
    return flooded


def _in_cones(offsets: F64, distances: F64, outside: Mask, weights: F64) -> Mask:
    """Mark what lies in a few cones about the farthest; nothing where too much lies beside them."""
    directions = offsets / np.maximum(distances, 1e-30)[:, None]
    found, left = np.zeros(len(offsets), np.bool_), outside.copy()
    for _ in range(PARTS):
        if not left.any():
            break
        tip = directions[np.argmax(np.where(left, distances, -1.0))]
        cone = left & (directions @ tip > CONE)
        found, left = found | cone, left & ~cone
    thin = weights[found].sum() >= THIN * weights[outside].sum()
    return found if thin else np.zeros(len(offsets), np.bool_)
