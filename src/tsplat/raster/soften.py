"""After the stages: a small image is blurred a little, after blending, where light adds up.

`RenderOptions.softening` says how much.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tsplat._jit import kernel, part
from tsplat._lanes import load, splat, store
from tsplat._threads import FIRST_FREE, claim
from tsplat.raster.buffers import Buffers
from tsplat.raster.frame import Image
from tsplat.raster.workers import on_threads

F32 = npt.NDArray[np.float32]

SOFTEN = "soften"
"""What this is called among the stages, where it is done."""

BAND = 16
"""Rows that a worker takes at a time."""


class _Job(NamedTuple):
    """What `_soften_bands` works on: room for a row of each worker, the images as they are and as they become."""

    team: npt.NDArray[np.int64]
    width: int
    height: int
    kept: np.float32
    rows: F32
    colors: F32
    alphas: F32
    soft_colors: F32
    soft_alphas: F32


def soften(image: Image, variance: float, threads: int, team: npt.NDArray[np.int64], buffers: Buffers) -> Image:
    """Return the image with its colours and alphas blurred by so many pixels squared."""
    soft = image._replace(
        colors=buffers.image(image.height * image.width * 3), alphas=buffers.image(image.height * image.width)
    )
    kept = np.float32(1.0 - variance)
    rows = buffers.array("soften_rows", threads * 3 * image.width, np.float32)
    job = _Job(team, image.width, image.height, kept, rows, image.colors, image.alphas, soft.colors, soft.alphas)
    on_threads(threads, team, _soften_bands.on(job))
    return soft


@kernel
def _soften_bands(worker, job):
    row = job.rows[worker * 3 * job.width : (worker + 1) * 3 * job.width]
    while True:
        first = claim(job.team, FIRST_FREE) * BAND
        if first >= job.height:
            return
        for y in range(first, min(first + BAND, job.height)):
            _soften_row(job.colors, y, job.height, 3, 3 * job.width, job.kept, row, job.soft_colors)
            _soften_row(job.alphas, y, job.height, 1, job.width, job.kept, row, job.soft_alphas)


@part
def _soften_row(source, y, height, channels, length, kept, row, target):
    """Write row ``y`` of ``length`` values, neighbours ``channels`` apart; ``row`` is room for as many."""
    given = np.float32(0.5) * (np.float32(1.0) - kept)
    here, above, below = y * length, max(y - 1, 0) * length, min(y + 1, height - 1) * length
    _blend(source, here, above, below, kept, given, row, 0, length)
    inside = length - 2 * channels
    if inside > 0:
        _blend(row, channels, 0, 2 * channels, kept, given, target, here + channels, inside)
    for i in range(channels):
        last, after = length - channels + i, min(i + channels, length - channels + i)
        target[here + i] = kept * row[i] + given * (row[i] + row[after])
        target[here + last] = kept * row[last] + given * (row[last] + row[max(last - channels, i)])


@part
def _blend(source, middle, before, after, kept, given, target, at, length):
    """Fill so many values of ``target`` from three places of ``source``, eight at a time."""
    whole = length - length % 8
    all_kept, all_given = splat(kept), splat(given)
    for i in range(0, whole, 8):
        beside = load(source, before + i) + load(source, after + i)
        store(target, at + i, all_kept * load(source, middle + i) + all_given * beside)
    for i in range(whole, length):
        target[at + i] = kept * source[middle + i] + given * (source[before + i] + source[after + i])
