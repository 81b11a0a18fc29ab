"""SOG, PlayCanvas' format: planes of bytes as WebP images, and a meta.json that says what they mean.

A scene is one zip (.sog), a folder whose meta.json is given, or several of these with a lod-meta.json.

Source: the SOG specification on developer.playcanvas.com. Writers keep the axes of the PLY they were given.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tsplat.errors import CorruptFileError, LoadError, OptionError, shown
from tsplat.io.arrays import Arrays
from tsplat.io.finish import finish
from tsplat.io.options import LoadOptions
from tsplat.io.sog_files import NAME_CHARS, ZIP_MAGICS, Archive, Files, Folder
from tsplat.io.sog_json import META_BYTES, Fields, read_fields
from tsplat.io.sog_lod import Piece, Run, is_streamed, pieces_of_level
from tsplat.io.sog_meta import Meta, parse_meta
from tsplat.io.sog_planes import SPARE_PIXELS
from tsplat.io.sog_splats import check_count, count_coefficients, read_splats
from tsplat.scene import Gaussians

Mask = npt.NDArray[np.bool_]

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
    scenes = _find_scenes(path, options.lod)
    check_paid(path, sum(scene.unpaid for scene in scenes))
    k = max(scene.k for scene in scenes)
    arrays = Arrays.empty(sum(scene.kept for scene in scenes), k)
    done, finite = 0, True
    for number, scene in enumerate(scenes):

        def share(fraction: float, number: int = number) -> None:
            progress((number + fraction) / len(scenes))

        finite &= read_scene(scene, arrays.part(slice(done, done + scene.kept)), share)
        done += scene.kept
    antialiased = all(scene.meta.antialiased for scene in scenes)
    good = np.ones(done, np.bool_) if finite else None
    gaussians = finish(path, *arrays, good=good, max_splats=options.max_splats, antialiased=antialiased)
    progress(1.0)
    return gaussians


class Scene(NamedTuple):
    """One meta.json, how many coefficients its colours have, which splats are wanted, and `check_count`."""

    path: Path
    meta: Meta
    k: int
    wanted: Mask | None
    unpaid: int

    @property
    def kept(self) -> int:
        """How many splats are wanted."""
        return self.meta.count if self.wanted is None else int(np.count_nonzero(self.wanted))


def check_paid(path: Path, unpaid: int) -> None:
    """Refuse scenes that have far more splats than their bytes hold: ``unpaid`` together, see `check_count`."""
    if unpaid > SPARE_PIXELS:
        problem = f"its scenes have {unpaid} splats more than their means hold, expected at most {SPARE_PIXELS}"
        raise CorruptFileError(path, f"{problem}; fetch it again")


def read_scene(scene: Scene, out: Arrays, progress: Callable[[float], None]) -> bool:
    """Read the wanted splats of a scene; see `read_splats`."""
    with _open(scene.path) as files:
        return read_splats(files, scene.meta, scene.wanted, out, progress)


def _find_scenes(path: Path, level: int | None) -> list[Scene]:
    if not _begins_as_zip(path):
        fields = read_fields(Folder(path), path.name)
        if is_streamed(fields):
            return [find_piece(path.parent, fields, piece) for piece in pieces_of_level(fields, level)]
        if not fields.has("means"):
            problem = "is JSON, but neither a meta.json nor a lod-meta.json of a SOG scene; choose another file"
            raise LoadError(path, problem)
    if level:
        raise OptionError(f"lod must be 0 in a scene that is not streamed, got {level}")
    return [_find_scene(path, None)]


def find_piece(folder: Path, fields: Fields, piece: Piece) -> Scene:
    """Return a file of a streamed scene, of which nothing but the header was read.

    Raises
    ------
    CorruptFileError
        It is missing, broken, or too short for what is wanted of it.
    """
    path = folder / piece.name
    if not path.is_file():
        raise fields.corrupt(
            f"names {shown(piece.name, NAME_CHARS)}, which is missing, expected a file beside it; fetch it"
        )
    scene = _find_scene(path, piece.runs)
    if piece.runs is not None and (end := sum(piece.runs[-1])) > scene.meta.count:
        raise fields.corrupt(
            f"names splat {end - 1} of {shown(piece.name, NAME_CHARS)}, expected less than {scene.meta.count}"
        )
    return scene


def _find_scene(path: Path, runs: list[Run] | None) -> Scene:
    with _open(path) as files:
        zipped = isinstance(files, Archive)
        meta = parse_meta(read_fields(files, META_NAME, META_BYTES) if zipped else read_fields(files, path.name))
        unpaid = check_count(files, meta)
        k = count_coefficients(files, meta)
    wanted = None
    if runs is not None:
        wanted = np.zeros(meta.count, np.bool_)
        for offset, count in runs:
            wanted[offset : offset + count] = True
    return Scene(path, meta, k, None if wanted is None or wanted.all() else wanted, unpaid)


@contextmanager
def _open(path: Path) -> Iterator[Files]:
    if _begins_as_zip(path):
        with Archive(path) as archive:
            yield archive
    else:
        yield Folder(path)


def _begins_as_zip(path: Path) -> bool:
    with path.open("rb") as file:
        head = file.read(64)
    if not matches(head):
        problem = f"begins with {head[:12]!r}, expected a zip archive or a JSON object; choose another file"
        raise CorruptFileError(path, problem, 0)
    return head.startswith(ZIP_MAGICS)
