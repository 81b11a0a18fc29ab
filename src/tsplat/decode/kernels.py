"""What `tsplat.decode.plain` does, bit for bit, as machine code.

Loops of plain scalars, which compile within two seconds; LLVM makes vectors of those that run along a slice.
"""

from __future__ import annotations

import math

import numpy as np

from tsplat._jit import kernel
from tsplat.decode.plain import FIELD_BITS


@kernel
def look_up(steps, columns, levels, first, out):
    """See `tsplat.decode.plain.look_up`."""
    for row in range(len(steps)):
        found, wanted = steps[row], out[row, first : first + len(columns)]
        for column in range(len(columns)):
            wanted[column] = levels[found[columns[column]]]


@kernel
def scale(steps, middle, factors, first, out):
    """See `tsplat.decode.plain.scale`."""
    for row in range(len(steps)):
        found, wanted = steps[row], out[row, first : first + len(factors)]
        for column in range(len(factors)):
            wanted[column] = (np.float32(found[column]) - middle) * factors[column]


@kernel
def between(words, shifts, tops, low, high, group, out):
    """See `tsplat.decode.plain.between`."""
    for number in range(len(low)):
        start = number * group
        end = min(start + group, len(words))
        for axis in range(3):
            shift, top = shifts[axis], tops[axis]
            least, most = np.float64(low[number, axis]), np.float64(high[number, axis])
            whole = np.float64(top)
            unit = 1.0 / whole
            for row in range(start, end):
                step = np.float64(np.int32(words[row] >> shift & top))
                out[row, axis] = np.float32((least * (whole - step) + most * step) * unit)


@kernel
def smallest_three(words, levels, places, out):
    """See `tsplat.decode.plain.smallest_three`."""
    bits, last = np.uint32(FIELD_BITS), np.uint32((1 << FIELD_BITS) - 1)
    for row in range(len(words)):
        word = words[row]
        x = np.float64(levels[word >> bits + bits & last])
        y = np.float64(levels[word >> bits & last])
        z = np.float64(levels[word & last])
        squares = x * x + y * y + z * z
        factor = 1.0 / math.sqrt(max(1.0, squares))
        place = places[word >> bits + bits + bits]
        out[row, place[0]] = np.float32(math.sqrt(max(0.0, 1.0 - squares)))
        out[row, place[1]] = np.float32(x * factor)
        out[row, place[2]] = np.float32(y * factor)
        out[row, place[3]] = np.float32(z * factor)


def calls():
    """Return every kernel with arguments of the types that it is called with, of no splats."""
    values, rows = np.empty((0, 3), np.float32), np.empty((0, 4), np.float32)
    bounds, words = values, np.empty(0, np.uint32)
    levels, steps = np.empty(0, np.float32), np.empty((0, 3), np.uint8)
    columns, places = np.empty(0, np.uint8), np.empty((0, 4), np.uint8)
    return [
        (look_up, (steps, columns, levels, 3, values)),
        (scale, (steps, np.float32(0.0), levels, 3, values)),
        (between, (words, words, words, bounds, bounds, 256, values)),
        (smallest_three, (words, levels, places, rows)),
    ]
