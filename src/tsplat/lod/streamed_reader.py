"""The hierarchy of a streamed SOG, made file by file: those with the coarsest levels first."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from tsplat import locks
from tsplat.framing import SAMPLE
from tsplat.io.arrays import Arrays
from tsplat.io.sog_levels import Levels
from tsplat.lod.hierarchy import Hierarchy
from tsplat.lod.occlusion import solidity_of
from tsplat.lod.runs import lost, pack_runs, summarize
from tsplat.raster.prepare import BLOCK, BOUNDS, empty
from tsplat.scene import Gaussians

F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]

NONE = -1
"""No node."""

LEAST_MORE = 1.0 / BLOCK
"""Blocks. Levels that have no more splats than the coarser one come first: they cost nothing."""


class Reader:
    """Reads a streamed scene into a tree whose nodes are its runs, numbered as in `Levels`.

    Parameters
    ----------
    levels : Levels
        The scene.

    Attributes
    ----------
    tree : Hierarchy
        Its nodes get their children when these are read.
    splats : int
        On the finest level of all leaves.
    left : list of int
        Files to be read, the next one last.
    lock : Lock
        Held while one is.
    """

    def __init__(self, levels: Levels) -> None:
        counts = np.concatenate(levels.counts)
        self._levels, self.lock = levels, locks.lock()
        self._firsts = np.cumsum([0, *map(len, levels.counts)])
        self._finer, self._coarser = np.full((2, len(counts)), NONE, np.int32)
        below = np.zeros(len(counts), np.int64)
        for leaf in levels.leaves:
            self._finer[leaf[:-1]], self._coarser[leaf[1:]] = leaf[1:], leaf[:-1]
            below[leaf] = np.arange(len(leaf))
        self._below = np.minimum.reduceat(below, self._firsts[:-1])
        self.left = np.argsort(-self._below, kind="stable").tolist()
        self._boxes = np.empty((len(counts), 6), np.float32)
        self._boxes[:, :3], self._boxes[:, 3:] = np.inf, -np.inf
        self._masses = np.full((len(counts), 2), np.nan)
        self._samples: list[Arrays] = []
        self.splats = int(counts[self._finer == NONE].sum())
        self.tree = _skeleton(levels, counts, self._finer == NONE)

    @property
    def has_roots(self) -> bool:
        """Whether the coarsest level of every leaf was read."""
        return not self.left or bool(self._below[self.left[-1]])

    def read_next(self, threads: int, progress: Callable[[float], None], *, warn: bool) -> None:
        """Read a file; ``warn`` of splats that were left out."""
        number = self.left[-1]
        splats, ends = self._levels.read(number, progress, warn=warn)
        nodes = np.arange(self._firsts[number], self._firsts[number + 1])
        pack_runs(splats, ends, self.tree.blocks[nodes[0] : nodes[-1] + 2], self.tree.scene.target(), threads)
        self._sample(splats, ends, nodes)
        self._publish(splats, ends, nodes)
        self.left.pop()

    def sample(self) -> Gaussians:
        """Return some splats of the coarsest levels, without harmonics; see `Stored`."""
        samples, self._samples = self._samples, []
        means, quats, scales, opacities, sh = (np.concatenate(arrays) for arrays in zip(*samples, strict=True))
        return Gaussians(means, quats, scales, opacities, sh)

    def _sample(self, splats: Arrays, ends: I64, nodes: I32) -> None:
        roots = np.flatnonzero(self._coarser[nodes] == NONE)
        rows = np.concatenate([np.arange(0), *(np.arange(ends[run], ends[run + 1]) for run in roots)])
        means, quats, scales, opacities, sh = splats
        step = 1 + int(self.tree.splats[self.tree.roots].sum()) // SAMPLE
        chosen = rows[::step]
        self._samples.append(Arrays(*(array[chosen] for array in (means, quats, scales, opacities, sh[:, :1]))))

    def _publish(self, splats: Arrays, ends: I64, nodes: I32) -> None:
        """Let frames draw what was packed."""
        summary, tree = summarize(splats, ends), self.tree
        with tree.scene.lock, np.errstate(over="ignore", invalid="ignore"):  # of sizes that no trained scene has
            tree.sizes[nodes], self._masses[nodes] = summary.sizes, summary.masses
            self._widen(nodes, summary.boxes, summary.largest)
            radii = tree.bounds.reshape(-1, BOUNDS)[nodes, 3]
            tree.solidities[nodes] = list(map(solidity_of, summary.masses[:, 0], radii))
            if tree.scene.train_depths:
                tree.scene.train_depths.forget_bounds()
            for coarse in (nodes, self._coarser[nodes]):
                self._connect(coarse[coarse != NONE])

    def _widen(self, nodes: I32, boxes: F32, largest: F32) -> None:
        """Make the bounds of nodes, and of all that stand for them, hold these."""
        bounds = self.tree.bounds.reshape(-1, BOUNDS)
        while len(nodes):
            low, high = self._boxes[nodes, :3], self._boxes[nodes, 3:]
            low, high = np.minimum(low, boxes[:, :3]), np.maximum(high, boxes[:, 3:])
            self._boxes[nodes, :3], self._boxes[nodes, 3:] = low, high
            some = low[:, 0] <= high[:, 0]
            half = 0.5 * (high - low)
            bounds[nodes[some], :3] = (low + half)[some]
            bounds[nodes[some], 3] = np.sqrt((half**2).sum(axis=1))[some]
            bounds[nodes, 4] = np.maximum(bounds[nodes, 4], largest)
            coarser = self._coarser[nodes]
            up = coarser != NONE
            nodes, boxes, largest = coarser[up], boxes[up], largest[up]

    def _connect(self, nodes: I32) -> None:
        """Give nodes their children where these and they were read."""
        finer = self._finer[nodes]
        read = (finer != NONE) & ~np.isnan(self._masses[nodes, 0]) & ~np.isnan(self._masses[finer, 0])
        nodes, finer, tree = nodes[read], finer[read], self.tree
        more = (tree.splats[finer] - tree.splats[nodes]) / BLOCK
        tree.errors[nodes] = lost(self._masses[nodes], self._masses[finer]) / np.maximum(more, LEAST_MORE)
        tree.children[nodes, 0], tree.children[nodes, 1] = finer, finer + 1


def _skeleton(levels: Levels, counts: I64, finest: npt.NDArray[np.bool_]) -> Hierarchy:
    """Return a tree with room for all splats, of which no node has children yet."""
    nodes = len(counts)
    ends = np.cumsum([0, *-(-counts // BLOCK)])
    scene, blocks = empty(int(ends[-1]), levels.coefficients - 1), ends.astype(np.int32)
    return Hierarchy(
        scene=scene,
        finest=scene.blocks[np.repeat(finest, np.diff(blocks))],
        roots=np.array([leaf[0] for leaf in levels.leaves], np.int32),
        children=np.zeros((nodes, 2), np.int32),
        blocks=blocks,
        splats=counts.astype(np.float32),
        bounds=np.zeros(nodes * BOUNDS, np.float32),
        sizes=np.zeros(nodes, np.float32),
        errors=np.zeros(nodes, np.float32),
        solidities=np.zeros(nodes, np.float32),
    )
