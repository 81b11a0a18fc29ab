"""The axes that an SPZ is in, and how its splats get from there to right, down, front.

Source: `CoordinateSystem` of github.com/nianticlabs/spz: where x, y and z point, in this order.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tsplat.io.arrays import Arrays, chunks
from tsplat.io.threads import on_threads
from tsplat.sh_rotation import rotate_sh

F64 = npt.NDArray[np.float64]

USUAL = "rub"
"""The axes by the specification."""

DIRECTIONS = {
    "r": (1.0, 0.0, 0.0), "d": (0.0, 1.0, 0.0), "f": (0.0, 0.0, 1.0),
    "l": (-1.0, 0.0, 0.0), "u": (0.0, -1.0, 0.0), "b": (0.0, 0.0, -1.0),
}  # fmt: skip


def axes_of(frame: str) -> F64:
    """Return the matrix from the axes of these names to right, down, front."""
    return np.array([DIRECTIONS[letter] for letter in frame]).T


def reframe(arrays: Arrays, frame: str) -> None:
    """Turn, in place, what was decoded as if it were in the `USUAL` axes and is in others.

    Numbers only change places and signs, but for harmonics of degree 2 and more where y and z change places. In
    left-handed axes the scene is mirrored.
    """
    matrix = axes_of(frame) @ axes_of(USUAL).T
    order = np.abs(matrix).argmax(axis=1)
    signs = matrix[np.arange(3), order].astype(np.float32)
    # The axis that a quat turns about is mirrored, and so is the sense of the turn.
    quat_signs = signs * np.float32(round(np.linalg.det(matrix)))

    def reframe_chunk(rows: slice) -> None:
        part = arrays.part(rows)
        part.means[:] = part.means[:, order] * signs
        part.scales[:] = part.scales[:, order]
        part.quats[:, 1:] = part.quats[:, 1:][:, order] * quat_signs
        part.sh[:] = rotate_sh(part.sh, matrix)

    on_threads(reframe_chunk, chunks(len(arrays.means)))
