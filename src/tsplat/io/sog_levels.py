"""All levels of a streamed SOG: what lod-meta.json says of them, then the splats, a file at a time.

Where files come from a URL, they do when they are read.
"""

from __future__ import annotations

from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from tsplat.errors import LoadError
from tsplat.io.arrays import Arrays
from tsplat.io.finish import keep, mend_all, warn_dropped
from tsplat.io.remote import Fetched, Progress, is_url, shown_url
from tsplat.io.sog import Scene, check_paid, find_piece, read_scene
from tsplat.io.sog_files import Folder
from tsplat.io.sog_json import Fields, read_fields
from tsplat.io.sog_lod import Lod, Piece, is_streamed, leaves_and_pieces
from tsplat.io.sog_stream import Stream
from tsplat.io.sources import legible

I64 = npt.NDArray[np.int64]

SUFFIX = ".json"


class Source(Protocol):
    """Where the files of a streamed scene come from.

    Attributes
    ----------
    meta : Path
        The lod-meta.json, which is here; the place of every other file is beside it.
    getting : float
        The share that getting a file has in getting and reading it.
    """

    meta: Path
    getting: float

    def bring(self, name: str, progress: Progress) -> None:
        """Have a file here, with the planes that it names."""

    def legible(self) -> AbstractContextManager[None]:
        """Let what goes wrong be a `LoadError` with names that a person knows."""


class Here:
    """Files that are on this machine."""

    getting = 0.0

    def __init__(self, meta: Path) -> None:
        self.meta = meta

    def bring(self, name: str, progress: Progress) -> None:
        """Do nothing: it is here, or else it is missing."""

    def legible(self) -> AbstractContextManager[None]:
        """See `tsplat.io.sources.legible`."""
        return legible(self.meta)


class _Files:
    """The files of a scene, of each the header when it is first asked for."""

    def __init__(self, source: Source, fields: Fields, pieces: list[Piece]) -> None:
        self.source, self.pieces, self._fields = source, pieces, fields
        self._found: dict[int, Scene] = {}
        self._unpaid = 0

    def find(self, number: int, progress: Progress = lambda _: None) -> Scene:
        """Return a file, which is here from then on."""
        if number not in self._found:
            piece, meta = self.pieces[number], self.source.meta
            self.source.bring(piece.name, progress)
            self._found[number] = find_piece(meta.parent, self._fields, piece)
            self._unpaid += self._found[number].unpaid
            check_paid(meta, self._unpaid)
        return self._found[number]


@dataclass(frozen=True, eq=False, slots=True)
class Levels:
    """A streamed scene of which no splat was read.

    Runs are splats that lie side by side in a file; they are numbered in the order of the files, and within one as
    they lie. A level of the scene is loaded in that order.

    Attributes
    ----------
    files : _Files
        With what is wanted of each.
    counts : list of ndarray of int64
        Of each file, how many splats its runs have.
    leaves : list of list of int
        The runs of each leaf, which stand for one another, the coarsest first.
    coefficients : int
        How many coefficients a colour has, the first one included; what a file has beyond them is left out.
    antialiased : bool
        As in `Gaussians`.
    """

    files: _Files
    counts: list[I64]
    leaves: list[list[int]]
    coefficients: int
    antialiased: bool

    def read(self, number: int, progress: Progress = lambda _: None, *, warn: bool = False) -> tuple[Arrays, I64]:
        """Return the splats of a file but for those that cannot be drawn, and one more that nobody sees.

        And where its runs begin, and the last one ends. ``warn`` of those that are left out.

        Raises
        ------
        LoadError
            The file cannot be had or read; `CorruptFileError` where it is broken.
        """
        source = self.files.source
        with source.legible():
            file = self.files.find(number, lambda fraction: progress(source.getting * fraction))
            arrays = Arrays.empty(file.kept + 1, max(file.k, self.coefficients))
            rest = 1.0 - source.getting
            finite = read_scene(
                file,
                arrays.part(slice(0, file.kept)),
                lambda fraction: progress(source.getting + rest * fraction),
            )
            for array, value in zip(arrays, (0.0, 1.0, 1.0, 0.0, 0.0), strict=True):
                array[-1] = value
            good = np.ones(len(arrays.means), np.bool_) if finite else mend_all(arrays)
            runs = np.cumsum([0, *self.counts[number]])
            ends = np.concatenate(([0], np.cumsum(good)))[runs]
            if warn:
                warn_dropped(file.path, file.kept - int(ends[-1]), file.kept, stacklevel=6)
            means, quats, scales, opacities, sh = (keep(array, good) for array in arrays)
        return Arrays(means, quats, scales, opacities, np.ascontiguousarray(sh[:, : self.coefficients])), ends


def find_levels(source: str | Path, fetched: Fetched) -> Levels | None:
    """Return the levels of a scene, a file or a URL, unless it is something else than a lod-meta.json.

    What it names is fetched from a URL when it is read; ``fetched`` hears of the bytes.

    Raises
    ------
    LoadError
        It cannot be fetched; `CorruptFileError` where the files contradict each other, themselves or their sizes.
    """
    if isinstance(source, str) and is_url(source):
        if not shown_url(source).lower().endswith(SUFFIX):
            return None
        stream = Stream(source, fetched)
        with stream.legible():
            fields = _fields(stream.meta)
            return _open(stream, fields, all_now=False) if is_streamed(fields) else None
    path = Path(source)
    if not is_streamed_file(path):
        return None
    with legible(path):
        return open_levels(path)


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
    return _open(Here(path), fields, all_now=True)


def _open(source: Source, fields: Fields, *, all_now: bool) -> Levels:
    """Return the levels of a scene: with the headers of all files, or of those without which nothing is known."""
    leaves, pieces = leaves_and_pieces(fields)
    files, numbers, counts = _Files(source, fields, pieces), dict[Lod, int](), list[I64]()
    first = next(number for number, piece in enumerate(pieces) if piece.name == leaves[0][0].name)
    known = [files.find(number) for number in (range(len(pieces)) if all_now else [first])]
    for number, piece in enumerate(pieces):
        runs = [Lod(piece.name, 0, None)] if piece.runs is None else [Lod(piece.name, *run) for run in piece.runs]
        numbers |= {run: len(numbers) + place for place, run in enumerate(runs)}
        counts.append(
            np.array([files.find(number).meta.count if run.count is None else run.count for run in runs])
        )
    return Levels(
        files, counts, [[numbers[lod] for lod in leaf] for leaf in leaves],
        coefficients=max(file.k for file in known), antialiased=all(file.meta.antialiased for file in known),
    )  # fmt: skip


def _fields(path: Path) -> Fields:
    return read_fields(Folder(path), path.name)
