"""Frames to encode, and the parts of escape streams."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

U8 = npt.NDArray[np.uint8]


def frames(most: int = 40) -> st.SearchStrategy[U8]:
    """Random frames from 1x1 up, half of them of few colours, so that runs happen."""
    shapes = st.tuples(st.integers(1, most), st.integers(1, most), st.just(3))
    levels = st.sampled_from([0, 7, 10, 95, 99, 100, 128, 255])
    values = st.one_of(levels, st.integers(0, 255))
    return hnp.arrays(np.uint8, shapes, elements=values)


def gradient(width: int, height: int) -> U8:
    """Red to the right, green downwards, blue along the diagonal."""
    y, x = np.mgrid[0:height, 0:width]
    parts = [x * 255 // max(1, width - 1), y * 255 // max(1, height - 1), (x + y) * 255 // (width + height)]
    return np.stack(parts, axis=2).astype(np.uint8)


def textured(width: int, height: int) -> U8:
    """A gradient with a fine grain, as compressible as a frame of a scene."""
    grain = np.random.default_rng(7).normal(0, 6, (height, width, 3))
    return np.clip(gradient(width, height) * 0.7 + 30 + grain, 0, 255).astype(np.uint8)


def psnr(one: U8, other: U8) -> float:
    """Peak signal to noise ratio of two frames, in decibels."""
    error = float(np.mean((one.astype(np.float64) - other) ** 2))
    return 10 * float(np.log10(255**2 / max(error, 1e-9)))
