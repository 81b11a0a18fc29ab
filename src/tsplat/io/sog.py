"""SOG, PlayCanvas' format: planes of bytes as WebP images, and a meta.json that says what they mean.

A scene is one zip (.sog) or a folder whose meta.json is given.

Source: the SOG specification on developer.playcanvas.com. Writers keep the axes of the PLY they were given.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from tsplat.errors import CorruptFileError
from tsplat.io.finish import finish
from tsplat.io.sog_files import ZIP_MAGICS, Archive, Folder
from tsplat.io.sog_json import read_fields
from tsplat.io.sog_meta import parse_meta
from tsplat.io.sog_splats import Splats, read_splats
from tsplat.scene import Gaussians

META_NAME = "meta.json"


def matches(head: bytes) -> bool:
    """Tell whether a file that begins with these bytes is a zip or a JSON object."""
    return head.startswith(ZIP_MAGICS) or head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"{")


def read(
    path: Path,
    *,
    max_splats: int | None,
    raw_opacity: bool,  # noqa: ARG001
    progress: Callable[[float], None],
) -> Gaussians:
    """Read a SOG scene; see `tsplat.io.load` for the parameters.

    Raises
    ------
    CorruptFileError
        It is no zip or JSON of a scene, or its planes contradict it.
    """
    splats = _read_scene(path, progress)
    # What is too large for float32 became inf; finish counts and drops it.
    with np.errstate(over="ignore", invalid="ignore"):
        return finish(path, *splats, max_splats=max_splats)


def _read_scene(path: Path, progress: Callable[[float], None]) -> Splats:
    with path.open("rb") as file:
        head = file.read(64)
    if head.startswith(ZIP_MAGICS):
        with Archive(path) as archive:
            return read_splats(archive, parse_meta(read_fields(archive, META_NAME)), progress)
    if not matches(head):
        problem = f"begins with {head[:12]!r}, expected a zip archive or a JSON object; choose another file"
        raise CorruptFileError(path, problem, 0)
    folder = Folder(path)
    return read_splats(folder, parse_meta(read_fields(folder, path.name)), progress)
