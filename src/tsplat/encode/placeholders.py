"""Placeholder cells of the kitty graphics protocol: text that stands for parts of a picture.

A multiplexer moves and hides them like any text, and the terminal draws the picture where they end up.
Source: https://sw.kovidgoyal.net/kitty/graphics-protocol/#unicode-placeholders.
"""

from __future__ import annotations

from functools import lru_cache

_PLACEHOLDER = "\U0010eeee"

# Marks above a letter that no normalization touches, from the protocol's rowcolumn-diacritics.txt.
_MARK_RANGES = """
    0305 030D-030E 0310 0312 033D-033F 0346 034A-034C 0350-0352 0357 035B 0363-036F 0483-0487 0592-0595 0597-0599
    059C-05A1 05A8-05A9 05AB-05AC 05AF 05C4 0610-0617 0657-065B 065D-065E 06D6-06DC 06DF-06E2 06E4 06E7-06E8
    06EB-06EC 0730 0732-0733 0735-0736 073A 073D 073F-0741 0743 0745 0747 0749-074A 07EB-07F1 07F3 0816-0819
    081B-0823 0825-0827 0829-082D 0951 0953-0954 0F82-0F83 0F86-0F87 135D-135F 17DD 193A 1A17 1A75-1A7C 1B6B
    1B6D-1B73 1CD0-1CD2 1CDA-1CDB 1CE0 1DC0-1DC1 1DC3-1DC9 1DCB-1DCC 1DD1-1DE6 1DFE 20D0-20D1 20D4-20D7 20DB-20DC
    20E1 20E7 20E9 20F0 2CEF-2CF1 2DE0-2DFF A66F A67C-A67D A6F0-A6F1 A8E0-A8F1 AAB0 AAB2-AAB3 AAB7-AAB8 AABE-AABF
    AAC1 FE20-FE26 10A0F 10A38 1D185-1D189 1D1AA-1D1AD 1D242-1D244
"""


def _marks() -> tuple[str, ...]:
    bounds = [[int(end, 16) for end in ends.split("-")] for ends in _MARK_RANGES.split()]
    return tuple(chr(code) for ends in bounds for code in range(ends[0], ends[-1] + 1))


MARKS = _marks()
"""The mark that stands for each row and each column; there are no more."""


@lru_cache(maxsize=2)  # two ids take turns
def placeholder_cells(identifier: int, columns: int, rows: int) -> bytes:
    """Return the text that shows a picture, its top left at the cursor's cell.

    Every cell says its row and column, so that text written over some of them leaves the others as they are.

    Parameters
    ----------
    identifier : int
        The picture's, from 16 to 255. It is the index of the foreground colour, which a multiplexer passes on
        as it is; of 24 bits it keeps only as many as it takes its terminal to show.
    columns, rows : int
        At most `len(MARKS)` each.
    """
    color = b"\x1b[0;38;5;%dm" % identifier
    rows_of_cells = (
        color + "".join(_PLACEHOLDER + MARKS[row] + MARKS[column] for column in range(columns)).encode()
        for row in range(rows)
    )
    # As with half blocks: restoring finds the first column again, and saving again is for terminals that forget.
    return b"\x1b7" + b"\x1b8\x1b[B\x1b7".join(rows_of_cells) + b"\x1b8\x1b[0m"
