"""Bytes for text cells: only those that changed, in the colours that are set already wherever they will do.

A run of cells that stay as they are is passed over with a cursor move, or written again where that is shorter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tsplat._jit import kernel, part
from tsplat.encode.glyphs import FULL_BLOCK, Shape

U8 = npt.NDArray[np.uint8]

NONE = 0xFFFFFFFF
"""Code of no colour, where none is wanted or the terminal's own is set. Other codes are the red, green and blue
that a cell shows, 8 bits each, below the number of the colour in its palette."""

UNKNOWN = -1
"""Stands for a glyph on screen that nobody knows."""

BYTES_PER_CELL, BYTES_PER_ROW = 48, 32
"""Most bytes that one cell, with a move before it, and the way to a row need."""

_DIGITS = np.array([[*str(value).ljust(3).encode(), len(str(value))] for value in range(256)], np.uint8)
"""Each byte in digits, then how many they are."""


class Font(NamedTuple):
    """How a shape is written.

    Attributes
    ----------
    text : ndarray of uint8, [glyphs, 4]
        UTF-8, zeros behind it.
    lengths : ndarray of uint8, [glyphs]
        Bytes of each.
    uses : ndarray of uint8, [glyphs]
        1 where the foreground shows, plus 2 where the background does.
    invertible : bool
        Whether the glyph of opposite number, with colours swapped, shows the same.
    number : int
        Colours there are: 16777216, 256 or 16, or 0 for none.
    """

    text: U8
    lengths: U8
    uses: U8
    invertible: bool
    number: int


def font(shape: Shape, number: int) -> Font:
    """Return how a shape is written in so many colours."""
    glyphs = [glyph.encode() for glyph in shape.glyphs]
    text = np.frombuffer(b"".join(glyph.ljust(4, b"\0") for glyph in glyphs), np.uint8).reshape(-1, 4)
    uses = [2 if glyph == " " else 1 if glyph == FULL_BLOCK else 3 for glyph in shape.glyphs]
    return Font(
        text.copy(),
        np.array([len(glyph) for glyph in glyphs], np.uint8),
        np.array(uses, np.uint8),
        shape.invertible,
        number,
    )


@kernel
def write(glyphs, colors, shown, shown_colors, font, slack, text):
    """Write the cells that differ from those on screen, and note what is there then.

    Parameters
    ----------
    glyphs, colors : ndarray of uint8, [R, C], and of uint32, [R, C, 2]
        Cells wanted: number of the glyph, codes of foreground and background.
    shown, shown_colors : ndarray of int16, [R, C], and of uint32, [R, C, 2]
        Cells on screen, `UNKNOWN` where they are not known; changed to what is written.
    font : Font
    slack : int
        Squared distance in RGB up to which a colour that is set does for another.
    text : ndarray of uint8

    Returns
    -------
    int
        Bytes written.
    """
    rows, columns = glyphs.shape
    end = saved = 0  # the row of the cursor's column to come back to
    for row in range(rows):
        # What is set after a move is not known, and no colour wanted is NONE.
        fore = back = NONE
        at = 0
        for column in range(columns):
            if (
                shown[row, column] == glyphs[row, column]
                and shown_colors[row, column, 0] == colors[row, column, 0]
                and shown_colors[row, column, 1] == colors[row, column, 1]
            ):
                continue
            if saved < row:
                end = _put_down(text, end, row - saved)
                saved = row
            if at < column:
                end = _pass(text, end, row, at, column, shown, shown_colors, font, fore, back)
            end, fore, back = _put_cell(
                text, end, row, column, glyphs, colors, shown, shown_colors, font, slack, fore, back
            )
            at = column + 1
    return end


@part
def _put(text, end, byte):
    # Numba checks whether a signed index is negative, which takes longer than the rest.
    text[np.uint64(end)] = byte
    return end + 1


@part
def _put_down(text, end, rows):
    """Write the way from anywhere to the first column, so many rows further down."""
    # Save and restore find the first column again wherever the picture is, even after a row that ends in
    # the terminal's last column; saving again each row is for terminals that forget.
    end = _put(text, _put(text, end, 27), 56)
    end = _put_move(text, end, rows, 66)
    return _put(text, _put(text, end, 27), 55)


@part
def _put_move(text, end, count, letter):
    end = _put(text, _put(text, end, 27), 91)
    scale = 1
    while scale * 10 <= count:
        scale *= 10
    while scale > 0 and count > 1:
        end = _put(text, end, 48 + count // scale % 10)
        scale //= 10
    return _put(text, end, letter)


@part
def _pass(text, end, row, at, column, shown, shown_colors, font, fore, back):
    """Write the way over cells that stay as they are, from one column to another."""
    # A move takes three bytes, or four and more; only few glyphs are shorter than that.
    if column - at < 4:
        length = 0
        for x in range(at, column):
            glyph = _glyph_in(shown, shown_colors, row, x, font, fore, back)
            length += font.lengths[glyph] if glyph >= 0 else 4
        if length < 3 + (column - at > 1):
            for x in range(at, column):
                end = _put_glyph(text, end, font, _glyph_in(shown, shown_colors, row, x, font, fore, back))
            return end
    return _put_move(text, end, column - at, 67)


@part
def _glyph_in(shown, shown_colors, row, column, font, fore_set, back_set):
    """Return the glyph that shows a cell on screen in the colours set, or -1 where there is none."""
    glyph = int(shown[row, column])
    fore, back = np.int64(shown_colors[row, column, 0]), np.int64(shown_colors[row, column, 1])
    if _changes(font.uses[glyph], fore, back, fore_set, back_set, 0) == 0:
        return glyph
    opposite = len(font.lengths) - 1 - glyph
    if font.invertible and _changes(font.uses[opposite], back, fore, fore_set, back_set, 0) == 0:
        return opposite
    return -1


@part
def _changes(uses, fore, back, fore_set, back_set, slack):
    """Return which colours have to be set: 1 for the foreground, plus 2 for the background."""
    needed = 0
    if uses & 1 and not _near(fore, fore_set, slack):
        needed = 1
    if uses & 2 and not _near(back, back_set, slack):
        needed |= 2
    return needed


@part
def _near(code, other, slack):
    if code == other:
        return True
    if slack == 0 or other < 0 or other == NONE or code == NONE:
        return False
    red, green, blue = (
        (code >> 16 & 255) - (other >> 16 & 255),
        (code >> 8 & 255) - (other >> 8 & 255),
        (code & 255) - (other & 255),
    )
    return red * red + green * green + blue * blue <= slack


@part
def _put_cell(text, end, row, column, glyphs, colors, shown, shown_colors, font, slack, fore_set, back_set):
    """Write a cell, the way round that sets fewer colours; return the end of the text and the colours set."""
    glyph = int(glyphs[row, column])
    fore, back = np.int64(colors[row, column, 0]), np.int64(colors[row, column, 1])
    needed = _changes(font.uses[glyph], fore, back, fore_set, back_set, slack)
    swapped = False
    if font.invertible and needed > 0:
        opposite = len(font.lengths) - 1 - glyph
        other = _changes(font.uses[opposite], back, fore, fore_set, back_set, slack)
        # Of 0 to 3, those that set fewer colours are 0, then 1 and 2, then 3.
        if (other + 1) // 2 < (needed + 1) // 2:
            swapped, glyph, needed = True, opposite, other
            fore, back = back, fore
    if needed > 0:
        end, fore_set, back_set = _put_colors(text, end, needed, fore, back, fore_set, back_set, font.number)
    end = _put_glyph(text, end, font, glyph)
    uses = font.uses[glyph]
    fore, back = (fore_set if uses & 1 else back_set), (back_set if uses & 2 else fore_set)
    shown[row, column] = glyphs[row, column]
    shown_colors[row, column, 0], shown_colors[row, column, 1] = (back, fore) if swapped else (fore, back)
    return end, fore_set, back_set


@part
def _put_glyph(text, end, font, glyph):
    # Four bytes always, of which some are overwritten, take less time than as many as there are.
    for i in range(4):
        _put(text, end + i, font.text[np.uint64(glyph), i])
    return end + np.int64(font.lengths[np.uint64(glyph)])


@part
def _put_colors(text, end, needed, fore, back, fore_set, back_set, number):
    end = _put(text, _put(text, end, 27), 91)
    if needed & 1:
        end, fore_set = _put_color(text, end, fore, number, 30), fore
    if needed == 3:
        end = _put(text, end, 59)  # ;
    if needed & 2:
        end, back_set = _put_color(text, end, back, number, 40), back
    return _put(text, end, 109), fore_set, back_set


@part
def _put_color(text, end, code, number, base):
    """Write the parameters that set a colour; ``base`` is 30 for the foreground, 40 for the background."""
    if number == 16:
        index = code >> 24
        return _put_byte(text, end, base + index if index < 8 else base + 52 + index)
    end = _put_byte(text, end, base + 8)
    end = _put(text, _put(text, end, 59), 50 if number > 256 else 53)  # ;2 or ;5
    if number > 256:
        end = _put_byte(text, _put(text, end, 59), code >> 16 & 255)
        end = _put_byte(text, _put(text, end, 59), code >> 8 & 255)
        return _put_byte(text, _put(text, end, 59), code & 255)
    return _put_byte(text, _put(text, end, 59), code >> 24)


@part
def _put_byte(text, end, value):
    for i in range(3):
        _put(text, end + i, _DIGITS[np.uint64(value), i])
    return end + np.int64(_DIGITS[np.uint64(value), 3])
