"""Once per scene: everything that no camera changes, laid out for the kernels, and the buffers they fill.

Splats are projected thousands of times but prepared once, so the 3D covariance is worked out here.
Every quantity lies in an array of its own, padded to whole blocks with splats that are never seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from threading import RLock
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from tsplat import locks
from tsplat._arguments import Known
from tsplat._jit import kernel, part
from tsplat._lanes import load, maximum, minimum, splat
from tsplat._moves import store_half
from tsplat._threads import FIRST_FREE, claim, new_team
from tsplat.raster.buffers import Buffers, aligned
from tsplat.raster.workers import on_threads
from tsplat.scene import SH_C0, SH_COEFFICIENTS, Gaussians

if TYPE_CHECKING:
    from tsplat.raster.train_depths import TrainDepths

F32 = npt.NDArray[np.float32]

BLOCK = 256
"""Splats projected at a time: their intermediate results stay in the first-level cache."""

BOUNDS = 5
"""Numbers that say where the splats of a block are, see `Prepared`."""


MOST_BLOCKS = (1 << 31) - 1
"""What their numbers, of 32 bits, can count."""

HALF_MAX = 65504.0
"""The largest half-precision number; no trained harmonic or colour comes near it."""

INVISIBLE = -1000.0
"""Base-2 logarithm of the opacity of a padding splat: no alpha_min is so small."""


class Target(NamedTuple):
    """What is filled once for a scene, see `Prepared`."""

    means: F32
    covars: F32
    log2_opacities: F32
    base_colors: F32
    sh_rest: npt.NDArray[np.uint16]
    bounds: F32


@dataclass(eq=False, slots=True)
class Prepared:
    """A scene ready to be drawn, with the buffers of its last frame.

    P is the number of splats, padded to whole blocks.

    Attributes
    ----------
    means : ndarray of float32, [3 * P]
        Centres: all x, then all y, then all z.
    covars : ndarray of float32, [6 * P]
        Upper triangles of the 3D covariances: all xx, then xy, xz, yy, yz, zz.
    log2_opacities : ndarray of float32, [P]
        Base-2 logarithms of the opacities; -126 for none at all.
    base_colors : ndarray of float32, [3 * P]
        Red, green, blue without those harmonics that depend on the direction.
    sh_rest : ndarray of uint16, [P / 8 * coefficients * 24]
        Half-precision harmonics above the constant one: by eight splats, coefficient, channel, splat.
    coefficients : int
        How many of these there are: 0, 3, 8, 15 or 24.
    bounds : ndarray of float32, [blocks * 5]
        Of each block: the middle of its centres, how far any is from there, and the largest scale of a splat.
    blocks : ndarray of int32, [blocks]
        All of them, in order.
    quats, scales : ndarray of float32, [4 * N] and [3 * N]
        Those of the first N splats, from which needles are shaped; none of merged ones.
    buffers : Buffers
        What grows with the image and with the blocks drawn.
    last_size, last_frame, last_known
        What the last frame shares with the next one of its size, and what kernels know of that; see
        `frame.new_frame`.
    train_depths : TrainDepths, optional
        How near training cameras came to the splats, once that was asked for; see `train_depths_of`.
    lock : Lock
        Held while a frame uses the buffers.
    """

    means: F32
    covars: F32
    log2_opacities: F32
    base_colors: F32
    sh_rest: npt.NDArray[np.uint16]
    coefficients: int
    bounds: F32
    blocks: npt.NDArray[np.int32]
    quats: F32 = field(default_factory=lambda: np.empty(0, np.float32))
    scales: F32 = field(default_factory=lambda: np.empty(0, np.float32))
    buffers: Buffers = field(default_factory=Buffers)
    last_size: tuple[int, ...] = ()
    last_frame: Any = None
    last_known: Known | None = None
    train_depths: TrainDepths | None = None
    lock: RLock = field(default_factory=locks.lock)

    def target(self) -> Target:
        """Return the arrays that are filled once, for kernels."""
        return Target(self.means, self.covars, self.log2_opacities, self.base_colors, self.sh_rest, self.bounds)

    def coefficients_used(self, sh_degree: int) -> int:
        """Return how many harmonics above the constant one a frame of this degree takes: 0, 3, 8, 15 or 24."""
        return min(SH_COEFFICIENTS[sh_degree] - 1, self.coefficients)


_prepared: WeakKeyDictionary[Gaussians, Prepared] = WeakKeyDictionary()
_prepared_lock = locks.lock()


def prepared(gaussians: Gaussians, threads: int) -> Prepared:
    """Return what was prepared for this scene; it is made once and goes with the scene."""
    with _prepared_lock:
        found = _prepared.get(gaussians)
        if found is None:
            found = _prepared[gaussians] = _prepare(gaussians, threads)
        return found


def _prepare(gaussians: Gaussians, threads: int) -> Prepared:
    scene = empty(-(-len(gaussians) // BLOCK), gaussians.sh.shape[1] - 1)
    team = new_team(1)
    job = _Job(team, np.empty((threads, 8), np.float32), *gaussians.arrays, scene.target())
    on_threads(threads, team, _prepare_blocks.on(job))
    scene.quats, scene.scales = gaussians.quats.reshape(-1), gaussians.scales.reshape(-1)
    return scene


def empty(blocks: int, coefficients: int) -> Prepared:
    """Return room for so many blocks of splats with so many harmonics above the constant one.

    Raises
    ------
    MemoryError
        There is none, or blocks are more than 32 bits count.
    """
    padded = blocks * BLOCK
    if blocks > MOST_BLOCKS:
        raise MemoryError(f"for {padded:,} splats")
    return Prepared(
        means=aligned(3 * padded, np.float32),
        covars=aligned(6 * padded, np.float32),
        log2_opacities=aligned(padded, np.float32),
        base_colors=aligned(3 * padded, np.float32),
        sh_rest=aligned(padded * coefficients * 3, np.uint16),
        coefficients=coefficients,
        bounds=aligned(blocks * BOUNDS, np.float32),
        blocks=np.arange(blocks, dtype=np.int32),
    )


class _Job(NamedTuple):
    """What `_prepare_blocks` reads and fills; ``eights`` is room for as many numbers of each worker."""

    team: npt.NDArray[np.int64]
    eights: F32
    means: F32
    quats: F32
    scales: F32
    opacities: F32
    sh: F32
    target: Target


@kernel
def _prepare_blocks(worker, job):
    n, target = len(job.means), job.target
    padded = len(target.log2_opacities)
    eight = job.eights[worker]
    while True:
        start = claim(job.team, FIRST_FREE) * BLOCK
        if start >= padded:
            return
        end = min(start + BLOCK, n)
        largest = np.float32(0.0)
        for i in range(start, end):
            covariance_of(job.quats, job.scales, i, target.covars, i, padded)
            for axis in range(3):
                largest = max(largest, job.scales[i, axis])
        pack_block(start // BLOCK, job.means, job.opacities, job.sh, start, end, largest, eight, target)


@part
def covariance_of(quats, scales, i, covars, at, stride):
    """Write the upper triangle of a splat's covariance to ``covars[at]`` and every ``stride`` after it."""
    xx, xy, xz, yy, yz, zz = covariance(
        quats[i, 0], quats[i, 1], quats[i, 2], quats[i, 3], scales[i, 0], scales[i, 1], scales[i, 2]
    )
    covars[at], covars[stride + at], covars[2 * stride + at] = xx, xy, xz
    covars[3 * stride + at], covars[4 * stride + at], covars[5 * stride + at] = yy, yz, zz


