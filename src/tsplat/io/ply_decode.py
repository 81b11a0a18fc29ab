"""Rows of a PLY to the arrays of `Gaussians`, activated."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt

from tsplat.io.activation import Activation
from tsplat.io.arrays import F32, Arrays
from tsplat.io.finish import mend, scores
from tsplat.io.ply_columns import Columns
from tsplat.io.threads import on_threads

Mask = npt.NDArray[np.bool_]
Piece = tuple[slice, F32]
"""Which rows of the arrays, and the columns of a file for them."""


class Decoder:
    """Turns pieces of the file into arrays.

    Parameters
    ----------
    columns : Columns
        As `tsplat.io.ply_columns.find_columns` returned them. What they do not have is left as it is.
    activation : Activation
        For scales and opacities.
    """

    def __init__(self, columns: Columns, activation: Activation) -> None:
        self._columns, self.activation = columns, activation

    def gather(self, pieces: Iterable[Piece], count: int) -> Arrays:
        """Decode pieces of ``count`` splats where they will stay."""
        arrays = Arrays.empty(count, self._columns.k)
        on_threads(lambda piece: self._decode(piece[1], arrays.part(piece[0])), pieces)
        return arrays

    def score(self, pieces: Iterable[Piece], count: int) -> F32:
        """Return what `most_important` chooses by, -1 for splats that cannot be drawn; float32 [count]."""
        found = np.empty(count, np.float32)

        def score_piece(piece: Piece) -> None:
            rows, values = piece
            part = Arrays.empty(len(values), self._columns.k)
            self._decode(values, part)
            found[rows] = scores(part, mend(part))

        on_threads(score_piece, pieces)
        return found

    def pick(self, pieces: Iterable[Piece], chosen: Mask) -> Arrays:
        """Decode the ``chosen`` splats only."""

        def picked() -> Iterator[Piece]:
            kept = 0
            for rows, values in pieces:
                wanted = values[chosen[rows]]
                yield slice(kept, kept + len(wanted)), wanted
                kept += len(wanted)

        return self.gather(picked(), int(np.count_nonzero(chosen)))

    def _decode(self, values: F32, out: Arrays) -> None:
        for name, columns in self._columns.arrays.items():
            array = getattr(out, name)
            flat = array.reshape(len(array), math.prod(array.shape[1:]))
            np.take(values, columns, axis=1, out=flat[:, : len(columns)], mode="clip")
        if self._columns.are_points:
            return
        lengths = out.scales[:, : len(self._columns.arrays["scales"])]
        self.activation.scales(lengths)
        out.scales[:, lengths.shape[1] :] = 0.0  # the thickness of 2DGS
        self.activation.opacities(out.opacities)
        if self._columns.filter_3d is not None:
            _widen(out, values[:, self._columns.filter_3d])


def _widen(out: Arrays, filters: F32) -> None:
    """Apply Mip-Splatting's 3D filter, as its training did before it drew (Yu et al. 2024, eq. 7).

    Scales grow, and opacities shrink by as much as the volume grew.
    """
    wider = np.hypot(out.scales, filters[:, None])
    shares = np.divide(out.scales, wider, out=np.ones_like(wider), where=wider != 0.0)
    out.scales[:] = wider
    np.multiply(out.opacities, shares.prod(axis=1), out=out.opacities)
