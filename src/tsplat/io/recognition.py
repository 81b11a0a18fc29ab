"""The format of a file: by what it holds, then by its name; or one line that says what it is instead."""

from __future__ import annotations

from pathlib import Path

from tsplat.errors import LoadError
from tsplat.io.formats import FORMATS, HEAD_BYTES, Format, find_format, fitting_formats
from tsplat.io.json_kinds import CAMERAS, JsonKind, is_camera_list, json_kind, load_json, no_json_scene
from tsplat.io.not_scenes import no_scene
from tsplat.io.splat import is_splat

READ_BYTES = 8192
"""How much of a file is looked at for what it is in place of a scene: titles of pages come late."""

PARSED_BYTES = 1 << 20
"""A larger glTF has its buffers inside, and is told by how it begins: parsing it twice would take much memory."""

JSON_FORMATS: dict[JsonKind, str] = {"sog": ".json", "gltf": ".gltf"}


def recognized(path: Path, asked: str | None = None) -> Format:
    """Return the format of a file.

    Parameters
    ----------
    path : Path
        The file.
    asked : str, optional
        One of `tsplat.io.options.FORMAT_NAMES`, to be taken unless the file is known to be no scene at all.

    Raises
    ------
    LoadError
        It is no scene, or of no known format.
    """
    head = read_head(path)
    kind = _kind_of_json(path, head)
    known = find_format(head[:HEAD_BYTES], path.name)
    unknown = kind is None and not fitting_formats(head[:HEAD_BYTES]) and not (known and known.is_numbers(head))
    if unknown and (problem := no_scene(head, str(path))):
        raise LoadError(path, problem)
    if asked:
        return _called(f".{asked}")
    if kind == "gsplat":
        return next(known for known in FORMATS if known.name == "gsplat PNG")
    if kind:
        return _called(JSON_FORMATS[kind])
    if known is None and is_splat(path):
        known = _called(".splat")
    if known is None:
        names = ", ".join(f"{known.name} ({', '.join(known.suffixes)})" for known in FORMATS if known.suffixes)
        raise LoadError(
            path, f"is of no known format, expected {names}; say which with --format, or convert it", 0
        )
    return known


def read_head(path: Path) -> bytes:
    """Return the beginning of a file that is one, and not empty."""
    if path.exists() and not path.is_file():
        raise LoadError(path, "is a device or a pipe, expected a file; give the path of a scene")
    with path.open("rb") as file:
        head = file.read(READ_BYTES)
    if not head:
        raise LoadError(path, "is empty, expected a splat scene; fetch it again", 0)
    return head


def _kind_of_json(path: Path, head: bytes) -> JsonKind | None:
    begins = head.removeprefix(b"\xef\xbb\xbf").lstrip()
    if is_camera_list(begins):
        raise LoadError(path, CAMERAS)
    if not begins.startswith(b"{"):
        return None
    if path.stat().st_size > PARSED_BYTES and b'"asset"' in head and b'"geometricError"' not in head:
        return "gltf"
    values = load_json(path)
    kind = json_kind(values)
    if kind is None and (problem := no_json_scene(values)):
        raise LoadError(path, problem)
    return kind


def _called(suffix: str) -> Format:
    return next(known for known in FORMATS if suffix in known.suffixes)
