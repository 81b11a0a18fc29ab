"""Streamed SOG: a tree in lod-meta.json whose leaves name runs of splats in several SOG scenes, level by level.

Source: lod-meta.json as PlayCanvas' splat-transform writes it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby, pairwise
from pathlib import PurePosixPath
from typing import Any

from tsplat.errors import OptionError, shown
from tsplat.io.sog_files import NAME_CHARS
from tsplat.io.sog_json import Fields
from tsplat.io.sog_planes import PIXELS_MAX

LEVELS_MAX = 1000

Run = tuple[int, int]
"""Offset and count of splats that lie side by side in a file."""


@dataclass(frozen=True, slots=True)
class Piece:
    """A file of a streamed scene and what is wanted of it.

    Attributes
    ----------
    name : str
        Its meta.json or .sog, from the folder of lod-meta.json.
    runs : list of (offset, count), optional
        By growing offset, no splat twice; None for the whole file.
    """

    name: str
    runs: list[Run] | None


@dataclass(frozen=True, slots=True)
class Lod:
    """The splats of a leaf on one level: a run of a file, or with no count all of it."""

    name: str
    offset: int
    count: int | None


def is_streamed(fields: Fields) -> bool:
    """Tell whether a JSON object is a lod-meta.json."""
    return fields.has("tree") and fields.has("filenames")


def pieces_of_level(fields: Fields, level: int | None) -> list[Piece]:
    """Return what makes up a level of detail, in the order of the files.

    Parameters
    ----------
    fields : Fields
        The lod-meta.json.
    level : int or None
        0 is the finest. A leaf without it gives its next coarser one, or else its coarsest.
        None means every level.

    Raises
    ------
    OptionError
        There is no such level.
    CorruptFileError
        The tree is no tree of runs, or uses a splat twice.
    """
    levels = fields.count("lodLevels", 1, LEVELS_MAX)
    if level is not None and level >= levels:
        raise OptionError(f"lod must be 0 to {levels - 1} in this scene, got {level}")
    names = _names(fields)
    found = [_lod(lod, names) for lods in _leaves(fields) for lod in _lods_of(lods, level)]
    pieces = _pieces(fields, found, "any level" if level is None else f"level {level}")
    # The sky and what else is far away is drawn behind every level.
    return pieces + [Piece(sky.name, None) for sky in _sky(fields)]


def leaves_and_pieces(fields: Fields) -> tuple[list[list[Lod]], list[Piece]]:
    """Return the levels of every leaf, the coarsest first, and the files that they are in.

    What is drawn behind every level is a leaf of one level. Levels of no splats are left out.

    Raises
    ------
    CorruptFileError
        The tree is no tree of runs, or uses a splat twice.
    """
    fields.count("lodLevels", 1, LEVELS_MAX)
    names, leaves = _names(fields), []
    for lods in _leaves(fields):
        runs = [run for lod in _lods_of(lods, None) if (run := _lod(lod, names)).count]
        # A level that is the same as the next finer one is none.
        leaves.append([run for run, _ in groupby(reversed(runs))])
    pieces = _pieces(fields, [lod for leaf in leaves for lod in leaf], "any level")
    sky = _sky(fields)
    return [leaf for leaf in (*leaves, sky) if leaf], pieces + [Piece(lod.name, None) for lod in sky]


def _names(fields: Fields) -> list[str]:
    filenames = fields.values.get("filenames")
    names = fields.names("filenames", len(filenames) if isinstance(filenames, list) else 1)
    # Two spellings of a name must not hide that they are one file.
    return [str(PurePosixPath(name)) for name in names]


def _lod(fields: Fields, names: list[str]) -> Lod:
    name = names[fields.count("file", 0, len(names) - 1)]
    return Lod(name, fields.count("offset", 0, PIXELS_MAX), fields.count("count", 0, PIXELS_MAX))


def _sky(fields: Fields) -> list[Lod]:
    return [Lod(fields.name("environment"), 0, None)] if fields.has("environment") else []


def _pieces(fields: Fields, lods: list[Lod], where: str) -> list[Piece]:
    """Return the files in the order of their names, each with its runs; refuse runs that overlap."""
    found: dict[str, list[Run]] = {}
    for lod in lods:
        found.setdefault(lod.name, []).append((lod.offset, lod.count or 0))
    if not found:
        raise fields.corrupt("has a tree without leaves, expected at least one")
    for name, runs in found.items():
        runs.sort()
        for (offset, count), (following, _) in pairwise(runs):
            if offset + count > following:
                raise fields.corrupt(
                    f"uses splat {following} of {shown(name, NAME_CHARS)} twice, expected each once"
                )
    if (total := sum(count for runs in found.values() for _, count in runs)) > PIXELS_MAX:
        raise fields.corrupt(f"counts {total} splats in {where}, expected at most {PIXELS_MAX}")
    return [Piece(name, runs) for name, runs in sorted(found.items())]


def _leaves(fields: Fields) -> Iterator[Fields]:
    """Go through the tree without recursion: its depth is a stranger's choice."""
    stack: list[Any] = [fields.values["tree"]]
    while stack:
        node = stack.pop()
        if isinstance(node, dict) and isinstance(node.get("children"), list):
            stack += node["children"]
        elif isinstance(node, dict):
            yield Fields(fields.corrupt, node, "tree...").inner("lods")
        else:
            raise fields.corrupt(f"holds {shown(node)} in the tree, expected a node")


def _lods_of(lods: Fields, level: int | None) -> list[Fields]:
    numbers = sorted(int(key) for key in lods.values if key.isascii() and key.isdigit() and len(key) < 5)
    if not numbers:
        raise lods.corrupt("has a leaf without levels in its tree, expected at least one")
    if level is None:
        return [lods.inner(str(number)) for number in numbers]
    nearest = next((number for number in numbers if number >= level), numbers[-1])
    return [lods.inner(str(nearest))]
