"""All levels of a streamed SOG: what lod-meta.json says of them, then the splats, a file at a time."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tsplat.errors import LoadError
from tsplat.io.arrays import Arrays
from tsplat.io.finish import keep, mend_all
from tsplat.io.sog import Scene, check_paid, find_piece, read_scene
from tsplat.io.sog_files import Folder
from tsplat.io.sog_json import Fields, read_fields
from tsplat.io.sog_lod import Lod, is_streamed, leaves_and_pieces

I64 = npt.NDArray[np.int64]

SUFFIX = ".json"


@dataclass(frozen=True, eq=False, slots=True)
class Levels:
    """A streamed scene of which the headers were read.

    Runs are splats that lie side by side in a file; they are numbered in the order of the files, and within one as
    they lie. A level of the scene is loaded in that order.

    Attributes
    ----------
    path : Path
        Its lod-meta.json.
    files : list of Scene
        With what is wanted of each.
    counts : list of ndarray of int64
        Of each file, how many splats its runs have.
    leaves : list of list of int
        The runs of each leaf, which stand for one another, the coarsest first.
    """

    path: Path
    files: list[Scene]
    counts: list[I64]
    leaves: list[list[int]]

    @property
    def coefficients(self) -> int:
        """How many coefficients a colour has, the first one included."""
        return max(file.k for file in self.files)

    @property
    def antialiased(self) -> bool:
        """As in `Gaussians`."""
        return all(file.meta.antialiased for file in self.files)

    def read(self, number: int, progress: Callable[[float], None] = lambda _: None) -> tuple[Arrays, I64]:
        """Return the splats of a file but for those that cannot be drawn, and one more that nobody sees.

        And where its runs begin, and the last one ends.
        """
        file, counts = self.files[number], self.counts[number]
        arrays = Arrays.empty(file.kept + 1, self.coefficients)
        finite = read_scene(file, arrays.part(slice(0, file.kept)), progress)
        for array, value in zip(arrays, (0.0, 1.0, 1.0, 0.0, 0.0), strict=True):
            array[-1] = value
        good = np.ones(len(arrays.means), np.bool_) if finite else mend_all(arrays)
        ends = np.concatenate(([0], np.cumsum(good)))[np.concatenate(([0], np.cumsum(counts)))]
        return Arrays(*(keep(array, good) for array in arrays)), ends


def is_streamed_file(path: Path) -> bool:
    """Tell whether a file is a lod-meta.json; what cannot be read is none."""
    if path.suffix.lower() != SUFFIX or not path.is_file():
        return False
    with suppress(LoadError, OSError):
        return is_streamed(_fields(path))
    return False


def open_levels(path: Path) -> Levels:
    """Read lod-meta.json, and the header of every file that it names.

    Raises
    ------
    LoadError
        It is another file.
    CorruptFileError
        They contradict each other, themselves or their sizes.
    OSError
        A file cannot be read.
    """
    fields = _fields(path)
    if not is_streamed(fields):
        raise LoadError(path, "is no lod-meta.json, which has a tree and filenames; load it")
    leaves, pieces = leaves_and_pieces(fields)
    files = [find_piece(path.parent, fields, piece) for piece in pieces]
    check_paid(path, files)
    numbers: dict[Lod, int] = {}
    counts = []
    for piece, file in zip(pieces, files, strict=True):
        runs = [Lod(piece.name, 0, None)] if piece.runs is None else [Lod(piece.name, *run) for run in piece.runs]
        numbers |= {run: len(numbers) + place for place, run in enumerate(runs)}
        counts.append(np.array([file.meta.count if run.count is None else run.count for run in runs]))
    return Levels(path, files, counts, [[numbers[lod] for lod in leaf] for leaf in leaves])


def _fields(path: Path) -> Fields:
    return read_fields(Folder(path), path.name)
