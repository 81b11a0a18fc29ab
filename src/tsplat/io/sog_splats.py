"""One SOG scene becomes arrays: every plane read, every table looked up.

Source: the SOG specification on developer.playcanvas.com.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tsplat.io.sog_files import Files
from tsplat.io.sog_meta import PALETTE_MAX, Meta, Palette
from tsplat.io.sog_planes import SPARE_PIXELS, U8, read_plane

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]

ROW_CENTROIDS = 64
"""So many centroids lie side by side in their plane."""

COEFFICIENTS = (0, 3, 8, 15)
"""How many coefficients a centroid has for each SH degree."""

QUAT_TAG = 252
"""The fourth byte of a quat, less this, tells which of wxyz is the largest and left out."""

SPLATS_A_BYTE = 16
"""Means in disorder take about three bytes each; an image that holds so many more in one is a trap."""


class Splats(NamedTuple):
    """The fields of `Gaussians`, not yet checked."""

    means: F32
    quats: F32
    scales: F32
    opacities: F32
    sh: F32
    antialiased: bool


def read_splats(files: Files, meta: Meta, progress: Callable[[float], None]) -> Splats:
    """Return all splats of a scene.

    Raises
    ------
    CorruptFileError
        A plane is broken, too small, or names what its table does not hold.
    """
    size = files.size(meta.means_l)
    if meta.count > SPARE_PIXELS + SPLATS_A_BYTE * size:
        problem = f"holds {size} bytes, expected at least {meta.count // SPLATS_A_BYTE} for {meta.count} splats"
        raise files.corrupt(meta.means_l, problem)
    means = _means(_pixels(files, meta.means_l, meta.count), _pixels(files, meta.means_u, meta.count), meta)
    progress(2 / 7)
    quats = _quats(files, meta)
    progress(3 / 7)
    scales = _look_up(files, meta.scales, _pixels(files, meta.scales, meta.count)[:, :3], meta.scale_values)
    with np.errstate(over="ignore"):
        np.exp(scales, out=scales)
    progress(4 / 7)
    colors = _pixels(files, meta.sh0, meta.count)
    opacities = meta.opacity_values.astype(np.float32)[colors[:, 3]]
    sh0 = _look_up(files, meta.sh0, colors[:, :3], meta.sh0_values)
    progress(5 / 7)
    sh = sh0[:, None] if meta.palette is None else _with_palette(files, meta, meta.palette, sh0)
    progress(1.0)
    return Splats(means, quats, scales, opacities, sh, meta.antialiased)


def _pixels(files: Files, name: str, count: int) -> U8:
    return read_plane(files, name, count).reshape(-1, 4)[:count]


def _means(low: U8, high: U8, meta: Meta) -> F32:
    means = np.empty((meta.count, 3), np.float32)
    steps = np.arange(1 << 16) / 0xFFFF
    with np.errstate(over="ignore", invalid="ignore"):
        for axis in range(3):
            logs = meta.mins[axis] * (1.0 - steps) + meta.maxs[axis] * steps
            values = (np.sign(logs) * np.expm1(np.abs(logs))).astype(np.float32)
            means[:, axis] = values[low[:, axis] | high[:, axis].astype(np.uint16) << 8]
    return means


def _quats(files: Files, meta: Meta) -> F32:
    pixels = _pixels(files, meta.quats, meta.count)
    largest = pixels[:, 3]
    if meta.count and largest.min() < QUAT_TAG:
        problem = f"has a fourth byte of {largest.min()}, expected {QUAT_TAG} to 255"
        raise files.corrupt(meta.quats, problem)
    # splat-transform cuts to whole steps where it could round, half a step down on average. Every viewer
    # shows it so, and other writers round: the specification's value is taken.
    small = (pixels[:, :3].astype(np.float32) / 255.0 - 0.5) * np.float32(np.sqrt(2.0))
    rest = np.sqrt(np.maximum(0.0, 1.0 - np.einsum("ni,ni->n", small, small)))
    quats = np.empty((meta.count, 4), np.float32)
    for component in range(4):
        chosen = largest == QUAT_TAG + component
        quats[chosen] = np.insert(small[chosen], component, rest[chosen], axis=1)
    return quats


def _look_up(files: Files, name: str, pixels: U8, values: F64) -> F32:
    _check_bytes(files, name, pixels, values.shape[1])
    found = np.empty(pixels.shape, np.float32)
    with np.errstate(over="ignore"):
        table = values.astype(np.float32)
    for channel in range(3):
        found[:, channel] = table[channel][pixels[:, channel]]
    return found


def _check_bytes(files: Files, name: str, pixels: npt.NDArray[np.integer], count: int) -> None:
    if pixels.size and (largest := int(pixels.max())) >= count:
        raise files.corrupt(name, f"names entry {largest} of {count}, expected less")


def _with_palette(files: Files, meta: Meta, palette: Palette, sh0: F32) -> F32:
    centroids = _centroids(files, palette)
    pixels = _pixels(files, palette.labels, meta.count)
    labels = pixels[:, 0] | pixels[:, 1].astype(np.uint16) << 8
    _check_bytes(files, palette.labels, labels, len(centroids))
    sh = np.empty((meta.count, 1 + centroids.shape[1], 3), np.float32)
    sh[:, 0] = sh0
    sh[:, 1:] = centroids[labels]
    return sh


def _centroids(files: Files, palette: Palette) -> F32:
    """Return the palette, [n, K - 1, 3]."""
    # Without a count or bands in the file, the most that a label can name; the plane says how many there are.
    rows = -(-(PALETTE_MAX if palette.count is None else palette.count) // ROW_CENTROIDS)
    widest = ROW_CENTROIDS * COEFFICIENTS[3 if palette.bands is None else palette.bands]
    exact = palette.count is not None and palette.bands is not None
    plane = read_plane(files, palette.centroids, rows * widest if exact else 0, rows * widest)
    height, width = plane.shape[:2]
    k, odd = divmod(width, ROW_CENTROIDS)
    known = COEFFICIENTS[1:] if palette.bands is None else (COEFFICIENTS[palette.bands],)
    if odd or k not in known:
        expected = " or ".join(str(ROW_CENTROIDS * each) for each in known)
        raise files.corrupt(palette.centroids, f"is {width} pixels wide, expected {expected}")
    count = height * ROW_CENTROIDS if palette.count is None else palette.count
    bytes_of = plane[..., :3].reshape(height * ROW_CENTROIDS, k, 3)[: min(count, PALETTE_MAX)]
    _check_bytes(files, palette.centroids, bytes_of, len(palette.values))
    with np.errstate(over="ignore"):
        return palette.values.astype(np.float32)[bytes_of]
