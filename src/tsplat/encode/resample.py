"""Frames of any size, made the size an encoder draws."""

from __future__ import annotations

import numpy as np

from tsplat.encode.protocol import U8
from tsplat.errors import OptionError


def check(frame: U8, columns: int, rows: int) -> None:
    """Raise OptionError unless this is a frame, uint8 [H, W, 3], and there are cells to draw it on."""
    if frame.dtype != np.uint8 or frame.ndim != 3 or frame.shape[2] != 3 or frame.size == 0:
        raise OptionError(f"frame must be uint8 [H, W, 3], not empty, got {frame.dtype} {list(frame.shape)}")
    if columns < 1 or rows < 1:
        raise OptionError(f"columns and rows must be at least 1, got {columns} x {rows}")


def resample(frame: U8, width: int, height: int) -> U8:
    """Return a frame stretched to ``width`` x ``height``: by area where it shrinks, by nearest where it grows."""
    if frame.shape[:2] == (height, width):
        return frame
    from PIL import Image  # 30 ms that a frame of the right size does not pay

    # Pillow's box filter is the pixel's area when it shrinks, and at most one pixel wide when it grows.
    picture = Image.fromarray(np.ascontiguousarray(frame))
    return np.asarray(picture.resize((width, height), Image.Resampling.BOX))
