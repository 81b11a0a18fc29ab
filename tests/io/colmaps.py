"""Sparse points made by hand as COLMAP writes them, each seen a few times."""

from __future__ import annotations

import struct
from collections.abc import Sequence

Point = tuple[float, ...]
"""x, y, z, red, green, blue."""


def colmap_binary(points: Sequence[Point]) -> bytes:
    """Return a points3D.bin, in which a point is seen once more than the one before."""
    parts = [struct.pack("<Q", len(points))]
    for number, (x, y, z, *rgb) in enumerate(points):
        parts.append(struct.pack("<Q3d3BdQ", number + 1, x, y, z, *map(int, rgb), 0.5, number))
        parts += [struct.pack("<2i", image, 7) for image in range(number)]
    return b"".join(parts)


def colmap_text(points: Sequence[Point]) -> bytes:
    """Return a points3D.txt of the same."""
    lines = [
        "# 3D point list with one line of data per point:",
        "#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)",
        f"# Number of points: {len(points)}, mean track length: 2.5",
    ]
    for number, (x, y, z, *rgb) in enumerate(points):
        seen = " ".join(f"{image} 7" for image in range(number))
        lines.append(" ".join([str(number + 1), *map(repr, (x, y, z)), *map(str, map(int, rgb)), "0.5", seen]))
    return "\n".join([*lines, ""]).encode("ascii")
