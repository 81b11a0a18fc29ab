"""iTerm2's inline images: each frame a JPEG file that the terminal stretches over the cells.

Source: https://iterm2.com/documentation-images.html. WezTerm and mlterm take the same.
"""

from __future__ import annotations

import binascii
import io

import numpy as np
import numpy.typing as npt

from tsplat.encode.protocol import FALLBACK_CELL, U8, EncodedFrame
from tsplat.encode.resample import check

_BEST_QUALITY, _WORST_QUALITY = 92, 30
"""JPEG qualities at fidelity 1 and 0."""

_ALL_CHROMA, _QUARTER_CHROMA = 0, 2
"""Pillow's numbers for colours in every pixel, and once for four pixels."""


class ITerm2:
    """Encode frames as inline images of iTerm2's protocol.

    A JPEG never shows quite the pixels it was made from, not even at fidelity 1. A picture goes in one escape
    sequence, which every such terminal takes up to a megabyte.
    """

    name = "iterm2"
    divisible = False

    def __init__(self) -> None:
        self.fidelity = 1.0

    def pixels_per_cell(self, cell_width: int, cell_height: int) -> tuple[int, int]:
        """Return the size of the cell."""
        return (cell_width, cell_height) if cell_width and cell_height else FALLBACK_CELL

    def encode(self, frame: U8, columns: int, rows: int, cell_size: tuple[int, int]) -> EncodedFrame:  # noqa: ARG002
        """Draw a frame over text cells; see `Encoder.encode`. The terminal stretches it."""
        check(frame, columns, rows)
        picture = jpeg(frame, min(max(self.fidelity, 0.0), 1.0))
        keys = b"inline=1;size=%d;width=%d;height=%d;preserveAspectRatio=0;doNotMoveCursor=1" % (
            len(picture), columns, rows
        )  # fmt: skip
        text = binascii.b2a_base64(picture, newline=False)
        # Not every terminal knows doNotMoveCursor; the cursor returns to where it was.
        return EncodedFrame(b"", b"\x1b7\x1b]1337;File=" + keys + b":" + text + b"\x07\x1b8")

    def forget(self, cells: npt.NDArray[np.bool_] | None) -> None:
        """Do nothing: every frame is drawn whole."""

    def abandon(self) -> bytes:
        """Return nothing: each piece is a picture of its own, and complete."""
        return b""

    def clear(self) -> bytes:
        """Return nothing: text written over the picture replaces it."""
        return b""


def jpeg(frame: U8, fidelity: float) -> bytes:
    """Return a frame as a JPEG file, better and larger the closer ``fidelity`` is to 1."""
    from PIL import Image

    quality = round(_WORST_QUALITY + (_BEST_QUALITY - _WORST_QUALITY) * fidelity)
    chroma = _ALL_CHROMA if fidelity == 1.0 else _QUARTER_CHROMA
    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(frame)).save(file, "JPEG", quality=quality, subsampling=chroma)
    return file.getvalue()
