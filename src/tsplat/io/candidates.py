"""Which of many files are scenes that somebody means: by their names alone, in a folder or in a zip.

Trainers leave one file for each thousand steps, their first points, lists and checkpoints; formats of several
files have one that names the rest.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import PurePosixPath
from typing import NamedTuple

SUFFIXES = (".ply", ".splat", ".ksplat", ".spz", ".sog", ".glb", ".gltf", ".npz", ".tsplat")
STREAMED_NAME = "lod-meta.json"
META_NAMES = (STREAMED_NAME, "meta.json")
"""Files that stand for all that lies beside them and below."""

CHECKPOINT_SUFFIXES = (".pt", ".pth", ".ckpt")
FIRST_POINTS = ("input", "points3d", "sparse_pc", "sparse", "points")
"""What a training began with: opened where nothing else is there, whichever of its files."""

COLMAP_NAMES = ("points3d.bin", "points3d.txt")

_STEP = re.compile(
    r"iteration[_-]?(\d+)|(?:iter|steps?|epoch|point_cloud|export|splats?|ckpt)[_-]?(\d{3,})", re.IGNORECASE
)


class Series(NamedTuple):
    """One scene: as it was at different steps of its training, the last one first.

    Attributes
    ----------
    names : list of str
        Paths with ``/``, relative to the folder.
    final : bool
        Whether these are splats, and not what a training began with.
    """

    names: list[str]
    final: bool


def find_series(names: Iterable[str]) -> list[Series]:
    """Return the scenes among files that lie nearest to the top, in the order of their names."""
    paths = _without_parts([path for path in map(PurePosixPath, names) if _may_be_scene(path)])
    final = [path for path in paths if not _is_first_points(path)]
    chosen = final or paths
    least = min((len(path.parts) for path in chosen), default=0)
    series: dict[str, list[str]] = {}
    for path in sorted(chosen, key=lambda path: (not final and path.suffix.lower() != ".ply", path)):
        if len(path.parts) == least:
            scene = path if final else path.with_suffix("")
            series.setdefault(_STEP.sub("#", str(scene)), []).append(str(path))
    return [Series(sorted(each, key=_step, reverse=True), bool(final)) for each in series.values()]


def find_checkpoint(names: Iterable[str]) -> str | None:
    """Return the last of the checkpoints among files."""
    found = [name for name in names if name.lower().endswith(CHECKPOINT_SUFFIXES)]
    return max(found, key=_step, default=None)


def is_meta(name: str) -> bool:
    """Tell whether a file is called as one is that stands for others; what it holds says more."""
    return PurePosixPath(name).name in META_NAMES


def is_hidden(name: str) -> bool:
    """Tell whether a part of a path is one that systems keep for themselves."""
    return name.startswith((".", "__MACOSX"))


def parts_of(name: str, names: Iterable[str]) -> list[str]:
    """Return, of all files, those that a scene of this name may be made of, itself first."""
    path = PurePosixPath(name)
    if path.name not in META_NAMES and path.suffix.lower() != ".gltf":
        return [name]
    return [name, *(each for each in names if each != name and path.parent in PurePosixPath(each).parents)]


def _may_be_scene(path: PurePosixPath) -> bool:
    if any(map(is_hidden, path.parts)):
        return False
    name = path.name.lower()
    return path.name in META_NAMES or name in COLMAP_NAMES or name.removesuffix(".gz").endswith(SUFFIXES)


def _is_first_points(path: PurePosixPath) -> bool:
    return path.name.lower().split(".")[0] in FIRST_POINTS


def _without_parts(paths: list[PurePosixPath]) -> list[PurePosixPath]:
    """Leave out what is a part of another scene."""
    streamed = {path.parent for path in paths if path.name == STREAMED_NAME}
    whole = {path.parent for path in paths if path.name in META_NAMES}

    def is_part(path: PurePosixPath) -> bool:
        if path.name == STREAMED_NAME:
            return False
        above = streamed if path.name in META_NAMES else whole
        return not above.isdisjoint(path.parents)

    return [path for path in paths if not is_part(path)]


def _step(name: str) -> tuple[int, ...]:
    return tuple(int(first or second) for first, second in _STEP.findall(name))
