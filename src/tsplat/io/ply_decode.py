"""Rows of a splat PLY to the arrays of `Gaussians`: exp and sigmoid; what those would hide becomes nan."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt

from tsplat.io.arrays import F32, Arrays
from tsplat.io.finish import mark_finite, mend, scores
from tsplat.io.ply_columns import Columns
from tsplat.io.threads import on_threads

Mask = npt.NDArray[np.bool_]
Piece = tuple[slice, F32]
"""Which rows of the arrays, and the columns of a file for them."""

RAW_TOLERANCE = 1e-3
"""Activated opacities may leave [0, 1] this far by rounding; beyond it they were something else."""


class Decoder:
    """Turns pieces of the file into arrays, and counts what it mended on the way.

    Parameters
    ----------
    columns : dict of str to ndarray of intp
        As `tsplat.io.ply_columns.find_columns` returned them.
    raw_opacity : bool
        Whether opacities are activated already.

    Attributes
    ----------
    clamped : list of int
        Activated opacities that lay clearly outside [0, 1], by piece.
    """

    def __init__(self, columns: Columns, raw_opacity: bool) -> None:
        self._columns, self._raw_opacity = columns, raw_opacity
        self._k = len(columns["sh"]) // 3
        self.clamped: list[int] = []

    def gather(self, pieces: Iterable[Piece], count: int) -> Arrays:
        """Decode pieces of ``count`` splats where they will stay."""
        arrays = Arrays.empty(count, self._k)
        on_threads(lambda piece: self._decode(piece[1], arrays.part(piece[0])), pieces)
        return arrays

    def score(self, pieces: Iterable[Piece], count: int) -> F32:
        """Return what `most_important` chooses by, -1 for splats that cannot be drawn; float32 [count]."""
        found = np.empty(count, np.float32)

        def score_piece(piece: Piece) -> None:
            rows, values = piece
            part = Arrays.empty(len(values), self._k)
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
        good = np.ones(len(values), np.bool_)
        for name, columns in self._columns.items():
            flat = getattr(out, name).reshape(len(values), len(columns))
            np.take(values, columns, axis=1, out=flat, mode="clip")
        # Of these, exp and sigmoid make numbers again.
        mark_finite(out.scales, good)
        mark_finite(out.opacities, good)
        if not good.all():
            out.means[~good] = np.nan
        np.exp(out.scales, out=out.scales)
        self._activate(out.opacities, good)

    def _activate(self, opacities: F32, good: Mask) -> None:
        if self._raw_opacity:
            outside = (opacities < -RAW_TOLERANCE) | (opacities > 1.0 + RAW_TOLERANCE)
            self.clamped.append(int(np.count_nonzero(outside & good)))
            np.clip(opacities, 0.0, 1.0, out=opacities)
        else:
            np.negative(opacities, out=opacities)
            np.exp(opacities, out=opacities)
            opacities += 1.0
            np.reciprocal(opacities, out=opacities)
