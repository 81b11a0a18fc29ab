"""Once per scene: everything that no camera changes, laid out for the kernels, and the buffers they fill.

Splats are projected thousands of times but prepared once, so the 3D covariance is worked out here.
Every quantity lies in an array of its own, padded to whole blocks with splats that are never seen.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass, field
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from tsplat._jit import kernel, part
from tsplat._lanes import load, maximum, minimum, splat
from tsplat._moves import store_half
from tsplat._threads import FIRST_FREE, claim, new_team
from tsplat.raster import record
from tsplat.raster.buffers import Buffers, aligned
from tsplat.raster.workers import on_threads
from tsplat.scene import SH_COEFFICIENTS, Gaussians

F32 = npt.NDArray[np.float32]

BLOCK = 256
"""Splats projected at a time: their intermediate results stay in the first-level cache."""

BOUNDS = 5
"""Numbers that say where the splats of a block are, see `Prepared`."""

SH_C0 = 0.28209479177387814
"""The constant basis function of spherical harmonics."""

HALF_MAX = 65504.0
"""The largest half-precision number; no trained harmonic comes near it."""

INVISIBLE = -1000.0
"""Base-2 logarithm of the opacity of a padding splat: no alpha_min is so small."""


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
        How many of these there are: 0, 3, 8 or 15.
    records : ndarray of float32, [P * 16]
        One row for each visible splat, see `record`; a block's rows start where its splats start.
    depth_keys : ndarray of uint32, [P]
        What each record is sorted by.
    tiles : ndarray of uint64, [P]
        First tile of each record, 16 bits of its column and then of its row; above, the last tile.
    visible : ndarray of int32, [blocks]
        Records of each block.
    bounds : ndarray of float32, [blocks * 5]
        Of each block: the middle of its centres, how far any is from there, and the largest scale of a splat.
    buffers : Buffers
        What grows with the image.
    last_size, last_frame
        What the last frame shares with the next one of its size; see `frame.new_frame`.
    lock : Lock
        Held while a frame uses the buffers.
    """

    means: F32
    covars: F32
    log2_opacities: F32
    base_colors: F32
    sh_rest: npt.NDArray[np.uint16]
    coefficients: int
    records: F32
    depth_keys: npt.NDArray[np.uint32]
    tiles: npt.NDArray[np.uint64]
    visible: npt.NDArray[np.int32]
    bounds: F32
    buffers: Buffers = field(default_factory=Buffers)
    last_size: tuple[int, ...] = ()
    last_frame: Any = None
    lock: threading.Lock = field(default_factory=threading.Lock)

    def coefficients_used(self, sh_degree: int) -> int:
        """Return how many harmonics above the constant one a frame of this degree takes: 0, 3, 8 or 15."""
        return min(SH_COEFFICIENTS[sh_degree] - 1, self.coefficients)


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
    blocks = -(-len(gaussians) // BLOCK)
    padded = blocks * BLOCK
    coefficients = gaussians.sh.shape[1] - 1
    scene = Prepared(
        means=aligned(3 * padded, np.float32),
        covars=aligned(6 * padded, np.float32),
        log2_opacities=aligned(padded, np.float32),
        base_colors=aligned(3 * padded, np.float32),
        sh_rest=aligned(padded * coefficients * 3, np.uint16),
        coefficients=coefficients,
        records=aligned(padded * record.LENGTH, np.float32),
        depth_keys=aligned(padded, np.uint32),
        tiles=aligned(padded, np.uint64),
        visible=aligned(blocks, np.int32),
        bounds=aligned(blocks * BOUNDS, np.float32),
    )
    team = new_team(1)
    on_threads(threads, team, _prepare_blocks, _Job(
        team, gaussians.means, gaussians.quats, gaussians.scales, gaussians.opacities, gaussians.sh,
        scene.means, scene.covars, scene.log2_opacities, scene.base_colors, scene.sh_rest,
        scene.records, scene.depth_keys, scene.tiles, scene.bounds,
    ))  # fmt: skip
    return scene


class _Job(NamedTuple):
    """What `_prepare_blocks` reads and fills; see `Gaussians` and `Prepared`."""

    team: npt.NDArray[np.int64]
    means: F32
    quats: F32
    scales: F32
    opacities: F32
    sh: F32
    out_means: F32
    covars: F32
    log2_opacities: F32
    base_colors: F32
    sh_rest: npt.NDArray[np.uint16]
    records: F32
    depth_keys: npt.NDArray[np.uint32]
    tiles: npt.NDArray[np.uint64]
    bounds: F32


@kernel
def _prepare_blocks(worker, job):
    n, padded = len(job.means), len(job.log2_opacities)
    eight = np.empty(8, np.float32)
    while True:
        start = claim(job.team, FIRST_FREE) * BLOCK
        if start >= padded:
            return
        # The first touch of a page costs more than what is computed for it: better now than in a frame.
        job.records[start * record.LENGTH : (start + BLOCK) * record.LENGTH] = np.float32(0.0)
        job.depth_keys[start : start + BLOCK] = np.uint32(0)
        job.tiles[start : start + BLOCK] = np.uint64(0)
        for i in range(start, start + BLOCK):
            if i < n:
                _prepare_splat(i, padded, job)
            else:
                for axis in range(3):
                    job.out_means[axis * padded + i] = job.base_colors[axis * padded + i] = np.float32(0.0)
                for entry in range(6):
                    job.covars[entry * padded + i] = np.float32(1.0 if entry in (0, 3, 5) else 0.0)
                job.log2_opacities[i] = np.float32(INVISIBLE)
        _bound_block(start, min(start + BLOCK, n), job)
        _pack_harmonics(start, n, job.sh, eight, job.sh_rest)


@part
def _prepare_splat(i, padded, job):
    one, two, half = np.float32(1), np.float32(2), np.float32(0.5)
    for axis in range(3):
        job.out_means[axis * padded + i] = job.means[i, axis]
        job.base_colors[axis * padded + i] = half + np.float32(SH_C0) * job.sh[i, 0, axis]
    job.log2_opacities[i] = math.log2(max(job.opacities[i], np.float32(1e-38)))
    w, x, y, z = job.quats[i, 0], job.quats[i, 1], job.quats[i, 2], job.quats[i, 3]
    sx, sy, sz = job.scales[i, 0], job.scales[i, 1], job.scales[i, 2]
    xx, xy, xz = (one - two * (y * y + z * z)) * sx, two * (x * y - w * z) * sy, two * (x * z + w * y) * sz
    yx, yy, yz = two * (x * y + w * z) * sx, (one - two * (x * x + z * z)) * sy, two * (y * z - w * x) * sz
    zx, zy, zz = two * (x * z - w * y) * sx, two * (y * z + w * x) * sy, (one - two * (x * x + y * y)) * sz
    job.covars[i] = xx * xx + xy * xy + xz * xz
    job.covars[padded + i] = xx * yx + xy * yy + xz * yz
    job.covars[2 * padded + i] = xx * zx + xy * zy + xz * zz
    job.covars[3 * padded + i] = yx * yx + yy * yy + yz * yz
    job.covars[4 * padded + i] = yx * zx + yy * zy + yz * zz
    job.covars[5 * padded + i] = zx * zx + zy * zy + zz * zz


@part
def _bound_block(start, end, job):
    at = start // BLOCK * BOUNDS
    distance2 = np.float32(0.0)
    for axis in range(3):
        low = high = job.means[start, axis]
        for i in range(start + 1, end):
            low, high = min(low, job.means[i, axis]), max(high, job.means[i, axis])
        half = np.float32(0.5) * (high - low)
        job.bounds[at + axis] = low + half
        distance2 += half * half
    job.bounds[at + 3] = math.sqrt(distance2)
    largest = np.float32(0.0)
    for i in range(start, end):
        for axis in range(3):
            largest = max(largest, job.scales[i, axis])
    job.bounds[at + 4] = largest


@part
def _pack_harmonics(start, n, sh, eight, sh_rest):
    """Store the harmonics of a block, eight splats side by side."""
    coefficients = sh.shape[1] - 1
    for first in range(start, start + BLOCK, 8):
        at = first * coefficients * 3
        for coefficient in range(coefficients):
            for channel in range(3):
                for lane in range(8):
                    i = min(first + lane, n - 1)
                    eight[lane] = sh[i, coefficient + 1, channel]
                bounded = maximum(
                    minimum(load(eight, 0), splat(np.float32(HALF_MAX))), splat(np.float32(-HALF_MAX))
                )
                store_half(sh_rest, at, bounded)
                at += 8
