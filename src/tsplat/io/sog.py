"""SOG, PlayCanvas' format: planes of bytes as WebP images, and a meta.json that says what they mean.

A scene is one zip (.sog), a folder whose meta.json is given, or several of these with a lod-meta.json.

Source: the SOG specification on developer.playcanvas.com. Writers keep the axes of the PLY they were given.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from tsplat.errors import CorruptFileError, LoadError, OptionError
from tsplat.io.finish import finish
from tsplat.io.options import LoadOptions
from tsplat.io.sog_files import ZIP_MAGICS, Archive, Folder
from tsplat.io.sog_json import Fields, read_fields
from tsplat.io.sog_lod import Piece, Run, is_streamed, pieces_of_level
from tsplat.io.sog_meta import parse_meta
from tsplat.io.sog_splats import Splats, read_splats
from tsplat.scene import Gaussians

META_NAME = "meta.json"


def matches(head: bytes) -> bool:
    """Tell whether a file that begins with these bytes is a zip or a JSON object."""
    return head.startswith(ZIP_MAGICS) or head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"{")


def read(path: Path, options: LoadOptions, progress: Callable[[float], None]) -> Gaussians:
    """Read a SOG scene; see `tsplat.io.load` for the parameters.

    Raises
    ------
    OptionError
        The scene has no such level of detail.
    CorruptFileError
        It is no zip or JSON of a scene, or its planes contradict it.
    """
    # What is too large for float32 became inf; finish counts and drops it.
    with np.errstate(over="ignore", invalid="ignore"):
        *arrays, antialiased = _read_any(path, options.lod, progress)
        return finish(path, *arrays, max_splats=options.max_splats, antialiased=antialiased)


def _read_any(path: Path, level: int | None, progress: Callable[[float], None]) -> Splats:
    if not _begins_as_zip(path):
        fields = read_fields(Folder(path), path.name)
        if is_streamed(fields):
            return _read_streamed(path.parent, fields, pieces_of_level(fields, level), progress)
        if not fields.has("means"):
            problem = "is JSON, but neither a meta.json nor a lod-meta.json of a SOG scene; choose another file"
            raise LoadError(path, problem)
    if level:
        raise OptionError(f"lod must be 0 in a scene that is not streamed, got {level}")
    return _read_one(path, progress)


def _read_streamed(folder: Path, fields: Fields, pieces: list[Piece], progress: Callable[[float], None]) -> Splats:
    parts = []
    for done, piece in enumerate(pieces):

        def share(fraction: float, done: int = done) -> None:
            progress((done + fraction) / len(pieces))

        path = folder / piece.name
        if not path.is_file():
            raise fields.corrupt(f"names {piece.name!a}, which is missing, expected a file beside it; fetch it")
        whole = _read_one(path, share)
        count = len(whole.means)
        if piece.runs is not None and (end := sum(piece.runs[-1])) > count:
            raise fields.corrupt(f"names splat {end - 1} of {piece.name!a}, expected less than {count}")
        parts.append(whole if piece.runs is None else _take_runs(whole, piece.runs))
    return _joined(parts)


def _take_runs(splats: Splats, runs: list[Run]) -> Splats:
    wanted = np.zeros(len(splats.means), bool)
    for offset, count in runs:
        wanted[offset : offset + count] = True
    if wanted.all():
        return splats
    means, quats, scales, opacities, sh = (array[wanted] for array in splats[:5])
    return Splats(means, quats, scales, opacities, sh, splats.antialiased)


def _joined(parts: list[Splats]) -> Splats:
    if len(parts) == 1:
        return parts[0]
    k = max(part.sh.shape[1] for part in parts)
    even = [part._replace(sh=np.pad(part.sh, ((0, 0), (0, k - part.sh.shape[1]), (0, 0)))) for part in parts]
    means, quats, scales, opacities, sh = (np.concatenate(column) for column in list(zip(*even, strict=True))[:5])
    return Splats(means, quats, scales, opacities, sh, all(part.antialiased for part in parts))


def _read_one(path: Path, progress: Callable[[float], None]) -> Splats:
    if _begins_as_zip(path):
        with Archive(path) as archive:
            return read_splats(archive, parse_meta(read_fields(archive, META_NAME)), progress)
    folder = Folder(path)
    return read_splats(folder, parse_meta(read_fields(folder, path.name)), progress)


def _begins_as_zip(path: Path) -> bool:
    with path.open("rb") as file:
        head = file.read(64)
    if not matches(head):
        problem = f"begins with {head[:12]!r}, expected a zip archive or a JSON object; choose another file"
        raise CorruptFileError(path, problem, 0)
    return head.startswith(ZIP_MAGICS)
