"""Which blocks to draw: a budget of splats is spent where merging shows most on screen.

Source: Luebke and Erikson 1997, *View-dependent simplification of arbitrary polygonal environments*, for a
queue that spends a budget.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tsplat._jit import kernel, part
from tsplat.camera import Camera
from tsplat.lod.heap import block_of, drop_first, key_of, push
from tsplat.lod.hierarchy import Hierarchy
from tsplat.lod.occlusion import CELLS, fill_light
from tsplat.raster.frame import camera_numbers
from tsplat.raster.prepare import BLOCK, BOUNDS
from tsplat.raster.sight import in_sight, share_in_sight
from tsplat.rendering import RenderOptions

F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]

FULLY_SEEN = np.float32(2.0)
"""Pixels. What changes among smaller splats is blurred by the pixels, with the fourth power of the size."""

KEPT_APART = 1.3
"""How much more a block counts that was taken apart in the last frame: nothing flickers between two levels."""

AS_IF_SEEN = 0.5
"""Share of the budget that is spent as if no block hid another: large ones hardly tell what is before what."""


class Cut:
    """Chooses blocks for one viewer, frame after frame.

    Parameters
    ----------
    tree : Hierarchy
        What is looked at.
    """

    def __init__(self, tree: Hierarchy) -> None:
        blocks = int(tree.firsts[-1])
        self._tree = tree
        self._apart = np.zeros(blocks, np.uint8)
        self._queue = np.empty(blocks + 2, np.uint64)
        self._chosen = np.empty(blocks, np.int32)
        self._light = np.empty(blocks, np.float32)
        self._remaining = np.empty(CELLS * CELLS, np.float32)

    def blocks(self, camera: Camera, options: RenderOptions, budget: int) -> I32:
        """Return the blocks to draw, in order.

        Parameters
        ----------
        camera : Camera
            From where, and how large.
        options : RenderOptions
            How.
        budget : int
            About so many splats in sight, though never less than one block.
        """
        tree = self._tree
        most = max(1, budget // BLOCK)
        focal = math.sqrt(float(camera.K[0, 0] * camera.K[1, 1]))
        numbers = camera_numbers(camera, options)
        job = _Job(
            tree.firsts, tree.scene.bounds, tree.sizes, tree.errors, tree.solidities, numbers, focal, most,
            self._apart, self._queue, self._light, self._remaining,
        )  # fmt: skip
        return np.sort(self._chosen[: _choose(job, self._chosen)])


class _Job(NamedTuple):
    """What `_choose` works on.

    ``apart`` marks the blocks that were taken apart when they were last in sight. `fill_light` fills ``light`` and
    ``remaining``; ``queue`` has room for every block.
    """

    firsts: npt.NDArray[np.int64]
    bounds: F32
    sizes: F32
    errors: F32
    solidities: F32
    numbers: F32
    focal: float
    most: int
    apart: npt.NDArray[np.uint8]
    queue: npt.NDArray[np.uint64]
    light: F32
    remaining: F32


@kernel
def _choose(job, chosen):
    """Fill ``chosen`` and return how many blocks it is; those that lose most are taken apart first.

    First as if none hid another; then it is seen which do, for what is hidden loses little.
    """
    root = job.firsts[-1] - 1
    if not in_sight(root, job.numbers, job.bounds):
        return 0
    job.light[root] = np.float32(1.0)
    waiting = push(job.queue, 0, _key(root, job))
    spent = share_in_sight(root, job.numbers, job.bounds)
    count, waiting, spent = _spend(job, AS_IF_SEEN * job.most, chosen, 0, waiting, spent)
    for i in range(waiting):
        chosen[count + i] = block_of(job.queue[i])
    fill_light(chosen, count + waiting, job)
    for i in range(waiting):
        push(job.queue, i, _key(np.int64(chosen[count + i]), job))
    count, _, _ = _spend(job, np.inf, chosen, count, waiting, spent)
    return count


@part
def _spend(job, until, chosen, count, waiting, spent):
    """Take blocks apart until so many are spent or none waits; return how many are chosen, wait, and are spent.

    Of a block half out of sight, half counts.
    """
    while waiting > 0 and spent < until:
        block = block_of(job.queue[0])
        waiting = drop_first(job.queue, waiting)
        child, last = _children(block, job.firsts)
        after = spent - share_in_sight(block, job.numbers, job.bounds)
        for other in range(child, last):
            if in_sight(other, job.numbers, job.bounds):
                after += share_in_sight(other, job.numbers, job.bounds)
        if child == last or (after > spent and after > job.most):
            chosen[count], job.apart[block] = block, 0
            count += 1
            continue
        job.apart[block], spent = 1, after
        for other in range(child, last):
            job.light[other] = job.light[block]
            if in_sight(other, job.numbers, job.bounds):
                waiting = push(job.queue, waiting, _key(other, job))
    return count, waiting, spent


@part
def _key(block, job):
    """Return what a picture loses by a block not taken apart, and the block, for the queue."""
    at = block * BOUNDS
    squared = np.float32(0.0)
    for axis in range(3):
        squared += (job.bounds[at + axis] - job.numbers[28 + axis]) ** 2
    distance = max(math.sqrt(squared) - job.bounds[at + 3], job.numbers[22])
    scale = np.float32(job.focal) / distance
    share = min(np.float32(1.0), scale * job.sizes[block] / FULLY_SEEN)
    seen = job.light[block] * job.errors[block] * scale * scale * share**4
    if job.apart[block]:
        seen *= np.float32(KEPT_APART)
    return key_of(seen, block)


@part
def _children(block, firsts):
    """Return the first block that this one stands for, and the one after the last; the same for the finest."""
    level = 0
    while block >= firsts[level + 1]:
        level += 1
    if level == 0:
        return block, block
    child = firsts[level - 1] + 2 * (block - firsts[level])
    return child, min(child + 2, firsts[level])
