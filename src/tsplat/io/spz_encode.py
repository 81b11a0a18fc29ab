"""A scene as an SPZ of version 3, each stream a piece at a time.

Source: the README of github.com/nianticlabs/spz. Its library rounds harmonics to 4 or 5 of their 8 bits, for
smaller files; here they keep all 8.
"""

from __future__ import annotations

import gzip
import math
from collections.abc import Iterator
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from tsplat.errors import SaveError
from tsplat.framing import Bulk, bulk
from tsplat.importance import area
from tsplat.io.losses import brought_nearer, colors_cut, counted, sigmas_cut, too_far
from tsplat.io.spz_decode import (
    COLOUR_SCALE,
    MEANS_SIGNS,
    OTHERS,
    QUATS_SIGNS,
    SCALES,
    SH_SIGNS,
    SMALLEST_BITS,
)
from tsplat.io.spz_header import ANTIALIASED, HEADER, MAGIC
from tsplat.scene import SH_C0, SH_COEFFICIENTS, Gaussians

F32 = npt.NDArray[np.float32]

VERSION = 3
WRITE_ROWS = 1 << 16
GZIP_LEVEL = 6

SH_DEGREE_MAX = 3
"""Readers of version 3 need know no more."""

FRACTIONAL_BITS = 12
"""What Niantic's library always writes: steps of a quarter of a millimetre in a scene in metres."""

BRIGHTEST = 0.5 + SH_C0 * 0.5 / COLOUR_SCALE
"""The largest colour that the byte of a colour holds."""

GREY = 0.5
"""What is thought to be behind a splat."""

MOST_GAIN = 2.0
"""Opacities grow by no more than this: a splat too small for the format is not made a wall."""

ROOM = 4.0
"""Radii of the bulk about its middle in which everything keeps its place."""

LEAST_STEPS, SPARE_BITS = 13, 3
"""The bulk has at least two to this many steps to a radius, 0.03 pixels in a picture of 240 rows; and where splats
farther out have to give way, so many more bits."""

REACH_STEPS = 16
"""A small scene gets more bits, until the farthest mean is at least two to this many steps from the origin."""


def write_spz(file: BinaryIO, gaussians: Gaussians) -> list[str]:
    """Write a scene, turned from the axes of a PLY to those of the format; return what of its range is cut.

    Raises
    ------
    SaveError
        The bulk of the scene is too far out for 24 bits.
    """
    box = bulk(gaussians)
    bits = chosen_bits(float(np.abs(gaussians.means).max(initial=0)), box)
    losses = colors_cut(gaussians, slice(1, SH_COEFFICIENTS[SH_DEGREE_MAX]), 1.0, "harmonics beyond 1")
    limit = np.full(3, ((1 << 23) - 1) / 2.0**bits)
    far = too_far(gaussians, -limit, limit)
    if far.any():
        problem = "are brought nearer, and made smaller by as much: farther than"
        losses += counted(far, f"{problem} {limit[0]:.6g} from the origin, the bulk would lose detail")
        gaussians = brought_nearer(gaussians, box, -limit, limit)
    losses += sigmas_cut(gaussians, box, float(SCALES[0]), float(SCALES[-1]))
    # No name and no time: the same scene makes the same bytes.
    with gzip.GzipFile("", "wb", GZIP_LEVEL, file, mtime=0) as stream:
        degree, flags = min(gaussians.sh_degree, SH_DEGREE_MAX), ANTIALIASED if gaussians.antialiased else 0
        stream.write(HEADER.pack(MAGIC, VERSION, len(gaussians), degree, bits, flags, 0))
        for encoded in _streams(gaussians, bits):
            stream.write(encoded)
    return losses


def chosen_bits(reach: float, box: Bulk) -> int:
    """Return how many bits of a mean lie behind the point: all fit, unless that costs the bulk its detail.

    Parameters
    ----------
    reach : float
        Size of the largest coordinate.
    box : Bulk
        Of the scene.
    """
    inside = float(np.abs(box.center).max()) + ROOM * box.radius
    if reach <= inside:
        return fractional_bits(reach)
    needed = LEAST_STEPS - math.frexp(box.radius)[1]
    try:
        bits = fractional_bits(reach)
    except SaveError:
        bits = 0
    if bits >= needed:
        return bits
    # Such that what is brought nearer takes the same bits when it is saved again.
    return min(fractional_bits(inside), FRACTIONAL_BITS if needed <= FRACTIONAL_BITS else needed + SPARE_BITS)


