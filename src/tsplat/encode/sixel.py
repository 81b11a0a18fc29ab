"""Sixel graphics: bands of six pixel rows, one layer of bits for each colour in the band.

Source: DEC STD 070, chapter 9; https://vt100.net/docs/vt3xx-gp/chapter14.html.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tsplat._jit import kernel, part
from tsplat.encode.adaptive_palette import AdaptivePalette
from tsplat.encode.protocol import FALLBACK_CELL, U8, EncodedFrame
from tsplat.encode.resample import check, resample
from tsplat.errors import OptionError

I32 = npt.NDArray[np.int32]

_BYTES_PER_RUN = 16
"""Most bytes one run needs: a gap before it, "!16384?", three sixels, and a share of "#255" and "$"."""


class Quality(NamedTuple):
    """What a fidelity means: at most so many colours, and how far off a pixel's colour may be for longer runs."""

    least_fidelity: float
    colors: int
    tolerance: int


_QUALITIES = (
    Quality(0.9, 256, 0),
    Quality(0.7, 128, 10),
    Quality(0.5, 64, 14),
    Quality(0.3, 64, 20),
    Quality(-math.inf, 32, 30),
)
"""Best first. Each takes about three quarters of the bytes of the one before it."""


class Tile(NamedTuple):
    """A part of a frame that is one picture, in text cells."""

    column: int
    row: int
    columns: int
    rows: int

    def within(self, pixels: U8, width: int, height: int) -> U8:
        """Return the pixels of this part, where a cell has ``width`` x ``height`` of them."""
        top, left = self.row * height, self.column * width
        return pixels[top : top + self.rows * height, left : left + self.columns * width]


