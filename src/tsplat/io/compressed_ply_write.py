"""Writes the PLY that `tsplat.io.compressed_ply` reads: splats that are near each other share a chunk.

Source: the compressed PLY writer of PlayCanvas' *splat-transform*; Morton 1966, *A Computer Oriented Geodetic Data
Base*, for the order.
"""

from __future__ import annotations

import math
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from tsplat.framing import Bulk, bulk
from tsplat.io.compressed_ply import (
    BLOCK,
    CHUNK,
    COLOR_BOUNDS,
    POSITION_BOUNDS,
    SCALE_BOUNDS,
    SH_RANGE,
    WORDS,
)
from tsplat.io.losses import colors_cut, sigmas_cut
from tsplat.io.ply_comments import comment_lines
from tsplat.scene import SH_C0, SH_COEFFICIENTS, Gaussians

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
U32 = npt.NDArray[np.uint32]
Indices = npt.NDArray[np.intp]

MAX_LOG_SCALE = 20.0
"""Log scales are kept within plus and minus this: one splat without extent would cost its chunk all precision."""

MAX_COLOR = 3.5 / SH_C0
"""Coefficients of colours are kept within plus and minus this, colours from -3 to 4, for the same reason."""

SH_DEGREE_MAX = 3
"""Other readers of this format know no more."""

ROOM = 8.0
"""Radii of the bulk in which all splats share chunks; beyond, every time farther out by this."""

MORTON_BITS = 21
"""Bits of each axis: three of them fill a word of 64."""


def write(file: BinaryIO, gaussians: Gaussians) -> list[str]:
    """Write a compressed PLY, splats in Morton order, and return what of its range that cuts.

    Harmonics beyond degree 3 are left out, coefficients beyond 4, scales beyond ``exp(20)`` and colours outside of
    -3 to 4 become the nearest that fits. Splats far outside of the bulk have chunks of their own.
    """
    k, box = min(gaussians.sh.shape[1], SH_COEFFICIENTS[SH_DEGREE_MAX]), bulk(gaussians)
    order, shown = _chunked(gaussians.means, box)
    rows = [slice(first, first + BLOCK) for first in range(0, len(order), BLOCK)]
    packed = [_pack_splats(gaussians, order[part], shown[part]) for part in rows]
    file.write(_header(len(order), 3 * (k - 1), comment_lines(gaussians)))
    for bounds, _ in packed:
        file.write(bounds)
    for _, words in packed:
        file.write(words)
    if k > 1:
        for part in rows:
            file.write(_pack_rest(gaussians.sh[order[part], 1:k]))
    tiny = math.exp(-MAX_LOG_SCALE)
    losses = colors_cut(gaussians, slice(1), MAX_COLOR, "colours outside of -3 to 4")
    losses += colors_cut(gaussians, slice(1, k), SH_RANGE, f"harmonics beyond {SH_RANGE:g}")
    return sigmas_cut(gaussians, box, tiny, 1.0 / tiny) + losses


def _chunked(means: F32, box: Bulk) -> tuple[Indices, npt.NDArray[np.bool_]]:
    """Return the order of the splats, and which of them are shown.

    All of a chunk lie within its bounds, and the wider these are, the less exactly: a single splat far away would
    cost 255 others their places. So shells about the bulk begin chunks of their own, and the last chunk of a shell
    is filled up with splats that are never drawn.
    """
    distances = np.linalg.norm(means - box.center, axis=1) / (ROOM * box.radius)
    with np.errstate(divide="ignore"):
        shells = np.ceil(np.log(distances) / math.log(ROOM)).clip(0.0)
    orders, masks = [np.empty(0, np.intp)], [np.empty(0, np.bool_)]
    for shell in np.unique(shells):
        own = np.flatnonzero(shells == shell)
        order = own[morton_order(means[own])]
        fill = -len(order) % CHUNK if shell < shells.max() else 0
        orders += [order, np.full(fill, order[-1])]
        masks += [np.ones(len(order), np.bool_), np.zeros(fill, np.bool_)]
    return np.concatenate(orders), np.concatenate(masks)


