"""How much light of each block comes through to the eye: front to back, each takes some from those behind it.

Blocks count as cubes with the diagonal of their bounds, evenly filled, and the image as a few cells.

Source: Klosowski and Silva 2000, *The prioritized-layered projection algorithm for visible set estimation*.
"""

from __future__ import annotations

import math

import numpy as np

from tsplat._jit import part
from tsplat.lod.heap import block_of, drop_first, key_of, push
from tsplat.lod.merge_scratch import LEAST_SIZE
from tsplat.raster.sight import seen_from_the_eye

CELLS = 32
"""Of the image, across and down."""

HALF_SIDE = np.float32(math.sqrt(1.0 / 3.0))
"""Of a cube, in radii of the ball around it."""


@part
def solidity_of(mass, radius):
    """Return how much light a block takes away, 0 to 1, from its splats' opacity times area in units of pi."""
    side = np.float32(2.0) * HALF_SIDE * max(radius, LEAST_SIZE)
    return np.float32(1.0) - math.exp(np.float32(-2.0 * math.pi) * mass / side / side)


@part
def fill_light(blocks, count, job):
    """Fill ``light`` for so many blocks: the mean square of what comes through, as errors are squared.

    ``remaining`` and ``queue`` are room: for the light that each cell has left, and to bring the blocks in order.
    """
    for cell in range(CELLS * CELLS):
        job.remaining[cell] = np.float32(1.0)
    waiting = 0
    for i in range(count):
        block = np.int64(blocks[i])
        _, _, z, radius, _ = seen_from_the_eye(block, job.numbers, job.bounds)
        job.light[block] = np.float32(1.0)
        if z > max(HALF_SIDE * radius, job.numbers[22]):
            waiting = push(job.queue, waiting, key_of(np.float32(1.0) / z, block))
    while waiting > 0:
        block = block_of(job.queue[0])
        waiting = drop_first(job.queue, waiting)
        _take_light(block, job)


@part
def _take_light(block, job):
    """Fill the light of the block that is next behind those that have taken theirs, and take what it takes."""
    left, right, above, below = _seen_cells(block, job)
    area = (right - left) * (below - above)
    if not (right > left and below > above and area > np.float32(0.0)):  # nor where one is not a number
        return
    squares = np.float32(0.0)
    for row in range(np.int64(above), np.int64(math.ceil(below))):
        height = min(np.float32(row + 1), below) - max(np.float32(row), above)
        for column in range(np.int64(left), np.int64(math.ceil(right))):
            covered = height * (min(np.float32(column + 1), right) - max(np.float32(column), left))
            light = job.remaining[row * CELLS + column]
            squares += covered * light * light
            job.remaining[row * CELLS + column] = light * (np.float32(1.0) - covered * job.solidities[block])
    job.light[block] = squares / area


@part
def _seen_cells(block, job):
    """Return where a block begins and ends in the image, in cells."""
    fx, fy, cx, cy = job.numbers[12:16]
    last_x, last_y = job.numbers[26:28]
    across, down = np.float32(CELLS) / (last_x + np.float32(1.0)), np.float32(CELLS) / (last_y + np.float32(1.0))
    x, y, z, radius, _ = seen_from_the_eye(block, job.numbers, job.bounds)
    x, reach_x = across * (fx * x / z + cx), across * fx * HALF_SIDE * radius / z
    y, reach_y = down * (fy * y / z + cy), down * fy * HALF_SIDE * radius / z
    zero, cells = np.float32(0.0), np.float32(CELLS)
    return max(x - reach_x, zero), min(x + reach_x, cells), max(y - reach_y, zero), min(y + reach_y, cells)
