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


def having(masks: Any, bit: Any) -> Any:
    """Which of the 64 sets of a uint16 array have the member ``bit``, 0 to 15, as a uint64."""
    return np.uint64(sum(1 << i for i in range(BATCH) if int(masks[i]) >> bit & 1))


def spans(ends: Any) -> Any:
    """The cells of a 4 by 4 grid between two ends in each row, member ``4 * row + column``.

    Ends are rounded down. A row reaches to column ``ends[row]``, -1 to 3, from column
    ``-ends[row + 4]``, 0 to 4, where -1 and 4 mean none.
    """
    last, first = np.floor(ends[:4]), -np.floor(ends[4:])
    return sum(
        1 << 4 * row + column for row in range(4) for column in range(4) if first[row] <= column <= last[row]
    )
