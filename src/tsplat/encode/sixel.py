"""Sixel graphics: bands of six pixel rows, one layer of bits for each colour in the band.

Source: DEC STD 070, chapter 9; https://vt100.net/docs/vt3xx-gp/chapter14.html.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tsplat._jit import kernel
from tsplat.encode.adaptive_palette import AdaptivePalette
from tsplat.encode.protocol import FALLBACK_CELL, U8, EncodedFrame
from tsplat.encode.resample import check, resample

I32 = npt.NDArray[np.int32]

_BYTES_PER_RUN = 16
"""Most bytes one run needs: a gap before it, "!16384?", three sixels, and a share of "#255" and "$"."""


class Sixel:
    """Encode frames in sixel, with 256 colours of their own.

    The last text row must stay free: most terminals scroll when a picture reaches the bottom.
    """

    name = "sixel"

    def __init__(self) -> None:
        self._palette = AdaptivePalette()
        self.fidelity = 1.0

    divisible = False

    def forget(self, cells: object) -> None:
        pass

    def abandon(self) -> bytes:
        """Return nothing: every piece is a picture of its own."""
        return b""

    def pixels_per_cell(self, cell_width: int, cell_height: int) -> tuple[int, int]:
        """Return the size of the cell."""
        return (cell_width, cell_height) if cell_width and cell_height else FALLBACK_CELL

    def encode(self, frame: U8, columns: int, rows: int, cell_size: tuple[int, int]) -> EncodedFrame:
        """Draw a frame over text cells; see `Encoder.encode`."""
        check(frame, columns, rows)
        width, height = self.pixels_per_cell(*cell_size)
        picture = np.ascontiguousarray(resample(frame, columns * width, rows * height))
        index_from_bin = self._palette.fit(picture)
        # Raster attributes: square pixels, width, height. The cursor returns to where it was.
        start = b'\x1b7\x1bP0;1q"1;1;%d;%d' % (columns * width, rows * height)
        return EncodedFrame(
            b"", start + self._palette.registers + _bands(picture, index_from_bin) + b"\x1b\\\x1b8"
        )

    def clear(self) -> bytes:
        """Return nothing: text written over the picture replaces it."""
        return b""


def _bands(picture: U8, index_from_bin: U8) -> bytes:
    height, width = picture.shape[:2]
    text = np.empty(-(-height // 6) * 6 * width * _BYTES_PER_RUN, np.uint8)
    return text[: _encode(picture, index_from_bin, text)].tobytes()


@kernel
def _put_number(text: U8, end: int, number: int) -> int:
    scale = 1
    while scale * 10 <= number:
        scale *= 10
    while scale > 0:
        text[end] = 48 + number // scale % 10
        end += 1
        scale //= 10
    return end


@kernel
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


@kernel
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
def _encode(picture: U8, index_from_bin: U8, text: U8) -> int:
    """Write all bands to ``text``; return how many bytes."""
    height, width = picture.shape[:2]
    # The columns that each colour of a band has, from left to right, as linked lists.
    first, last = np.full(256, -1, np.int32), np.full(256, -1, np.int32)
    column, following = np.empty(6 * width, np.int32), np.empty(6 * width, np.int32)
    bits, colors = np.empty(6 * width, np.uint8), np.empty(256, np.int32)
    end = 0
    for top in range(0, height, 6):
        used = entries = 0
        for x in range(width):
            for row in range(min(6, height - top)):
                red, green, blue = (
                    int(picture[top + row, x, 0]),
                    int(picture[top + row, x, 1]),
                    int(picture[top + row, x, 2]),
                )
                color = index_from_bin[(red >> 3) << 10 | (green >> 3) << 5 | blue >> 3]
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
