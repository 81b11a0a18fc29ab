"""What is believed of a terminal's sizes and answers: it may be broken or mean harm, and memory follows."""

from __future__ import annotations

MOST_COLUMNS, MOST_ROWS = 2000, 1000
"""Text cells across and down: the widest screen there is, of 7680 pixels, has 1920 of 4."""

MOST_CELLS = 1 << 19
"""Text cells in all: a screen of 7680 x 4320 pixels has 259,200 of 8 x 16; so many take 200 MB to draw."""

MOST_PIXELS = 7680 * 4320
"""Pixels of the screen: whoever claims more is not believed about the size of a cell."""

LARGEST_CELL = 256
"""Pixels along a side of a text cell: on the finest screens, letters as large as a thumb."""

MANY_CELLS, SMALL_CELL = 1 << 17, (5, 10)
"""So many cells of unknown size fit on no screen unless they are small."""

LEAST_SIXEL = 100
"""Pixels along a side of the largest sixel picture: of smaller ones a screen would need thousands."""

MOST_NUMBER = 1 << 24
"""Largest number of a control sequence: more than the largest character, and than any place on a screen."""

MOST_HELD = 1 << 12
"""Bytes of a sequence that may still be completed; longer ones are not for us."""

MOST_KEYS_DOWN = 64
"""Keys that may be held at once."""

MOST_WAITING = 1 << 16
"""Events that may wait to be heeded; what comes beyond is dropped."""

MOST_REPLIES = 1 << 16
"""Bytes of input among which the answers to our questions are looked for."""

Pair = tuple[int, int]


def believed_cells(columns: int, rows: int) -> Pair:
    """Return how many of these text cells are drawn on: all of them, or as many as any screen has."""
    columns = min(max(columns, 1), MOST_COLUMNS)
    return columns, min(max(rows, 1), MOST_ROWS, MOST_CELLS // columns)


def believed_cell(width: int, height: int) -> Pair | None:
    """Return the size of a text cell in pixels, or None where no cell is like that."""
    return (width, height) if 1 <= min(width, height) <= max(width, height) <= LARGEST_CELL else None


def believed_cell_among(columns: int, rows: int, cell: Pair | None) -> Pair | None:
    """Return the size of one of so many text cells, or None where it is not known or they fit on no screen."""
    cells = columns * rows
    if cell and cells * cell[0] * cell[1] <= MOST_PIXELS:
        return cell
    return SMALL_CELL if cells > MANY_CELLS else None
