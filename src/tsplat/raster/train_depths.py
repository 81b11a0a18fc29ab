"""How near the training cameras came: to each splat, when it is first drawn, and at most within bounds.

A splat's depth follows from its centre and the views alone, so it is the same wherever the splat lies.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from tsplat._jit import part
from tsplat._lanes import fma, load, minimum, minus_abs, splat, store, where_above
from tsplat.raster.buffers import aligned
from tsplat.raster.prepare import BLOCK, BOUNDS, Prepared
from tsplat.rendering import FAR_PLANE, RenderOptions
from tsplat.train_views import NEAREST, NUMBERS, TrainViews

F32 = npt.NDArray[np.float32]

NOT_YET, UNSEEN = 0.0, -1.0
"""In place of a depth: nobody has asked for it yet; no camera had the splat in view."""

SPARE = 1e-3
"""Share of bounds and depths that is added to them, more than rounding can take away."""


class TrainDepths:
    """The depths of a scene's splats in the nearest training camera that had them in view.

    Parameters
    ----------
    views : TrainViews
        Of the training cameras.
    splats : int
        In all blocks of the scene.

    Attributes
    ----------
    depths : ndarray of float32, [splats]
        World units, or `NOT_YET` for all of a block, or `UNSEEN`; `project` fills those of blocks in sight.
    frusta : ndarray of float32, [C * 12]
        See `TrainViews`.
    """

    def __init__(self, views: TrainViews, splats: int) -> None:
        self.views = views
        self.depths: F32 = aligned(splats, np.float32, np.zeros)  # memory that is there once it is written to
        self.frusta = views.frusta.ravel()
        self._widened: dict[int, tuple[F32, float, F32]] = {}

    def widened(self, bounds: F32, options: RenderOptions) -> F32:
        """Return the bounds of blocks or nodes, the largest scale grown by the blur that near splats gain.

        ``bounds`` are as in `Prepared`; the result is kept until they change, see `forget_bounds`.
        """
        blur = math.sqrt(options.near_blur(1.0))  # in world units, for a depth of 1
        of, known, wide = self._widened.get(id(bounds), (None, 0.0, bounds))
        if of is None or known != blur:
            wide = bounds.copy()
            with np.errstate(over="ignore", invalid="ignore"):  # a file may hold anything
                wide[BOUNDS - 1 :: BOUNDS] += np.float32(blur) * deepest(bounds, self.views)
            self._widened[id(bounds)] = bounds, blur, wide
        return wide

    def forget_bounds(self) -> None:
        """Hear that bounds have changed."""
        self._widened.clear()


def train_depths_of(scene: Prepared, options: RenderOptions) -> TrainDepths | None:
    """Return what a scene keeps of the training cameras, of the last ones only; None where they change nothing."""
    views, found = options.train_views, scene.train_depths
    if views is None or options.near_blur(1.0) == 0.0:
        return None
    if found is None or found.views is not views:
        found = scene.train_depths = TrainDepths(views, len(scene.log2_opacities))
    return found


def deepest(bounds: F32, views: TrainViews) -> F32:
    """Return a depth that no splat exceeds in the nearest camera that has it in view, for each block or node.

    What is wholly in view of some cameras is no deeper than in any of them; else, than in those that see a part.
    """
    x, y, z, radius, _ = bounds.reshape(-1, BOUNDS).T.astype(np.float64)
    seen, whole = np.zeros(len(x)), np.full(len(x), np.inf)
    radius = (1.0 + SPARE) * radius
    for frustum in views.frusta.astype(np.float64):
        sideways, down, depth = (a * x + b * y + c * z + d for a, b, c, d in frustum)
        to_side, to_top, to_depth = np.linalg.norm(frustum[:, :3], axis=1)
        across, along = depth - np.abs(sideways), depth - np.abs(down)
        reach_x, reach_y = (to_side + to_depth) * radius, (to_top + to_depth) * radius
        farthest = depth + to_depth * radius
        part = (across > -reach_x) & (along > -reach_y) & (farthest > NEAREST)
        all_of_it = (across > reach_x) & (along > reach_y) & (depth - to_depth * radius > NEAREST)
        seen[part] = np.maximum(seen[part], farthest[part])
        whole[all_of_it] = np.minimum(whole[all_of_it], farthest[all_of_it])
    most: F32 = ((1.0 + SPARE) * np.minimum(seen, whole)).astype(np.float32)
    return most


@part
def fill_train_depths(start, means, frusta, depths):
    """Fill the depths of a block."""
    padded = len(means) // 3
    zero, far, nearest = splat(np.float32(0.0)), splat(np.float32(FAR_PLANE)), splat(np.float32(NEAREST))
    for first in range(start, start + BLOCK, 8):
        x, y, z = load(means, first), load(means, padded + first), load(means, 2 * padded + first)
        found = far
        for at in range(0, len(frusta), NUMBERS):
            depth = _row(x, y, z, frusta, at + 8)
            inside = minimum(
                depth + minus_abs(_row(x, y, z, frusta, at)), depth + minus_abs(_row(x, y, z, frusta, at + 4))
            )
            found = minimum(where_above(minimum(inside, depth - nearest), zero, depth, far), found)
        store(depths, first, where_above(far, found, found, splat(np.float32(UNSEEN))))


@part
def _row(x, y, z, frusta, at):
    last = fma(z, splat(frusta[at + 2]), splat(frusta[at + 3]))
    return fma(x, splat(frusta[at]), fma(y, splat(frusta[at + 1]), last))
