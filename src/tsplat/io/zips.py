"""A scene in a zip that is no format of its own: as downloaded, with folders and whatever else lies in it.

What is unpacked is chosen by name, stays in one folder, and is no more than an honest scene unpacks to.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from tsplat.errors import CorruptFileError, LoadError
from tsplat.io import npz
from tsplat.io.candidates import Series, find_series, is_meta, parts_of
from tsplat.io.folders import is_whole, the_one
from tsplat.io.json_kinds import is_other_json, json_kind
from tsplat.io.not_scenes import checkpoint, shown
from tsplat.io.sog_files import ZIP_MAGICS, Archive, is_inside
from tsplat.io.sog_json import META_BYTES, read_fields
from tsplat.io.unpack import MOST_TIMES, SLACK

HEAD_BYTES = 1024
PIECE_BYTES = 1 << 20
META_NAME = "meta.json"
MOST_METAS = 1000
"""Where a zip has more of them, none is looked into before it is chosen."""

PICKLE = "data.pkl"
"""What PyTorch calls the file in its zips that says what the others are."""

OWN_SUFFIXES = (".sog", ".npz")
"""Of formats that are zips; what is missing in one of them is for its reader to say."""


def is_bundle(path: Path) -> bool:
    """Tell whether a file is a zip around a scene, and not a format that is a zip; a broken one is none."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    if not head.startswith(ZIP_MAGICS) or npz.matches(head):
        return False
    with suppress(CorruptFileError), Archive(path) as archive:
        inside = _names_inside(archive)
        if META_NAME in inside:
            return json_kind(read_fields(archive, META_NAME, META_BYTES).values) == "gsplat"
        named_so = path.name.lower().endswith(OWN_SUFFIXES)
        return not named_so or _is_checkpoint(inside) or bool(find_series(inside))
    return False


def unzip(path: Path, folder: Path) -> tuple[Path, list[Path]]:
    """Unpack the one scene in a zip into a folder that is not there yet; see `tsplat.io.folders.scene_in`.

    Raises
    ------
    LoadError
        There is none, or more than one; `CorruptFileError` where it cannot be unpacked.
    """
    with Archive(path) as archive:
        inside = _names_inside(archive)
        names = list(inside)
        series = _the_scene(path, names, archive)
        left = MOST_TIMES * path.stat().st_size + SLACK
        places = []
        for name in series.names:
            for part in parts_of(name, names):
                left -= _unpack(archive, inside[part], folder / part, left)
            places.append(folder / name)
            if is_whole(places[-1]):
                break
        last = places[-1] if is_whole(places[-1]) else places[0]
        return last, places[: places.index(last)]


def _names_inside(archive: Archive) -> dict[str, str]:
    """Return the files that stay inside, by names with ``/``; some systems write a backslash in its place."""
    names = {name.replace("\\", "/"): name for name in archive.names()}
    inside = {safe: name for safe, name in names.items() if is_inside(safe) and not safe.endswith("/")}
    metas = list(filter(is_meta, inside))
    for safe in metas if len(metas) <= MOST_METAS else []:
        if is_other_json(archive.read(inside[safe], META_BYTES)):
            del inside[safe]
    return inside


def _the_scene(path: Path, names: list[str], archive: Archive) -> Series:
    if _is_checkpoint(names):
        raise LoadError(path, checkpoint(str(path)))
    found = find_series(names)
    if not archive.names():
        raise LoadError(path, "is a zip of nothing, expected a scene in it; fetch it again")
    if not found and any(name.lower().endswith(".zip") for name in names):
        raise LoadError(path, "holds zips, which are not looked into; unpack it first and name one of them")
    if not names:
        raise LoadError(path, "holds only files whose names lead out of it; fetch it from somebody else")
    return the_one(path, found, names, "unpack it and name one of them")


def _is_checkpoint(names: Iterable[str]) -> bool:
    return any(name.rpartition("/")[2] == PICKLE for name in names)


def _unpack(archive: Archive, name: str, place: Path, most: int) -> int:
    """Unpack a file, at most so many bytes; return how many there were."""
    place.parent.mkdir(parents=True, exist_ok=True)
    done = 0
    with archive.open(name) as packed, place.open("xb") as file:
        while piece := packed.read(PIECE_BYTES):
            done += len(piece)
            if done > most:
                problem = f"{shown(name)} unpacks to more than {MOST_TIMES} times what the zip takes"
                raise CorruptFileError(archive.path, f"{problem}; unpack it first if it is a scene")
            file.write(piece)
    return done
