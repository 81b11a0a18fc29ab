"""What a terminal shows: cells from an emulator, and pixels from the names of the characters in them."""

from __future__ import annotations

import unicodedata

import numpy as np
import numpy.typing as npt
import pyte

from tests.encode.frames import U8

Region = tuple[float, float, float, float]
"""Left, right, top and bottom of a part of a cell, 0 to 1."""

OCTANT_GAPS: tuple[int, ...] = (0, 1, 2, 3, 5, 10, 15, 20, 40, 63, 64, 80, 85, 90, 95, 128)
OCTANT_GAPS += (160, 165, 170, 175, 192, 240, 245, 250, 252, 255)
"""Patterns that U+1CD00 and what follows leaves out."""

NEWER_NAMES = {
    "\U0001cea0": "RIGHT HALF LOWER ONE QUARTER BLOCK",
    "\U0001cea3": "LEFT HALF LOWER ONE QUARTER BLOCK",
    "\U0001cea8": "LEFT HALF UPPER ONE QUARTER BLOCK",
    "\U0001ceab": "RIGHT HALF UPPER ONE QUARTER BLOCK",
    "\U0001fbe6": "MIDDLE LEFT ONE QUARTER BLOCK",
    "\U0001fbe7": "MIDDLE RIGHT ONE QUARTER BLOCK",
}
"""From Unicode 16, which Python 3.14 is the first to know."""

PARTS: dict[str, Region] = {
    "FULL BLOCK": (0, 1, 0, 1),
    "UPPER HALF BLOCK": (0, 1, 0, 0.5),
    "LOWER HALF BLOCK": (0, 1, 0.5, 1),
    "LEFT HALF BLOCK": (0, 0.5, 0, 1),
    "RIGHT HALF BLOCK": (0.5, 1, 0, 1),
    "UPPER ONE QUARTER BLOCK": (0, 1, 0, 0.25),
    "LOWER ONE QUARTER BLOCK": (0, 1, 0.75, 1),
    "UPPER THREE QUARTERS BLOCK": (0, 1, 0, 0.75),
    "LOWER THREE QUARTERS BLOCK": (0, 1, 0.25, 1),
    "LEFT HALF UPPER ONE QUARTER BLOCK": (0, 0.5, 0, 0.25),
    "RIGHT HALF UPPER ONE QUARTER BLOCK": (0.5, 1, 0, 0.25),
    "LEFT HALF LOWER ONE QUARTER BLOCK": (0, 0.5, 0.75, 1),
    "RIGHT HALF LOWER ONE QUARTER BLOCK": (0.5, 1, 0.75, 1),
    "MIDDLE LEFT ONE QUARTER BLOCK": (0, 0.5, 0.25, 0.75),
    "MIDDLE RIGHT ONE QUARTER BLOCK": (0.5, 1, 0.25, 0.75),
    "UPPER LEFT": (0, 0.5, 0, 0.5),
    "UPPER RIGHT": (0.5, 1, 0, 0.5),
    "LOWER LEFT": (0, 0.5, 0.5, 1),
    "LOWER RIGHT": (0.5, 1, 0.5, 1),
}
COLOR_NAMES = ("black", "red", "green", "brown", "blue", "magenta", "cyan", "white")
XTERM_COLORS = [
    *((0, 0, 0), (205, 0, 0), (0, 205, 0), (205, 205, 0), (0, 0, 238), (205, 0, 205), (0, 205, 205)),
    *((229, 229, 229), (127, 127, 127), (255, 0, 0), (0, 255, 0), (255, 255, 0), (92, 92, 255)),
    *((255, 0, 255), (0, 255, 255), (255, 255, 255)),
]
"""The 16 colours by number, from the manual of xterm."""


def show(stream: bytes, columns: int, rows: int, at: tuple[int, int] = (0, 0)) -> pyte.Screen:
    """Return the screen of an emulator that was sent a stream, the cursor at a column and a row."""
    screen = pyte.Screen(columns, rows)
    screen.cursor_position(at[1] + 1, at[0] + 1)
    pyte.ByteStream(screen).feed(stream)
    return screen


def lit(character: str, across: int, down: int) -> npt.NDArray[np.bool_]:
    """Return which pixels of a cell a character lights, [down, across], by what it is called."""
    regions = _regions(character)
    y, x = (np.indices((down, across)) + 0.5) / np.array([down, across])[:, None, None]
    inside = np.zeros((down, across), bool)
    for left, right, top, bottom in regions:
        inside |= (left < x) & (x < right) & (top < y) & (y < bottom)
    return inside


def _regions(character: str) -> list[Region]:
    if character == " ":
        return []
    if "\U0001cd00" <= character <= "\U0001cde5":
        patterns = [pattern for pattern in range(256) if pattern not in OCTANT_GAPS]
        pattern = patterns[ord(character) - 0x1CD00]
        return [_grid(i % 2, i // 2, 4) for i in range(8) if pattern >> i & 1]
    name = NEWER_NAMES.get(character) or unicodedata.name(character)
    if name.startswith("BLOCK SEXTANT-"):
        return [_grid((int(digit) - 1) % 2, (int(digit) - 1) // 2, 3) for digit in name.partition("-")[2]]
    if name.startswith("BRAILLE PATTERN DOTS-"):
        places = {"1": (0, 0), "2": (0, 1), "3": (0, 2), "4": (1, 0), "5": (1, 1), "6": (1, 2), "7": (0, 3)}
        return [_grid(*places.get(digit, (1, 3)), 4) for digit in name.partition("-")[2]]
    return [PARTS[part] for part in name.removeprefix("QUADRANT ").split(" AND ")]


def _grid(column: int, row: int, rows: int) -> Region:
    return column / 2, (column + 1) / 2, row / rows, (row + 1) / rows


def color(text: str, default: tuple[int, int, int] = (0, 0, 0)) -> tuple[int, int, int]:
    """Return the red, green and blue of a colour as the emulator says it; the 16 colours are xterm's."""
    if text == "default":
        return default
    plain = text.replace("bfight", "bright").removeprefix("bright")  # the emulator spells one of them wrong
    if plain in COLOR_NAMES:
        return XTERM_COLORS[COLOR_NAMES.index(plain) + 8 * (plain != text)]
    red, green, blue = bytes.fromhex(text)
    return red, green, blue


def pixels(
    screen: pyte.Screen, columns: int, rows: int, across: int, down: int, default: tuple[int, int, int] = (0, 0, 0)
) -> U8:
    """Return what the cells at the top left show; ``default`` is the foreground where none is set."""
    picture = np.empty((rows * down, columns * across, 3), np.uint8)
    for row in range(rows):
        for column in range(columns):
            cell = screen.buffer[row][column]
            shown = lit(cell.data, across, down)[..., None]
            part = np.where(shown, color(cell.fg, default), color(cell.bg))
            picture[row * down : (row + 1) * down, column * across : (column + 1) * across] = part
    return picture
