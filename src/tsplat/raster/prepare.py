"""Once per scene: everything that no camera changes, laid out for the kernels, and the buffers they fill.

Splats are projected thousands of times but prepared once, so the 3D covariance is worked out here.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass, field
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from tsplat._jit import claim, kernel
from tsplat.raster import record
from tsplat.raster.workers import on_threads
from tsplat.scene import Gaussians

F32 = npt.NDArray[np.float32]

BLOCK = 512
"""Splats projected at a time: their intermediate results stay in the first-level cache."""


@dataclass(eq=False, slots=True)
class Prepared:
    """A scene ready to be drawn, with the buffers of its last frame.

    Attributes
    ----------
    means : ndarray of float32, [3, N]
        Centres by coordinate.
    covars : ndarray of float32, [6, N]
        Upper triangles of the 3D covariances: xx, xy, xz, yy, yz, zz.
    log2_opacities : ndarray of float32, [N]
        Base-2 logarithms of the opacities; -126 for none at all.
    records : ndarray of float32, [N, 16]
        One row for each visible splat; a block's rows start where its splats start.
    ids : ndarray of int32, [N]
        Splat of each record: source_from_record.
    tiles : ndarray of uint16, [N, 4]
        First and last tile column and row of each record: left, top, right, bottom.
    visible : ndarray of int32, [blocks]
        Records of each block.
    isect_keys : ndarray of uint64, [>= pairs]
        Grown on demand: depth and record of each pair of a tile and a splat, by tile.
    lock : Lock
        Held while a frame uses the buffers.
    """

    means: F32
    covars: F32
    log2_opacities: F32
    records: F32
    ids: npt.NDArray[np.int32]
    tiles: npt.NDArray[np.uint16]
    visible: npt.NDArray[np.int32]
    isect_keys: npt.NDArray[np.uint64]
    lock: threading.Lock = field(default_factory=threading.Lock)

    def room_for(self, pairs: int) -> npt.NDArray[np.uint64]:
        """Return ``isect_keys`` with room for this many pairs; it grows by half, and never shrinks."""
        if pairs > len(self.isect_keys):
            self.isect_keys = np.empty(pairs + pairs // 2, np.uint64)
        return self.isect_keys


_prepared: WeakKeyDictionary[Gaussians, Prepared] = WeakKeyDictionary()
_prepared_lock = threading.Lock()


def prepared(gaussians: Gaussians, threads: int) -> Prepared:
    """Return what was prepared for this scene; it is made once and goes with the scene."""
    with _prepared_lock:
        found = _prepared.get(gaussians)
        if found is None:
            found = _prepared[gaussians] = _prepare(gaussians, threads)
        return found


def _prepare(gaussians: Gaussians, threads: int) -> Prepared:
    n = len(gaussians)
    scene = Prepared(
        means=np.empty((3, n), np.float32),
        covars=np.empty((6, n), np.float32),
        log2_opacities=np.empty(n, np.float32),
        records=np.empty((n, record.LENGTH), np.float32),
        ids=np.empty(n, np.int32),
        tiles=np.empty((n, 4), np.uint16),
        visible=np.empty(-(-n // BLOCK), np.int32),
        isect_keys=np.empty(0, np.uint64),
    )
    on_threads(threads, _prepare_blocks, np.zeros(1, np.int64), gaussians.means, gaussians.quats, gaussians.scales,
               gaussians.opacities, scene.means, scene.covars, scene.log2_opacities, scene.records)  # fmt: skip
    return scene


@kernel
def _prepare_blocks(worker, counter, means, quats, scales, opacities, out_means, covars, log2_opacities, records):
    n = len(means)
    while True:
        start = claim(counter) * BLOCK
        if start >= n:
            return
        # The first touch of a page costs more than what is computed for it: better now than in a frame.
        records[start : start + BLOCK] = np.float32(0.0)
        for i in range(start, min(start + BLOCK, n)):
            for axis in range(3):
                out_means[axis, i] = means[i, axis]
            log2_opacities[i] = math.log2(max(opacities[i], np.float32(1e-38)))
            w, x, y, z = quats[i, 0], quats[i, 1], quats[i, 2], quats[i, 3]
            sx, sy, sz = scales[i, 0], scales[i, 1], scales[i, 2]
            one, two = np.float32(1), np.float32(2)
            xx, xy, xz = (one - two * (y * y + z * z)) * sx, two * (x * y - w * z) * sy, two * (x * z + w * y) * sz
            yx, yy, yz = two * (x * y + w * z) * sx, (one - two * (x * x + z * z)) * sy, two * (y * z - w * x) * sz
            zx, zy, zz = two * (x * z - w * y) * sx, two * (y * z + w * x) * sy, (one - two * (x * x + y * y)) * sz
            covars[0, i] = xx * xx + xy * xy + xz * xz
            covars[1, i] = xx * yx + xy * yy + xz * yz
            covars[2, i] = xx * zx + xy * zy + xz * zz
            covars[3, i] = yx * yx + yy * yy + yz * yz
            covars[4, i] = yx * zx + yy * zy + yz * zz
            covars[5, i] = zx * zx + zy * zy + zz * zz
