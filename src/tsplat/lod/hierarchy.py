"""All levels of detail of a scene, ready to be drawn: a tree of nodes, each in place of finer ones."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from tsplat import locks
from tsplat._jit import kernel, part
from tsplat._threads import FIRST_FREE, claim, new_team
from tsplat.given import whole
from tsplat.lod.kd import Order, kd_order
from tsplat.lod.levels import Level, coarser, finest
from tsplat.lod.merge_scratch import area
from tsplat.lod.occlusion import solidity_of
from tsplat.raster.prepare import BLOCK, BOUNDS, Prepared, Target, empty, pack_block
from tsplat.raster.workers import on_threads
from tsplat.scene import Gaussians, a_scene

F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]

ORDER_SHARE = 0.15
"""Of the time that building takes, what passes before the first level is there."""


@dataclass(eq=False, slots=True)
class Hierarchy:
    """A tree of which every node is a run of blocks of splats that stand for those of its children.

    Attributes
    ----------
    scene : Prepared
        The blocks of all levels.
    finest : ndarray of int32, [F]
        The blocks that are the scene itself, in its order.
    roots : ndarray of int32, [R]
        Nodes that are nobody's children; together they stand for the whole scene.
    children : ndarray of int32, [nodes, 2]
        The first child of each node, and the one after the last; the same for none.
    blocks : ndarray of int32, [nodes + 1]
        The first block of each node, and how many blocks there are.
    splats : ndarray of float32, [nodes]
        How many splats each node counts for.
    bounds : ndarray of float32, [nodes * 5]
        As in `Prepared`, of each node and all that it stands for.
    sizes : ndarray of float32, [nodes]
        Typical size of a node's splats: the root of the area of one, in world units.
    errors : ndarray of float32, [nodes]
        What a picture loses by a node in place of its children, for each block that these are more: squared
        opacity times square world units.
    solidities : ndarray of float32, [nodes]
        How much light a node takes away from what is behind it, 0 to 1, see `tsplat.lod.occlusion`.
    check : callable
        To be called before any of it is looked at: raises `CorruptFileError` where it lies in a file that changed.
    """

    scene: Prepared
    finest: I32
    roots: I32
    children: I32
    blocks: I32
    splats: F32
    bounds: F32
    sizes: F32
    errors: F32
    solidities: F32
    check: Callable[[], None] = lambda: None


_hierarchies: WeakKeyDictionary[Gaussians, Hierarchy] = WeakKeyDictionary()
_lock = locks.lock()


def hierarchy(
    gaussians: Gaussians,
    threads: int,
    progress: Callable[[float], None] | None = None,
    earlier: Hierarchy | None = None,
) -> Hierarchy:
    """Return the hierarchy of a scene; it is built once and goes with the scene.

    Parameters
    ----------
    gaussians : Gaussians
        Any scene with at least one splat.
    threads : int
        How many build it.
    progress : callable, optional
        Called with the fraction done.
    earlier : Hierarchy, optional
        Of the same scene, to be taken in place of building one.
    """
    a_scene(gaussians)
    threads = whole("threads", threads, 1, 1024)
    with _lock:
        found = _hierarchies.get(gaussians)
        if found is None:
            found = earlier or build(gaussians, threads, progress or (lambda _: None))
            _hierarchies[gaussians] = found
        return found


def build(
    gaussians: Gaussians, threads: int, progress: Callable[[float], None], order: Order | None = None
) -> Hierarchy:
    """Build the hierarchy of a scene, see `hierarchy`; ``order`` is its `kd_order` where that is known."""
    firsts = level_firsts(len(gaussians))
    blocks = int(firsts[-1])
    scene = empty(blocks, gaussians.sh.shape[1] - 1)
    tree = binary_tree(firsts, scene, *np.empty((3, blocks), np.float32))
    boxes = np.empty((blocks, 6), np.float32)
    order = kd_order(gaussians.means, threads) if order is None else order
    level = finest(gaussians, order, threads)
    for number, first in enumerate(firsts[:-1]):
        team = new_team(1)
        children = firsts[number - 1] if number else -1
        eights = np.empty((threads, 8), np.float32)
        job = _PackJob(
            team, eights, level, int(first), int(children), tree.scene.target(), tree.sizes, tree.errors,
            tree.solidities, boxes,
        )  # fmt: skip
        on_threads(threads, team, _pack.on(job))
        # Half of what is left to merge is merged on each level.
        progress(1.0 - (1.0 - ORDER_SHARE) * 0.5**number)
        if number < len(firsts) - 2:
            level = coarser(level, threads)
    progress(1.0)
    return tree


def level_firsts(splats: int) -> I64:
    """Return the first block of each level of a scene with so many splats, and how many blocks there are."""
    counts = [-(-splats // BLOCK)]
    while counts[-1] > 1:
        counts.append(-(-counts[-1] // 2))
    return np.cumsum([0, *counts])


def binary_tree(firsts: I64, scene: Prepared, sizes: F32, errors: F32, solidities: F32) -> Hierarchy:
    """Return the tree whose nodes are blocks: block j of a level stands for 2 j and 2 j + 1 of the finer one.

    Parameters
    ----------
    firsts : ndarray of int64, [levels + 1]
        See `level_firsts`.
    scene : Prepared
        The blocks, the finest level first. The bounds of each are or become those of what it stands for, too.
    sizes, errors, solidities : ndarray of float32, [blocks]
        As in `Hierarchy`.
    """
    blocks = int(firsts[-1])
    children = np.zeros((blocks, 2), np.int32)
    for finer, first, last in zip(firsts, firsts[1:], firsts[2:], strict=False):
        children[first:last, 0] = np.arange(finer, first, 2)
        children[first:last, 1] = np.minimum(children[first:last, 0] + 2, first)
    return Hierarchy(
        scene=scene,
        finest=scene.blocks[: firsts[1]],
        roots=scene.blocks[-1:],
        children=children,
        blocks=np.arange(blocks + 1, dtype=np.int32),
        splats=np.full(blocks, BLOCK, np.float32),
        bounds=scene.bounds,
        sizes=sizes,
        errors=errors,
        solidities=solidities,
    )


class _PackJob(NamedTuple):
    """``first`` and ``children`` are the first block of this level and of the one before, which is -1 for none.

    ``eights`` is room for as many numbers of each worker.
    """

    team: I64
    eights: F32
    level: Level
    first: int
    children: int
    target: Target
    sizes: F32
    errors: F32
    solidities: F32
    boxes: F32


@kernel
def _pack(worker, job):
    level, target = job.level, job.target
    n, padded = len(level.means), len(target.log2_opacities)
    eight = job.eights[worker]
    while True:
        number = claim(job.team, FIRST_FREE)
        start = number * BLOCK
        if start >= n:
            return
        end, block = min(start + BLOCK, n), job.first + number
        widest = np.float32(0.0)
        for i in range(start, end):
            for entry in range(6):
                target.covars[entry * padded + block * BLOCK + i - start] = level.covars[i, entry]
            # The sum of all variances is more than that along any axis.
            widest = max(widest, level.covars[i, 0] + level.covars[i, 3] + level.covars[i, 5])
        pack_block(block, level.means, level.opacities, level.sh, start, end, math.sqrt(widest), eight, target)
        job.errors[block] = level.errors[number]
        mass, job.sizes[block] = _mass_and_size(level, start, end)
        _fill_box(level.means, start, end, job.boxes[block])
        if job.children >= 0:
            child = job.children + 2 * number
            last = min(child + 2, job.first)
            _widen(child, last, job.boxes, block, target.bounds)
        job.solidities[block] = solidity_of(mass, target.bounds[block * BOUNDS + 3])


@part
def _mass_and_size(level, start, end):
    """Return all opacity times area of some splats, and the typical size of one."""
    whole, weighted = np.float32(0.0), np.float32(0.0)
    for i in range(start, end):
        size = area(level.covars, i)
        whole += level.opacities[i] * size
        weighted += level.opacities[i] * size * size
    return whole, math.sqrt(weighted / max(whole, np.float32(1e-30)))


@part
def _fill_box(means, start, end, box):
    for axis in range(3):
        box[axis] = box[3 + axis] = means[start, axis]
        for i in range(start + 1, end):
            box[axis], box[3 + axis] = min(box[axis], means[i, axis]), max(box[3 + axis], means[i, axis])


@part
def _widen(child, last, boxes, block, bounds):
    """Make the box and the bounds of a block hold those of its children; merged centres lie between theirs."""
    distance2, at = np.float32(0.0), block * BOUNDS
    for axis in range(3):
        low, high = boxes[child, axis], boxes[child, 3 + axis]
        for other in range(child + 1, last):
            low, high = min(low, boxes[other, axis]), max(high, boxes[other, 3 + axis])
        boxes[block, axis], boxes[block, 3 + axis] = low, high
        half = np.float32(0.5) * (high - low)
        bounds[at + axis] = low + half
        distance2 += half * half
    bounds[at + 3] = math.sqrt(distance2)
    for other in range(child, last):
        bounds[at + 4] = max(bounds[at + 4], bounds[other * BOUNDS + 4])
