"""Which blocks to draw: a budget of splats is spent where coarser ones show most on screen.

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
from tsplat.raster.train_depths import train_depths_of
from tsplat.rendering import RenderOptions

F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]

FULLY_SEEN = np.float32(2.0)
"""Pixels. What changes among smaller splats is blurred by the pixels, with the fourth power of the size."""

KEPT_APART = 1.3
"""How much more a node counts that was taken apart in the last frame: nothing flickers between two levels."""

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
        nodes = len(tree.splats)
        self._tree = tree
        self._filled = (tree.splats / np.maximum(np.diff(tree.blocks), 1)).astype(np.float32)
        self._apart = np.zeros(nodes, np.uint8)
        self._queue = np.empty(nodes + 2, np.uint64)
        self._nodes = np.empty(nodes, np.int32)
        self._chosen = np.empty(int(tree.blocks[-1]), np.int32)
        self._light = np.empty(nodes, np.float32)
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
            About so many splats in sight, though never less than one block, nor less than the coarsest nodes.

        Raises
        ------
        CorruptFileError
            They lie in a file that changed.
        """
        tree = self._tree
        tree.check()
        with tree.scene.lock:  # what is being read may join the tree at any other time
            job = _Job(
                roots=tree.roots,
                children=tree.children,
                blocks=tree.blocks,
                filled=self._filled,
                block_bounds=tree.scene.bounds,
                bounds=self._reach(options),
                sizes=tree.sizes,
                errors=tree.errors,
                solidities=tree.solidities,
                numbers=camera_numbers(camera, options),
                focal=math.sqrt(float(camera.K[0, 0] * camera.K[1, 1])),
                most=max(BLOCK, budget),
                apart=self._apart,
                queue=self._queue,
                nodes=self._nodes,
                light=self._light,
                remaining=self._remaining,
            )
            return np.sort(self._chosen[: _choose(job, self._chosen)])

    def _reach(self, options: RenderOptions) -> F32:
        """Return the bounds of the nodes, grown where splats that are near gain blur."""
        tree = self._tree
        known = train_depths_of(tree.scene, options)
        return known.widened(tree.bounds, options) if known else tree.bounds


class _Job(NamedTuple):
    """What `_choose` works on.

    Of each node, ``filled`` is how many splats its blocks have on average; ``apart`` marks those that were taken
    apart when they were last in sight; ``nodes`` are those that are chosen, and those that wait, behind them.
    `fill_light` fills ``light`` and ``remaining``; ``queue`` has room for every node.
    """

    roots: I32
    children: I32
    blocks: I32
    filled: F32
    block_bounds: F32
    bounds: F32
    sizes: F32
    errors: F32
    solidities: F32
    numbers: F32
    focal: float
    most: int
    apart: npt.NDArray[np.uint8]
    queue: npt.NDArray[np.uint64]
    nodes: I32
    light: F32
    remaining: F32


@kernel
def _choose(job, chosen):
    """Fill ``chosen`` and return how many blocks it is; the nodes that lose most are taken apart first.

    First as if none hid another; then it is seen which do, for what is hidden loses little.
    """
    waiting, spent = 0, np.float32(0.0)
    for number in range(len(job.roots)):
        root = np.int64(job.roots[number])
        job.light[root] = np.float32(1.0)
        if in_sight(root, job.numbers, job.bounds):
            waiting = push(job.queue, waiting, _key(root, job))
            spent += _splats_in_sight(root, job)
    count, waiting, spent = _spend(job, AS_IF_SEEN * job.most, 0, waiting, spent)
    for i in range(waiting):
        job.nodes[count + i] = block_of(job.queue[i])
    fill_light(job.nodes, count + waiting, job)
    for i in range(waiting):
        push(job.queue, i, _key(np.int64(job.nodes[count + i]), job))
    count, _, _ = _spend(job, np.inf, count, waiting, spent)
    return _fill_blocks(job, count, chosen)


@part
def _spend(job, until, count, waiting, spent):
    """Take nodes apart until so many are spent or none waits; return how many are chosen, wait, and are spent.

    Of a node half out of sight, half counts.
    """
    while waiting > 0 and spent < until:
        node = block_of(job.queue[0])
        waiting = drop_first(job.queue, waiting)
        child, last = np.int64(job.children[node, 0]), np.int64(job.children[node, 1])
        after = spent - _splats_in_sight(node, job)
        for other in range(child, last):
            if in_sight(other, job.numbers, job.bounds):
                after += _splats_in_sight(other, job)
        if child == last or (after > spent and after > job.most):
            job.nodes[count], job.apart[node] = node, 0
            count += 1
            continue
        job.apart[node], spent = 1, after
        for other in range(child, last):
            job.light[other] = job.light[node]
            if in_sight(other, job.numbers, job.bounds):
                waiting = push(job.queue, waiting, _key(other, job))
    return count, waiting, spent


@part
def _fill_blocks(job, count, chosen):
    blocks = 0
    for i in range(count):
        node = np.int64(job.nodes[i])
        for block in range(job.blocks[node], job.blocks[node + 1]):
            chosen[blocks] = block
            blocks += 1
    return blocks


@part
def _splats_in_sight(node, job):
    """Return about how many splats of a node are in the image, block by block: it may be half of the scene."""
    shares = np.float32(0.0)
    for block in range(job.blocks[node], job.blocks[node + 1]):
        shares += share_in_sight(block, job.numbers, job.block_bounds)
    return shares * job.filled[node]


@part
def _key(node, job):
    """Return what a picture loses by a node not taken apart, and the node, for the queue."""
    at = node * BOUNDS
    squared = np.float32(0.0)
    for axis in range(3):
        squared += (job.bounds[at + axis] - job.numbers[28 + axis]) ** 2
    distance = max(math.sqrt(squared) - job.bounds[at + 3], job.numbers[22])
    scale = np.float32(job.focal) / distance
    share = min(np.float32(1.0), scale * job.sizes[node] / FULLY_SEEN)
    seen = job.light[node] * job.errors[node] * scale * scale * share**4
    if job.apart[node]:
        seen *= np.float32(KEPT_APART)
    return key_of(seen, node)