@part
def covariance(w, x, y, z, sx, sy, sz):
    """Return the upper triangle of a covariance in float64: float32 leaves few digits of a needle's thin sides."""
    w, x, y, z = np.float64(w), np.float64(x), np.float64(y), np.float64(z)
    xx, xy, xz = (1.0 - 2.0 * (y * y + z * z)) * sx, 2.0 * (x * y - w * z) * sy, 2.0 * (x * z + w * y) * sz
    yx, yy, yz = 2.0 * (x * y + w * z) * sx, (1.0 - 2.0 * (x * x + z * z)) * sy, 2.0 * (y * z - w * x) * sz
    zx, zy, zz = 2.0 * (x * z - w * y) * sx, 2.0 * (y * z + w * x) * sy, (1.0 - 2.0 * (x * x + y * y)) * sz
    return (
        xx * xx + xy * xy + xz * xz,
        xx * yx + xy * yy + xz * yz,
        xx * zx + xy * zy + xz * zz,
        yx * yx + yy * yy + yz * yz,
        yx * zx + yy * zy + yz * zz,
        zx * zx + zy * zy + zz * zz,
    )


@part
def pack_block(block, means, opacities, sh, start, end, largest, eight, target):
    """Fill a block from rows ``start`` to ``end``, at most BLOCK, and pad it; all but the covariances of the rows.

    ``largest`` is the largest scale of these splats, ``eight`` room for as many numbers.
    """
    padded, at = len(target.log2_opacities), block * BLOCK - start
    for i in range(start, end):
        for axis in range(3):
            target.means[axis * padded + at + i] = means[i, axis]
            target.base_colors[axis * padded + at + i] = np.float32(0.5) + np.float32(SH_C0) * sh[i, 0, axis]
        target.log2_opacities[at + i] = math.log2(max(opacities[i], np.float32(1e-38)))
    for i in range(end, start + BLOCK):
        for axis in range(3):
            target.means[axis * padded + at + i] = target.base_colors[axis * padded + at + i] = np.float32(0.0)
        for entry in range(6):
            target.covars[entry * padded + at + i] = np.float32(1.0 if entry in (0, 3, 5) else 0.0)
        target.log2_opacities[at + i] = np.float32(INVISIBLE)
    _bound_block(block, means, start, end, largest, target.bounds)
    _pack_harmonics(block, sh, start, end, eight, target.sh_rest)


@part
def _bound_block(block, means, start, end, largest, bounds):
    at = block * BOUNDS
    distance2 = np.float32(0.0)
    for axis in range(3):
        low = high = means[start, axis]
        for i in range(start + 1, end):
            low, high = min(low, means[i, axis]), max(high, means[i, axis])
        half = np.float32(0.5) * (high - low)
        bounds[at + axis] = low + half
        distance2 += half * half
    bounds[at + 3] = math.sqrt(distance2)
    bounds[at + 4] = largest


@part
def _pack_harmonics(block, sh, start, end, eight, sh_rest):
    """Store the harmonics of a block, eight splats side by side; the last one stands for all that are missing."""
    coefficients = sh.shape[1] - 1
    at = block * BLOCK * coefficients * 3
    for first in range(start, start + BLOCK, 8):
        for coefficient in range(coefficients):
            for channel in range(3):
                for lane in range(8):
                    eight[lane] = sh[min(first + lane, end - 1), coefficient + 1, channel]
                bounded = maximum(
                    minimum(load(eight, 0), splat(np.float32(HALF_MAX))), splat(np.float32(-HALF_MAX))
                )
                store_half(sh_rest, at, bounded)
                at += 8