def fractional_bits(reach: float) -> int:
    """Return how many bits of a mean lie behind the point.

    Parameters
    ----------
    reach : float
        Size of the largest coordinate.
    """
    exponent = math.frexp(reach)[1]  # reach is below two to this
    most = 23 - exponent
    if round(math.ldexp(reach, most)) >= 1 << 23:
        most -= 1
    if most < 0:
        raise SaveError(f"a mean lies {reach:.6g} from the origin, an SPZ holds up to 8388607; save as .ply")
    return min(most, 24, max(FRACTIONAL_BITS, REACH_STEPS + 1 - exponent)) if reach else FRACTIONAL_BITS


def _streams(gaussians: Gaussians, bits: int) -> Iterator[bytes]:
    parts = [slice(first, first + WRITE_ROWS) for first in range(0, len(gaussians), WRITE_ROWS)]
    k = min(gaussians.sh.shape[1], SH_COEFFICIENTS[SH_DEGREE_MAX])
    signs = SH_SIGNS[1:k]
    for part in parts:
        yield _fixed(gaussians.means[part] * MEANS_SIGNS, bits)
    for part in parts:
        yield _bytes(_opacities(gaussians.opacities[part], gaussians.scales[part], gaussians.sh[part, 0]) * 255)
    for part in parts:
        yield _bytes(np.clip(gaussians.sh[part, 0] * COLOUR_SCALE + 0.5, 0, 1) * 255)
    for part in parts:
        yield _scale_steps(gaussians.scales[part]).tobytes()
    for part in parts:
        yield _smallest_three(gaussians.quats[part] * QUATS_SIGNS)
    for part in parts:
        yield _bytes(np.clip(gaussians.sh[part, 1:k] * signs, -1, 1) * 128 + 128)


def _opacities(opacities: F32, scales: F32, sh_first: F32) -> F32:
    """Return the opacities that make up for what scales lose by rounding, and colours by being cut.

    A splat of a little less area shows as much of it with a little more opacity; one too bright for the format
    takes as much light in front of `GREY` if it covers more.
    """
    kept = SCALES[_scale_steps(scales)]
    shares = area(scales) / np.maximum(area(kept), np.finfo(np.float32).tiny)
    colors = 0.5 + SH_C0 * sh_first.astype(np.float64)
    lost = np.where((colors > BRIGHTEST).any(axis=1), (colors - np.minimum(colors, BRIGHTEST)).mean(axis=1), 0.0)
    brightness = np.minimum(colors, BRIGHTEST).mean(axis=1) - GREY
    with np.errstate(divide="ignore", invalid="ignore"):
        shares *= np.where((lost > 0) & (brightness > 0), 1.0 + lost / brightness, 1.0)
    return np.asarray(np.minimum(opacities * np.clip(shares, 0.0, MOST_GAIN), 1.0), np.float32)


def _scale_steps(scales: F32) -> npt.NDArray[np.uint8]:
    logs = np.log(np.maximum(scales, np.finfo(np.float32).tiny))
    steps: npt.NDArray[np.uint8] = np.clip(np.rint((logs + 10) * 16), 0, 255).astype(np.uint8)
    return steps


def _bytes(values: F32) -> bytes:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8).tobytes()


def _fixed(means: F32, bits: int) -> bytes:
    numbers = np.rint(means.astype(np.float64) * 2.0**bits).astype("<i4")
    return numbers.view(np.uint8).reshape(-1, 4)[:, :3].tobytes()


def _smallest_three(quats: F32) -> bytes:
    rows = np.arange(len(quats))
    # Components are numbered as in xyzw, and w comes first here.
    largest = (np.abs(quats).argmax(axis=1) + 3) % 4
    others = np.take_along_axis(quats, OTHERS[largest], axis=1)
    # A quat and its negative are one rotation, so the largest is made positive and its sign left out.
    others = others * np.where(quats[rows, (largest + 1) % 4] < 0, -1, 1)[:, None]
    most = (1 << SMALLEST_BITS) - 1
    sizes = np.clip(np.rint(np.abs(others) * math.sqrt(2) * most), 0, most).astype(np.uint32)
    fields = sizes | (others < 0).astype(np.uint32) << np.uint32(SMALLEST_BITS)
    words: npt.NDArray[np.uint32] = largest.astype(np.uint32) << np.uint32(30)
    for column, shift in enumerate((20, 10, 0)):
        words |= fields[:, column] << np.uint32(shift)
    return words.astype("<u4").tobytes()
