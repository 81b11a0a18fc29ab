"""Where scenes come from: a file is itself; standard input, a URL and what is packed become a file for a while.

Readers see paths only. Errors call what lies in the temporary folder what a person called it.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import gettempdir
from typing import BinaryIO
from urllib.parse import unquote

from tsplat import given
from tsplat.errors import LoadError, LoadWarning, calling
from tsplat.io.arrival import UNMARKED, keep_room, may_be_scene
from tsplat.io.candidates import SUFFIXES
from tsplat.io.folders import scene_in
from tsplat.io.formats import HEAD_BYTES
from tsplat.io.remote import Fetched, Progress, Remote, is_url, name_in_query, shown_url, url_beside
from tsplat.io.remote_errors import FULL
from tsplat.io.sog_beside import Fetch, fetch_beside, is_json
from tsplat.io.unpack import UNPACKED, is_packed, unpack
from tsplat.io.zips import is_bundle, unzip
from tsplat.temporary import TemporaryFolder

STDIN = "-"
"""What standard input is called where a file may be named."""

GETTING = 0.75
"""The share that getting a scene here has in all there is to do: networks are slower than readers."""

NAME_CHARS = 60
"""At most this many characters of a name are kept, the last ones: file systems take 255 bytes."""

TOLD = 3
"""So many files that are not whole are named."""

PIECE_BYTES = 1 << 20


def is_elsewhere(source: str | Path) -> bool:
    """Tell whether a scene comes from standard input or a URL; a `Path` is a file always."""
    return isinstance(source, str) and (source == STDIN or is_url(source))


def called(source: str | Path) -> str:
    """Return what to call a scene before a person."""
    if source == STDIN:
        return "standard input"
    return shown_url(source) if isinstance(source, str) and is_url(source) else str(source)


def file_name(source: str | Path) -> str:
    """Return a name for a file with this scene in it, unpacked; on every system it stays in its folder."""
    name = "stdin" if source == STDIN else Path(called(source)).name
    if is_elsewhere(source):
        name = unquote(name)
        if not name.lower().removesuffix(".gz").endswith(SUFFIXES):
            name = name_in_query(str(source)) or name
    if name.lower().endswith(".gz"):
        name = name[: -len(".gz")]
    safe = "".join(c if c.isprintable() and c not in '/\\:*?"<>|' else "_" for c in name)[-NAME_CHARS:]
    return safe if safe.strip(". ") else "scene"


@contextmanager
def local_file(
    source: str | Path, lod: int | None, progress: Progress, fetched: Fetched, format: str | None = None
) -> Iterator[tuple[Path, Progress]]:
    """Give the path of a scene wherever it comes from, and what hears of the progress of reading it.

    Parameters
    ----------
    source : str or Path
        A path, of a file or a folder with one scene; or a str, ``-`` for standard input or a URL. A JSON at a URL
        brings along the files that it names. What is packed is unpacked, the one scene in a zip too.
    lod : int or None
        Of a streamed scene only the files of this level are fetched; None for all.
    progress : callable
        Hears the fraction done of getting the scene and reading it.
    fetched : callable
        Hears of the bytes that have come from elsewhere.
    format : str, optional
        What it is to be read as; then it is brought here to its end, whatever it begins with.

    Raises
    ------
    LoadError
        It cannot be got or read; `CorruptFileError` where it is packed and broken.
    """
    source = source if is_elsewhere(source) else given.path(source)
    with legible(source):
        found, newer = settled(source)
        _tell(found, newer)
        if not is_elsewhere(source) and not is_packed(Path(found)) and not is_bundle(Path(found)):
            yield Path(found), progress
            return
        with TemporaryFolder() as folder, legible(found, folder):
            place, names = place_in(folder, found), {}
            if f".{format}" in UNMARKED and place.suffix.lower() not in UNMARKED:
                place = place.with_name(f"{place.name}.{format}")  # nothing in it says what it is
                names[str(place)] = called(found)
            with calling(names):
                _get(found, place, lod, lambda fraction: progress(GETTING * fraction), fetched)
                place = _unzipped(place if place.exists() else Path(found), unzipped_in(folder, found))
                yield place, lambda fraction: progress(GETTING + (1.0 - GETTING) * fraction)


def settled(source: str | Path) -> tuple[str | Path, list[Path]]:
    """Return the file that a scene is in, where its folder was given, and newer files that are not whole.

    Raises
    ------
    LoadError
        There is no scene in the folder, or more than one.
    """
    if is_elsewhere(source) or not Path(source).is_dir():
        return source, []
    with legible(source):
        return scene_in(Path(source))


def _tell(found: str | Path, newer: list[Path]) -> None:
    if newer:
        listed = ", ".join(map(str, newer[:TOLD]))
        problem = f"was opened, as what is newer is not whole: {listed}"
        warnings.warn(f"{found}: {problem}", LoadWarning, stacklevel=6)


def _unzipped(place: Path, folder: Path) -> Path:
    if not is_bundle(place):
        return place
    inside, newer = unzip(place, folder)
    _unpack_in_place(inside)
    _tell(inside, newer)
    return inside


def unzipped_in(folder: str, source: str | Path) -> Path:
    """Return where a scene in a zip is unpacked."""
    return Path(f"{place_in(folder, source)}.d")


def place_in(folder: str, source: str | Path) -> Path:
    """Return where the file of a scene is in its temporary folder."""
    return Path(folder) / file_name(source)


@contextmanager
def legible(source: str | Path, folder: str | None = None) -> Iterator[None]:
    """Let what goes wrong be a `LoadError`, with names that a person knows: of a temporary folder, too."""
    name, names = called(source), {}
    if folder is not None:
        beside = name.rpartition("/")[0] if is_elsewhere(source) and source != STDIN else name
        names = {str(unzipped_in(folder, source)): name, str(place_in(folder, source)): name, folder: beside}
    try:
        with calling(names):
            yield
    except OSError as error:
        if folder is not None and error.errno in FULL:
            problem = f"finds no room in {gettempdir()}: {error.strerror}; set TMPDIR to a larger folder"
            raise LoadError(name, problem) from error
        raise LoadError(name, f"cannot be read: {error.strerror or error}; check the path") from error
    except MemoryError as error:
        raise LoadError(name, "needs more memory than there is; keep fewer splats with max_splats") from error


def _get(source: str | Path, place: Path, lod: int | None, progress: Progress, fetched: Fetched) -> None:
    if source == STDIN:
        with open(0, "rb", closefd=False) as file:
            _copy(file, place, progress, fetched)
        _unpack_in_place(place)
    elif isinstance(source, str) and is_url(source):
        _fetch(source, place, lod, progress, fetched)
    elif is_packed(Path(source)):
        unpack(Path(source), place, progress)


def _copy(file: BinaryIO, place: Path, progress: Progress, fetched: Fetched) -> None:
    if file.isatty():
        raise LoadError(place, "is the keyboard, expected a scene; pipe one in: cat scene.ply | tsplat -")
    size, done = os.fstat(file.fileno()).st_size, 0
    with place.open("xb") as copy:
        while piece := file.read(PIECE_BYTES):
            keep_room(place, done)
            copy.write(piece)
            if not done and len(piece) == PIECE_BYTES and not may_be_scene(piece[:HEAD_BYTES], place.name):
                return  # the rest may have no end
            done += len(piece)
            fetched(done, size or None)  # a pipe has no size
            if size:
                progress(min(1.0, done / size))


def _fetch(url: str, place: Path, lod: int | None, progress: Progress, fetched: Fetched) -> None:
    fetch = fetch_by(url, fetched)

    def silent(_: float) -> None:
        pass

    begins = place.suffix.lower() == ".json"  # then what it names is what takes long
    fetch(url, place, silent if begins else progress)
    if is_json(place) and place.suffix.lower() != ".gltf":
        fetch_beside(place, partial(url_beside, url), fetch, lod, progress if begins else silent)


def fetch_by(url: str, fetched: Fetched) -> Fetch:
    """Return what brings files from where a URL leads to a place, unpacked; see `Remote`."""
    fetched(0, None)
    remote = Remote(url, fetched)

    def fetch(url: str, place: Path, progress: Progress) -> None:
        remote.fetch(url, place, progress)
        _unpack_in_place(place)

    return fetch


def _unpack_in_place(place: Path) -> None:
    if is_packed(place):
        unpacked = place.with_name(f"{place.name}{UNPACKED}")
        unpack(place, unpacked, lambda _: None)
        unpacked.replace(place)
