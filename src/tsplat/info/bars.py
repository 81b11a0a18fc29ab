"""A histogram as one line of text."""

from __future__ import annotations

from collections.abc import Sequence

BLOCKS = "▁▂▃▄▅▆▇█"
ASCII = ".:-=+*#@"
"""For outputs that cannot show blocks, by ink."""


def bars(counts: Sequence[int], width: int, *, blocks: bool) -> str:
    """Return a bar for each count, or for the sum of a few neighbours.

    Parameters
    ----------
    counts : sequence of int
        As many as ``width``, or a multiple of it.
    width : int
        Characters.
    blocks : bool
        Whether block characters can be shown.

    Returns
    -------
    str
        A space stands for none; the least that there is can still be seen.
    """
    merged = len(counts) // width
    sums = [sum(counts[first : first + merged]) for first in range(0, len(counts), merged)]
    levels = f" {BLOCKS if blocks else ASCII}"
    highest = max(*sums, 1)
    # Rounded up without floats: only nothing is drawn as nothing.
    return "".join(levels[-(-each * (len(levels) - 1) // highest)] for each in sums)