class Sixel:
    """Encode frames in sixel, with up to 256 colours of their own.

    The last text row must stay free: most terminals scroll when a picture reaches the bottom.

    Parameters
    ----------
    dither : bool
        Mix colours in a pattern where the palette has none that is near: no bands of colour, up to half as many
        bytes again. Below full fidelity there is none: it would shimmer, and break the runs.
    max_size : tuple of 2 ints, optional
        Most pixels across and down that the terminal takes in one picture, such as xterm's 1000 x 1000. What is
        larger is drawn as several, side by side and one below the other, each of whole cells.

    Raises
    ------
    OptionError
        ``max_size`` has no room for one band of six rows.
    """

    name = "sixel"
    divisible = False

    def __init__(self, dither: bool = False, max_size: tuple[int, int] | None = None) -> None:
        if max_size is not None and (max_size[0] < 1 or max_size[1] < 6):
            raise OptionError(f"max_size must be at least 1 x 6 pixels, got {max_size[0]} x {max_size[1]}")
        self.fidelity = 1.0
        self._dither, self._max_size = dither, max_size
        # One for each number of colours, so that coming to rest does not make a palette anew.
        self._palettes: dict[int, AdaptivePalette] = {}

    def pixels_per_cell(self, cell_width: int, cell_height: int) -> tuple[int, int]:
        """Return the size of the cell."""
        return (cell_width, cell_height) if cell_width and cell_height else FALLBACK_CELL

    def tiles(self, columns: int, rows: int, cell_size: tuple[int, int]) -> list[Tile]:
        """Return the pictures that `encode` draws over these cells; none is larger than the terminal takes."""
        width, height = self.pixels_per_cell(*cell_size)
        if self._max_size is None:
            return [Tile(0, 0, columns, rows)]
        # The last band is sent whole, and some terminals count its empty rows.
        across = max(1, self._max_size[0] // width)
        down = max(1, self._max_size[1] // 6 * 6 // height)
        return [
            Tile(column, row, min(across, columns - column), min(down, rows - row))
            for row in range(0, rows, down)
            for column in range(0, columns, across)
        ]

    def encode(self, frame: U8, columns: int, rows: int, cell_size: tuple[int, int]) -> EncodedFrame:
        """Draw a frame over text cells; see `Encoder.encode`."""
        check(frame, columns, rows)
        width, height = self.pixels_per_cell(*cell_size)
        picture = np.ascontiguousarray(resample(frame, columns * width, rows * height))
        quality = next(quality for quality in _QUALITIES if self.fidelity >= quality.least_fidelity)
        palette = self._palettes.setdefault(quality.colors, AdaptivePalette(quality.colors))
        palette.fit(picture)
        dither = self._dither and quality is _QUALITIES[0]
        indices = palette.indices(picture, tolerance=quality.tolerance, dither=dither)
        drawn = b"\x1b8".join(
            _moved(tile) + _picture(tile.within(indices, width, height), palette.registers)
            for tile in self.tiles(columns, rows, cell_size)
        )
        # The cursor returns to where it was.
        return EncodedFrame(b"", b"\x1b7" + drawn + b"\x1b8")

    def forget(self, cells: npt.NDArray[np.bool_] | None) -> None:
        """Do nothing: every frame is drawn whole."""

    def abandon(self) -> bytes:
        """Return nothing: each piece is a picture of its own, and complete."""
        return b""

    def clear(self) -> bytes:
        """Return nothing: text written over the picture replaces it."""
        return b""


def _moved(tile: Tile) -> bytes:
    """Return what moves the cursor to a tile, from where the first one is."""
    down = b"\x1b[%dB" % tile.row if tile.row else b""
    return down + (b"\x1b[%dC" % tile.column if tile.column else b"")


def _picture(indices: U8, registers: bytes) -> bytes:
    # Raster attributes: square pixels, width, height.
    height, width = indices.shape
    start = b'\x1bP0;1q"1;1;%d;%d' % (width, height)
    return start + registers + _bands(np.ascontiguousarray(indices)) + b"\x1b\\"


def _bands(indices: U8) -> bytes:
    height, width = indices.shape
    text = np.empty(-(-height // 6) * 6 * width * _BYTES_PER_RUN, np.uint8)
    return text[: _encode(indices, _lists(width), text)].tobytes()


class _Lists(NamedTuple):
    """The columns that each colour of a band has, from left to right, as linked lists; -1 for none.

    Attributes
    ----------
    first, last : ndarray of int32, [256]
        Entries of each colour.
    column, following, bits : ndarray, [6 * width]
        Of each entry: where it is, the next entry, the pixels of the column that have the colour.
    colors : ndarray of int32, [256]
        Those that the band has.
    """

    first: I32
    last: I32
    column: I32
    following: I32
    bits: U8
    colors: I32


def _lists(width: int) -> _Lists:
    none, room = np.full((3, 256), -1, np.int32), np.empty((2, 6 * width), np.int32)
    return _Lists(none[0], none[1], room[0], room[1], np.empty(6 * width, np.uint8), none[2])


@part
def _put_number(text: U8, end: int, number: int) -> int:
    scale = 1
    while scale * 10 <= number:
        scale *= 10
    while scale > 0:
        text[end] = 48 + number // scale % 10
        end += 1
        scale //= 10
    return end


@part
def _put_run(text: U8, end: int, length: int, bits: int) -> int:
    """Write ``length`` sixels of the same bits; from four on, a count is shorter."""
    if length > 3:
        text[end] = 33  # !
        end = _put_number(text, end + 1, length)
        length = 1
    for _ in range(length):
        text[end] = 63 + bits
        end += 1
    return end


@part
def _put_columns(text: U8, end: int, entry: int, column: I32, following: I32, bits: U8) -> int:
    """Write one colour's sixels from the list that begins at ``entry``, with gaps between them."""
    x = 0
    while entry >= 0:
        end = _put_run(text, end, column[entry] - x, 0)
        x = start = column[entry]
        pattern = bits[entry]
        while entry >= 0 and column[entry] == x and bits[entry] == pattern:
            x += 1
            entry = following[entry]
        end = _put_run(text, end, x - start, pattern)
    return end


@kernel
def _encode(indices: U8, lists: _Lists, text: U8) -> int:
    """Write all bands to ``text``; return how many bytes."""
    height, width = indices.shape
    first, last, column, following, bits, colors = lists
    end = 0
    for top in range(0, height, 6):
        used = entries = 0
        for x in range(width):
            for row in range(min(6, height - top)):
                color = indices[top + row, x]
                entry = last[color]
                if entry >= 0 and column[entry] == x:
                    bits[entry] |= 1 << row
                    continue
                if entry < 0:
                    first[color], colors[used] = entries, color
                    used += 1
                else:
                    following[entry] = entries
                column[entries], bits[entries], following[entries] = x, 1 << row, -1
                last[color] = entries
                entries += 1
        for k in range(used):
            color = colors[k]
            text[end] = 35  # #
            end = _put_columns(text, _put_number(text, end + 1, color), first[color], column, following, bits)
            text[end] = 36 if k < used - 1 else 45  # $ goes back to the first column, - down to the next band
            end += 1
            first[color] = last[color] = -1
    return end
