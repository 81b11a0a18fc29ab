"""Rows of a splat PLY to `Gaussians`: sigmoid, exp, unit quats, and broken splats left out."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from tsplat.importance import importance, most_important
from tsplat.io.ply_columns import Columns
from tsplat.scene import Gaussians

F32 = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]
Arrays = dict[str, F32]

RAW_TOLERANCE = 1e-3
"""Activated opacities may leave [0, 1] this far by rounding; beyond it they were something else."""


class Decoder:
    """Turns chunks of rows into Gaussians, and counts what it dropped or mended on the way.

    Parameters
    ----------
    columns : dict of str to ndarray of intp
        As `tsplat.io.ply_columns.find_columns` returned them.
    chunk_rows : int
        Rows in a chunk at most.
    raw_opacity : bool
        Whether opacities are activated already.

    Attributes
    ----------
    dropped : int
        Splats left out for a value that is nan or inf, or a quat that is zero.
    clamped : int
        Activated opacities that lay clearly outside [0, 1].
    """

    def __init__(self, columns: Columns, chunk_rows: int, raw_opacity: bool) -> None:
        self._columns, self._chunk_rows, self._raw_opacity = columns, chunk_rows, raw_opacity
        self.dropped = self.clamped = 0

    def choose(self, chunks: Iterable[F32], count: int, limit: int) -> Mask:
        """Mark the ``limit`` splats of ``count`` that matter most; bool [count]."""
        arrays, scores, at = self._allocate(self._chunk_rows), np.empty(count, np.float32), 0
        for rows in chunks:
            part = {field: array[: len(rows)] for field, array in arrays.items()}
            valid = self._decode(rows, part)
            score = np.full(len(rows), -1.0, np.float32)
            score[valid] = importance(part["scales"][valid], part["opacities"][valid, 0])
            scores[at : at + len(rows)] = score
            at += len(rows)
        return most_important(scores, limit)

    def gather(self, chunks: Iterable[F32], count: int, chosen: Mask | None = None) -> Gaussians:
        """Decode every chunk and keep the ``chosen`` splats, by default all that are valid.

        The arrays are allocated once, for all ``count`` splats that may come, and cut at the end:
        each chunk is decoded where it will stay.
        """
        arrays = self._allocate(count if chosen is None else count + self._chunk_rows)
        counts = self.dropped, self.clamped
        kept = first = 0
        for rows in chunks:
            n = len(rows)
            part = {field: array[kept : kept + n] for field, array in arrays.items()}
            valid = self._decode(rows, part)
            keep = valid if chosen is None else chosen[first : first + n]
            stay = int(np.count_nonzero(keep))
            if stay < n:
                for array in part.values():
                    array[:stay] = array[keep]
            kept, first = kept + stay, first + n
        if chosen is not None:
            self.dropped, self.clamped = counts  # these rows were counted when they were chosen
        part = {}  # no view of the arrays may outlive their resize
        for array in arrays.values():
            array.resize((kept, *array.shape[1:]), refcheck=False)
        k = arrays["sh"].shape[1] // 3
        return Gaussians(
            arrays["means"],
            arrays["quats"],
            arrays["scales"],
            arrays["opacities"].reshape(kept),
            arrays["sh"].reshape(kept, k, 3),
        )

    def _allocate(self, n: int) -> Arrays:
        return {field: np.empty((n, len(columns)), np.float32) for field, columns in self._columns.items()}

    def _decode(self, rows: F32, out: Arrays) -> Mask:
        # Fills `out` and returns which rows are splats; the others hold anything.
        with np.errstate(all="ignore"):
            valid = np.ones(len(rows), np.bool_)
            for field, columns in self._columns.items():
                np.take(rows, columns, axis=1, out=out[field], mode="clip")
                _mark_finite(out[field], valid)
            np.exp(out["scales"], out=out["scales"])
            _mark_finite(out["scales"], valid)
            norms = np.sqrt(np.einsum("ij,ij->i", out["quats"], out["quats"], dtype=np.float64))
            valid &= norms > 0.0
            np.divide(out["quats"], norms[:, None], out=out["quats"], casting="same_kind")
            self._activate(out["opacities"], valid)
        self.dropped += len(rows) - int(np.count_nonzero(valid))
        return valid

    def _activate(self, opacities: F32, valid: Mask) -> None:
        if self._raw_opacity:
            outside = (opacities[:, 0] < -RAW_TOLERANCE) | (opacities[:, 0] > 1.0 + RAW_TOLERANCE)
            self.clamped += int(np.count_nonzero(outside & valid))
            np.clip(opacities, 0.0, 1.0, out=opacities)
        else:
            np.exp(-opacities, out=opacities)
            opacities += 1.0
            np.reciprocal(opacities, out=opacities)


def _mark_finite(array: F32, valid: Mask) -> None:
    # One pass where all is well: a nan or inf anywhere shows in the sum. An overflowing sum of
    # finite values only costs the exact test.
    if not math.isfinite(array.sum()):
        valid &= np.isfinite(array).all(axis=1)
