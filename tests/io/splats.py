"""Records of ``.splat`` files made by hand for the tests."""

from __future__ import annotations

import struct


def record(
    *,
    means: tuple[float, ...] = (0.0, 0.0, 0.0),
    scales: tuple[float, ...] = (1.0, 1.0, 1.0),
    rgba: tuple[int, ...] = (255, 255, 255, 255),
    quats: tuple[int, ...] = (255, 128, 128, 128),
) -> bytes:
    """Return one splat of a ``.splat``."""
    return struct.pack("<6f8B", *means, *scales, *rgba, *quats)
