"""Sets as bits of an integer, for kernels: which lanes, which cells, which splats.

As in `_lanes`, each is plain Python for Python, and a few instructions in a kernel.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tsplat._lanes import LANES

BATCH = 64
"""Members of the largest set: the bits of a uint64."""


def lowest(bits: Any) -> Any:
    """The lowest member of a uint64; 64 when it has none."""
    return (int(bits) & -int(bits)).bit_length() - 1 if bits else BATCH


def others(bits: Any) -> Any:
    """A uint64 without its lowest member; without any when it has none."""
    return np.uint64(int(bits) & (int(bits) - 1) if bits else 0)


def count(bits: Any) -> Any:
    """How many members a uint64 has."""
    return int(bits).bit_count()


def lanes_at_least(x: Any, limit: Any) -> Any:
    """The lanes of ``x`` that are at least ``limit``."""
    return sum(1 << lane for lane in range(LANES) if x[lane] >= limit[lane])


def transpose_sets(sets: Any, found: Any) -> None:
    """Write into ``found``, 16 uint64, which of the 64 sets of a uint16 array have the members 0 to 15."""
    for member in range(16):
        found[member] = sum(1 << i for i in range(BATCH) if int(sets[i]) >> member & 1)


def add_spans(sets: Any, at: Any, row: Any, before: Any, after: Any) -> None:
    """Add cells of a row of a 4 by 4 grid, member ``4 * row + column``, to the eight sets from ``at`` on.

    ``before`` of them are left out on the left and ``after`` on the right, 0 to 4, rounded down.
    """
    for lane in range(LANES):
        for column in range(int(before[lane]), 4 - int(after[lane])):
            sets[at + lane] |= 1 << 4 * row + column
