"""Pictures made of text cells: the best glyph and colours for each, and only the cells that changed."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tsplat.encode import cell_text, fit, quantize, tones
from tsplat.encode.cell_text import BYTES_PER_CELL, BYTES_PER_ROW, NONE, UNKNOWN
from tsplat.encode.glyphs import shape
from tsplat.encode.protocol import U8, EncodedFrame
from tsplat.encode.resample import check, resample
from tsplat.errors import OptionError

F32 = npt.NDArray[np.float32]
U32 = npt.NDArray[np.uint32]
I16 = npt.NDArray[np.int16]

COLORS = (1 << 24, 256, 16, 0)
"""How many colours a terminal may have; none where a person wants none."""

TOLERANCE = 96.0
"""Distance in RGB up to which a colour does for another at fidelity 0; nothing at 1, in proportion between."""

_RESET = b"\x1b[0m"


class Cells:
    """Encode frames as text cells of one shape.

    Parameters
    ----------
    name : {"octant", "sextant", "quadrant", "half", "half256", "braille", "ascii"}
        Shape of the cells; "half256" is half blocks in at most 256 colours.
    colors : {16777216, 256, 16, 0}
        How many colours the terminal has. With none, pixels are lit or not, by brightness.

    Raises
    ------
    OptionError
        There is no such number of colours.
    """

    divisible = True

    def __init__(self, name: str, colors: int = 1 << 24) -> None:
        if colors not in COLORS:
            raise OptionError(f"colors must be one of {', '.join(map(str, COLORS))}, got {colors}")
        self.name = name
        self.colors = min(colors, 256) if name == "half256" else colors
        self.fidelity = 1.0
        self._shape = shape(name.removesuffix("256"))
        self._search = fit.search(self._shape)
        by_pattern = self._shape.free > 0 or self._shape.background
        self._ramp: F32 | None = None if by_pattern else self._shape.lit[:, 0].copy()
        self._font = cell_text.font(self._shape, self.colors)
        self._shown: I16 = np.empty((0, 0), np.int16)
        self._shown_colors: U32 = np.empty((0, 0, 2), np.uint32)
        self._text: U8 = np.empty(0, np.uint8)

    def pixels_per_cell(self, cell_width: int, cell_height: int) -> tuple[int, int]:  # noqa: ARG002
        """Return the pixels of the shape, whatever the cell."""
        return self._shape.across, self._shape.down

    def encode(self, frame: U8, columns: int, rows: int, cell_size: tuple[int, int]) -> EncodedFrame:  # noqa: ARG002
        """Draw a frame over text cells; see `Encoder.encode`."""
        check(frame, columns, rows)
        picture = self._spread(resample(frame, columns * self._shape.across, rows * self._shape.down))
        if self._shown.shape != (rows, columns):
            self._shown = np.full((rows, columns), UNKNOWN, np.int16)
            self._shown_colors = np.zeros((rows, columns, 2), np.uint32)
        glyphs, colors = self._fit(picture, rows, columns)
        slack = round((TOLERANCE * (1.0 - min(max(self.fidelity, 0.0), 1.0))) ** 2)
        # With no slack it does nothing, but is compiled before the first frame that needs it.
        place = picture, self._shape.across, self._shape.down, self._shape.lit
        quantize.keep(*place, np.float32(slack), glyphs, colors, self._shown, self._shown_colors)
        draw = self._write(
            glyphs,
            colors,
            self._shown,
            self._shown_colors,
            slack=slack,
            around=(_RESET + b"\x1b7", b"\x1b8" + _RESET),
        )
        return EncodedFrame(b"", draw)

    def lines(self, frame: U8) -> list[bytes]:
        """Return one row of cells after another for printing: no cursor moves, colours reset at each end.

        Parameters
        ----------
        frame : ndarray of uint8, [H, W, 3]
            One pixel each; what is missing in the last cells repeats the last pixels, except that under an odd H
            of half blocks lies the default background.

        Returns
        -------
        list of bytes
            Each ends with a line feed; without colours there is nothing else in it than glyphs.
        """
        check(frame, 1, 1)
        height, width = frame.shape[:2]
        rows, columns = -(-height // self._shape.down), -(-width // self._shape.across)
        missing = rows * self._shape.down - height, columns * self._shape.across - width
        picture = np.pad(frame, ((0, missing[0]), (0, missing[1]), (0, 0)), mode="edge")
        glyphs, colors = self._fit(self._spread(picture), rows, columns)
        if missing[0] and self.name.startswith("half"):
            colors[-1, :, 1] = NONE
        unknown = np.full((rows, columns), UNKNOWN, np.int16)
        shown_colors = np.zeros((rows, columns, 2), np.uint32)
        end = b"\n" if self.colors == 0 else _RESET + b"\n"
        return [
            self._write(glyphs[at], colors[at], unknown[at], shown_colors[at], slack=0, around=(b"", end))
            for at in (slice(row, row + 1) for row in range(rows))
        ]

    def forget(self, cells: npt.NDArray[np.bool_] | None) -> None:
        """Send these cells with the next frame; see `Encoder.forget`."""
        if cells is None or cells.shape != self._shown.shape:
            self._shown[:] = UNKNOWN
        else:
            self._shown[cells] = UNKNOWN

    def abandon(self) -> bytes:
        """Return what sets the cursor and the colours back; see `Encoder.abandon`."""
        self.forget(None)
        return b"\x1b8" + _RESET

    def clear(self) -> bytes:
        """Return nothing: text is overwritten, not removed."""
        self.forget(None)
        return b""

    def _spread(self, picture: U8) -> U8:
        """Return what is drawn: the picture, or one in which neighbours share out what 16 colours lack."""
        picture = np.ascontiguousarray(picture)  # kernels are compiled again for others
        if self.colors != 16 or self._ramp is not None:
            return picture
        result = np.empty_like(picture)
        tones.spread(picture, result)
        return result

    def _fit(self, picture: U8, rows: int, columns: int) -> tuple[U8, U32]:
        """Return the number of the glyph, and the codes of the colours, of each cell."""
        glyphs = np.zeros((rows, columns), np.uint8)
        colors = np.full((rows, columns, 2), NONE, np.uint32)
        place = picture, self._shape.across, self._shape.down
        if self.colors == 0:
            if self._ramp is None:
                tones.dither(*place, glyphs)
            else:
                tones.grade(*place, self._ramp, glyphs)
            return glyphs, colors
        if self._ramp is None:
            fit.split(*place, self._search, glyphs, colors)
        else:
            tones.shade(*place, self._ramp, glyphs, colors)
        if self.colors <= 256:
            quantize.quantize(*place, self.colors, self._search, colors, glyphs)
        return glyphs, colors

    def _write(
        self,
        glyphs: U8,
        colors: U32,
        shown: I16,
        shown_colors: U32,
        *,
        slack: int,
        around: tuple[bytes, bytes],
    ) -> bytes:
        """Return the cells that changed, with something before and behind them if there are any."""
        rows, columns = glyphs.shape
        before, behind = (np.frombuffer(part, np.uint8) for part in around)
        room = len(before) + rows * (columns * BYTES_PER_CELL + BYTES_PER_ROW) + len(behind)
        if len(self._text) < room:
            # Kept, for it takes longer to get from the system than to fill.
            self._text = np.empty(room, np.uint8)
        self._text[: len(before)] = before
        end = cell_text.write(glyphs, colors, shown, shown_colors, self._font, slack, self._text[len(before) :])
        if end == 0:
            return b""
        end += len(before)
        self._text[end : end + len(behind)] = behind
        return self._text[: end + len(behind)].tobytes()
