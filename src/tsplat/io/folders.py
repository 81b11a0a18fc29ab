"""The scene in a folder: of a training, of an export, of a format of several files."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from tsplat.errors import CorruptFileError, LoadError
from tsplat.io.candidates import Series, find_checkpoint, find_series, is_hidden, is_meta
from tsplat.io.json_kinds import is_other_json
from tsplat.io.not_scenes import checkpoint, no_scene, shown
from tsplat.io.ply_header import MAGIC, read_header
from tsplat.io.sog_files import ZIP_MAGICS
from tsplat.io.sog_json import JSON_BYTES
from tsplat.io.splat import RECORD

DEPTH = 5
"""Folders inside each other that are looked into: ``point_cloud/iteration_30000`` are two."""

MOST_FILES = 20_000
"""So many are looked at, those nearest to the top first."""

LISTED = 8
"""So many scenes are named where there is more than one."""

HEAD_BYTES = 4096


def scene_in(folder: Path) -> tuple[Path, list[Path]]:
    """Return the one scene in a folder, the newest that is whole, and newer ones that are not.

    Raises
    ------
    LoadError
        There is none, or more than one.
    """
    names: list[str] = []
    found: list[Series] = []
    for deeper in _by_depth(folder):
        names += [name for name in deeper if not (is_meta(name) and _is_other_json(folder / name))]
        found = find_series(names)
        if found and found[0].final:
            break
    series = the_one(folder, found, names)
    paths = [folder / name for name in series.names]
    number = next((number for number, path in enumerate(paths) if is_whole(path)), 0)
    return paths[number], paths[:number]


def the_one(place: Path, found: list[Series], names: list[str], remedy: str = "name one of them") -> Series:
    """Return the only scene that was found among files in a folder or a zip.

    Raises
    ------
    LoadError
        There is none, or more than one.
    """
    if len(found) == 1:
        return found[0]
    if found:
        listed = ", ".join(shown(series.names[0]) for series in found[:LISTED])
        more = f" and {len(found) - LISTED} more" if len(found) > LISTED else ""
        raise LoadError(place, f"holds {len(found)} scenes: {listed}{more}; {remedy}")
    if kept := find_checkpoint(names):
        raise LoadError(place, f"holds no scene; {shown(kept)} in it {checkpoint(str(place / kept))}")
    raise LoadError(place, f"holds no scene among its {len(names)} files; give the path of one")


def is_whole(path: Path) -> bool:
    """Tell whether a file may be all of a scene, as far as its length says; what was being written may be not."""
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
            size = path.stat().st_size
            if head.startswith(MAGIC):
                header = read_header(file, path)
                return size >= header.data_start + header.least_bytes
            if head.startswith(ZIP_MAGICS):
                return zipfile.is_zipfile(file)
            if head.startswith(b"glTF"):
                return size >= int.from_bytes(head[8:12], "little")
            rest = size % RECORD.itemsize if path.suffix.lower() == ".splat" else 0
            return bool(head) and not rest and no_scene(head, str(path)) is None
    except (OSError, CorruptFileError):
        return False


def _is_other_json(path: Path) -> bool:
    try:
        return path.stat().st_size <= JSON_BYTES and is_other_json(path.read_bytes())
    except OSError:
        return False


def _by_depth(folder: Path) -> Iterator[list[str]]:
    """Yield the names of the files in a folder, then of those one deeper, and so on; no links are followed."""
    level, seen = [""], 0
    for _ in range(DEPTH):
        files, deeper = list[str](), list[str]()
        for inside in level:
            for entry in islice(_entries(folder, inside), MOST_FILES - seen):
                seen += 1
                name = f"{inside}{entry.name}"
                if entry.is_dir(follow_symlinks=False):
                    deeper.append(f"{name}/")
                elif entry.is_file():
                    files.append(name)
        yield files
        if not deeper or seen >= MOST_FILES:
            return
        level = sorted(deeper)


def _entries(folder: Path, inside: str) -> Iterator[os.DirEntry[str]]:
    try:
        with os.scandir(folder / inside) as entries:
            yield from (entry for entry in entries if not is_hidden(entry.name))
    except PermissionError:
        if not inside:
            raise  # what is deeper may be locked without the scene being so
