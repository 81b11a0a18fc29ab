"""Which kind of scene a JSON file is, whatever its name, or what it is instead."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, Literal

from tsplat.errors import CorruptFileError
from tsplat.io.json_text import parse_json
from tsplat.io.not_scenes import shown
from tsplat.io.sog_json import JSON_BYTES

JsonKind = Literal["sog", "gltf", "gsplat"]

MESSAGES = (
    "error", "errors", "message", "Message", "detail", "error_description", "errorMessage", "msg", "reason",
    "title", "status", "code",
)  # fmt: skip
"""Under one of these keys servers say what went wrong."""

CAMERAS = "lists cameras, not splats; open the scene that lies beside it"

GLTF_KEYS = {"accessors", "bufferViews", "buffers", "meshes", "nodes", "scenes"}


def load_json(path: Path) -> Any:
    """Return what a JSON file holds; None where it is no JSON, or too large to be a list of planes."""
    return _parsed(path.read_bytes()) if path.stat().st_size <= JSON_BYTES else None


def json_kind(values: Any) -> JsonKind | None:
    """Return the kind of scene that a JSON describes, or None where it describes none that is known."""
    if not isinstance(values, dict) or is_tileset(values):
        return None
    means = values.get("means")
    if isinstance(means, dict):
        return "gsplat" if "files" not in means and "mins" in means else "sog"
    if "tree" in values and "filenames" in values:
        return "sog"
    return "gltf" if isinstance(values.get("asset"), dict) or values.keys() & GLTF_KEYS else None


def is_other_json(text: bytes) -> bool:
    """Tell whether this is whole JSON, but of no scene: others, too, call a file ``meta.json``."""
    values = _parsed(text)
    return values is not None and json_kind(values) is None


def no_json_scene(values: Any) -> str | None:
    """Return what a JSON is that describes no scene, and what helps; None where that is not known."""
    if not isinstance(values, dict):
        return None
    if is_tileset(values):
        uri = _content(values.get("root"))
        named = f"open what it names, such as {shown(uri)}" if uri else "open the .glb files that it leads to"
        return f"is a tileset of 3D Tiles, a list of scenes and no scene; {named}"
    if "frames" in values or "camera_angle_x" in values:
        return CAMERAS
    said = next((values[key] for key in MESSAGES if isinstance(values.get(key), str | dict)), None)
    if isinstance(said, dict):
        said = next((said[key] for key in MESSAGES if isinstance(said.get(key), str)), "")
    if said is not None:
        return f"is what a server said, not the scene itself: {shown(said)}; check address and access"
    return None


def is_camera_list(head: bytes) -> bool:
    """Tell whether a file that begins with these bytes is a cameras.json, as beside a training."""
    return head.startswith(b"[") and b'"rotation"' in head and b'"position"' in head


def is_tileset(values: dict[str, Any]) -> bool:
    """Tell whether a JSON object is a tileset of 3D Tiles, which has an asset as a glTF has."""
    return "root" in values and ("geometricError" in values or "asset" in values)


def _content(tile: Any) -> str | None:
    """Return the name of the first file that a tile or one of its children leads to."""
    waiting, seen = [tile], 0
    while waiting and seen < 1000:
        tile, seen = waiting.pop(0), seen + 1
        if not isinstance(tile, dict):
            continue
        contents = tile.get("contents")
        for content in [tile.get("content"), *(contents if isinstance(contents, list) else [])]:
            uri = content.get("uri", content.get("url")) if isinstance(content, dict) else None
            if isinstance(uri, str):
                return uri
        children = tile.get("children")
        waiting += children if isinstance(children, list) else []
    return None


def _parsed(text: bytes) -> Any:
    try:
        return parse_json(text, object, "a scene", partial(CorruptFileError, ""))
    except CorruptFileError:
        return None
