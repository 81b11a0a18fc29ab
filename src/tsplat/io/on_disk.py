"""What a scene takes on disk: its file, and where that is JSON, the files that it names."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tsplat.errors import LoadError
from tsplat.io import gsplat_png
from tsplat.io.json_kinds import json_kind
from tsplat.io.recognition import READ_BYTES, recognized
from tsplat.io.sog_files import Folder, is_inside
from tsplat.io.sog_json import read_fields

SCENE_SUFFIXES = (".json", ".sog")
"""Of files that are scenes of their own inside a streamed scene."""


@dataclass(frozen=True, slots=True)
class OnDisk:
    """The files of a scene.

    Attributes
    ----------
    format : str
        For people, from `tsplat.io.formats`.
    nbytes : int
        Of all files.
    files : int
        How many these are.
    scenes : int
        How many scenes these hold: more than one where there are levels of detail.
    """

    format: str
    nbytes: int
    files: int
    scenes: int


def look(path: Path, asked: str | None = None) -> OnDisk:
    """Return what a scene that could be loaded takes on disk.

    Parameters
    ----------
    path : Path
        The file that `tsplat.io.load` read.
    asked : str, optional
        The format that it was asked to read it as.
    """
    try:
        name = recognized(path, asked).name
    except LoadError:
        name = "unknown"
    files = _files(path) if _is_json(path) else [path]
    return OnDisk(
        format=name,
        nbytes=sum(file.stat().st_size for file in files),
        files=len(files),
        scenes=max(1, sum(file.suffix.lower() in SCENE_SUFFIXES for file in files[1:])),
    )


def _is_json(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(READ_BYTES).lstrip(b"\xef\xbb\xbf\t\r\n ").startswith(b"{")


def _files(path: Path) -> list[Path]:
    """Return a JSON file, the files that it names, and those that JSON files among these name."""
    found = {path: None}
    waiting = [path]
    while waiting:
        parent = waiting.pop()
        named = {parent.parent / name for name in _names(parent)}
        new = sorted(file for file in named if file not in found and file.is_file())
        found.update(dict.fromkeys(new))
        waiting += [file for file in new if file.suffix.lower() == ".json"]
    return list(found)


def _names(path: Path) -> Iterator[str]:
    """Go through all texts in a JSON file that could be names of files beside it."""
    waiting: list[Any] = []
    # What is no JSON within limits is no part of a scene that could be loaded.
    with suppress(OSError, LoadError):
        waiting.append(read_fields(Folder(path), path.name).values)
    if waiting and json_kind(waiting[0]) == "gsplat":
        yield from gsplat_png.files_of(waiting[0])
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            waiting += value.values()
        elif isinstance(value, list):
            waiting += value
        elif is_inside(value):
            yield value
