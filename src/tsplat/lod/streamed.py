"""A streamed SOG with the levels that it has: a leaf on one level is a node, on the next finer one its child."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsplat.errors import LoadError
from tsplat.io.sog_levels import Levels, open_levels
from tsplat.io.sources import local_file
from tsplat.lod.stored import Stored
from tsplat.lod.streamed_reader import Reader
from tsplat.processors import available_processors
from tsplat.raster.prepare import BLOCK

SPARE_BLOCKS, LEAST_FILLED = 256, 0.25
"""Blocks that may be as empty as they like, and what share of all others must be splats: a leaf on one level takes
whole blocks, however few splats it has, and how many leaves there are is a stranger's choice."""


@dataclass(frozen=True, eq=False, slots=True)
class Streamed(Stored):
    """An open streamed SOG.

    Attributes
    ----------
    reader : Reader
        What reads the levels that are not in memory yet.
    """

    reader: Reader

    @property
    def sampled(self) -> int:
        """How many splats the sample is of: those of the coarsest levels."""
        return int(self.tree.splats[self.tree.roots].sum())

    @property
    def complete(self) -> bool:
        """Whether all levels are in memory."""
        return not self.reader.left

    def let_go(self) -> None:
        """Do nothing: what is drawn was read for good."""

    def read_rest(self, progress: Callable[[float], None] = lambda _: None) -> None:
        """Read what is not in memory yet, without a warning; meanwhile other threads may draw what is.

        Raises
        ------
        CorruptFileError
            A file is broken.
        """
        with self.reader.lock:
            # One thread: those of the frames are not waited for, nor kept waiting.
            share = _share(self.reader, progress)
            while self.reader.left:
                self.reader.read_next(1, share, warn=False)
            progress(1.0)


def open_streamed(path: str | Path, progress: Callable[[float], None] = lambda _: None) -> Streamed:
    """Open a lod-meta.json with the levels of detail that it has.

    Parameters
    ----------
    path : str or Path
        The files that it names are beside it; or its URL.
    progress : callable
        Called with the fraction done.

    Raises
    ------
    LoadError
        It cannot be read, or has leaves of hardly any splats.
    CorruptFileError
        It or its files are broken.

    Warns
    -----
    LoadWarning
        Splats were left out: nan, inf or a zero quat.
    """
    with local_file(path, None, progress, lambda *_: None) as (local, reading):
        levels = open_levels(local)
        if is_scattered(levels):
            raise LoadError(local, "has leaves of hardly any splats; load one level of it")
        return read_levels(levels, whole=True, progress=reading)


def read_levels(levels: Levels, *, whole: bool, progress: Callable[[float], None]) -> Streamed:
    """Read a streamed scene: the ``whole`` of it, or only those files with the coarsest level of a leaf."""
    reader = Reader(levels)
    share = _share(reader, progress)
    while reader.left and (whole or not reader.has_roots):
        reader.read_next(available_processors(), share, warn=True)
    progress(1.0)
    return Streamed(reader.tree, reader.sample(), reader.splats, levels.antialiased, None, reader)


def is_scattered(levels: Levels) -> bool:
    """Tell whether a scene would take far more memory in blocks than its splats need."""
    counts = np.concatenate(levels.counts)
    blocks = int((-(-counts // BLOCK)).sum())
    return int(counts.sum()) < LEAST_FILLED * BLOCK * (blocks - SPARE_BLOCKS)


def _share(reader: Reader, progress: Callable[[float], None]) -> Callable[[float], None]:
    """Return what hears how much of a file was read, and says how much that is of all that is left now."""
    files = len(reader.left)
    return lambda fraction: progress((files - len(reader.left) + fraction) / files)