def morton_order(means: F32) -> Indices:
    """Return the order along a curve that seldom leaves a neighbourhood; indices into ``means``.

    Parameters
    ----------
    means : ndarray of float32, [N, 3]
        Centres in world units.
    """
    if not len(means):
        return np.empty(0, np.intp)
    low = means.min(0).astype(np.float64)
    extent = float((means.max(0) - low).max())
    top = (1 << MORTON_BITS) - 1
    cells = ((means - low) * (top / extent if extent > 0 else 0.0)).astype(np.uint64)
    codes = np.zeros(len(means), np.uint64)
    for bit in range(MORTON_BITS):
        for axis in range(3):
            codes |= (cells[:, axis] >> np.uint64(bit) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return np.argsort(codes, kind="stable")


def _header(count: int, rest: int, comments: list[bytes]) -> bytes:
    begin = [b"ply", b"format binary_little_endian 1.0", *comments]
    lines = [f"element chunk {math.ceil(count / CHUNK)}"]
    lines += [f"property float {name}" for name in POSITION_BOUNDS + SCALE_BOUNDS + COLOR_BOUNDS]
    lines += [f"element vertex {count}", *(f"property uint {word}" for word in WORDS)]
    if rest:
        lines += [f"element sh {count}", *(f"property uchar f_rest_{i}" for i in range(rest))]
    return b"\n".join([*begin, *(line.encode("ascii") for line in lines), b"end_header", b""])


def _pack_splats(gaussians: Gaussians, block: Indices, shown: npt.NDArray[np.bool_]) -> tuple[bytes, bytes]:
    # The bounds of every chunk of a block, and the words of its splats.
    tiny = math.exp(-MAX_LOG_SCALE)
    scales = np.log(np.clip(gaussians.scales[block], tiny, 1.0 / tiny))
    colors = np.clip(gaussians.sh[block, 0], -MAX_COLOR, MAX_COLOR) * SH_C0 + 0.5
    values = np.stack([gaussians.means[block], scales, colors], axis=1).astype(np.float32)
    starts = np.arange(0, len(block), CHUNK)
    low, high = (ends.reduceat(values, starts, axis=0) for ends in (np.minimum, np.maximum))
    parts = _parts(values, low, high)
    levels = np.concatenate([parts[:, 2], (gaussians.opacities[block] * shown)[:, None]], axis=1)
    words = (
        _pack(parts[:, 0], (21, 11, 0), (11, 10, 11)),
        _pack_quats(gaussians.quats[block]),
        _pack(parts[:, 1], (21, 11, 0), (11, 10, 11)),
        _pack(levels, (24, 16, 8, 0), (8, 8, 8, 8)),
    )
    return np.stack([low, high], axis=2).astype("<f4").tobytes(), np.stack(words, axis=1).astype("<u4").tobytes()


def _parts(values: F32, low: F32, high: F32) -> F64:
    # Where each value lies between the bounds of its chunk, from 0 to 1; 0 where they are the same.
    least, most = (np.repeat(ends, CHUNK, axis=0)[: len(values)].astype(np.float64) for ends in (low, high))
    span = most - least
    parts: F64 = (values - least) / np.where(span > 0.0, span, 1.0)
    return parts


def _pack(parts: F64, shifts: tuple[int, ...], bits: tuple[int, ...]) -> U32:
    # Numbers from 0 to 1, one for each bit field, to words; [N].
    tops = (1 << np.array(bits)) - 1
    fields = np.clip(np.floor(parts * tops + 0.5), 0, tops).astype(np.uint32)
    words: U32 = np.bitwise_or.reduce(fields << np.array(shifts, np.uint32), axis=1)
    return words


def _pack_quats(quats: F32) -> U32:
    # The three smallest components; the largest is made positive, as q and -q are the same rotation.
    which = np.abs(quats).argmax(1)[:, None]
    upright = quats * np.where(np.take_along_axis(quats, which, 1) < 0.0, -1.0, 1.0)
    others = np.take_along_axis(upright, np.arange(3) + (np.arange(3) >= which), 1)
    words: U32 = _pack(others.astype(np.float64) * math.sqrt(0.5) + 0.5, (20, 10, 0), (10, 10, 10))
    words |= which[:, 0].astype(np.uint32) << np.uint32(30)
    return words


def _pack_rest(rest: F32) -> bytes:
    # Coefficients [n, K - 1, 3] to bytes, all of a channel side by side.
    steps: npt.NDArray[np.uint8] = np.clip(np.floor((rest / SH_RANGE + 1.0) * 128.0), 0, 255).astype(np.uint8)
    return steps.transpose(0, 2, 1).tobytes()
