"""A scene as glTF with KHR_gaussian_splatting: one mesh of points, its float32 numbers attribute by attribute.

Source: KHR_gaussian_splatting of the KhronosGroup/glTF repository, and the glTF 2.0 specification.
"""

from __future__ import annotations

import binascii
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from tsplat.errors import SaveError
from tsplat.io.gltf_colors import to_linear
from tsplat.io.gltf_document import CHUNK, HEADER, MAGIC
from tsplat.io.gltf_primitives import COLOR_SPACES, EXTENSION
from tsplat.scene import SH_C0, Gaussians
from tsplat.sh_rotation import sh_rotation

MEANS_SIGNS = np.array([-1.0, -1.0, 1.0], np.float32)
"""Half a turn about z, from our axes to +Y up."""

QUATS_ORDER = [2, 1, 0, 3]
QUATS_SIGNS = np.array([1.0, -1.0, -1.0, 1.0], np.float32)
"""The quat of that turn, which undoes what the reader does, times another one, as ``xyzw``."""

CHUNK_SPLATS = 1 << 16
"""Splats written at a time."""

GLB_BYTES = (1 << 32) - 1

SH_DEGREE = 3
"""The extension has no names for higher ones."""

POINTS = 0
ARRAY_BUFFER = 34962
COMPONENTS = {"f4": 5126, "u1": 5121}

F32 = npt.NDArray[np.float32]
Values = Callable[[slice], npt.NDArray[Any]]


@dataclass(frozen=True, slots=True)
class Column:
    """An attribute.

    Attributes
    ----------
    name, kind : str
        As glTF has them.
    code, row_bytes : str, int
        NumPy's type of its numbers, and how many bytes a splat takes.
    values : callable
        Gives those of some splats.
    """

    name: str
    kind: str
    code: str
    row_bytes: int
    values: Values


def write_glb(file: BinaryIO, gaussians: Gaussians) -> list[str]:
    """Write a GLB.

    Parameters
    ----------
    file : binary file
        Open for writing.
    gaussians : Gaussians
        The scene; harmonics above degree 3 are left out.

    Raises
    ------
    SaveError
        There are no splats, or more than 4 GiB of them: the format has room for neither.
    """
    columns = _columns(gaussians)
    size = len(gaussians) * sum(column.row_bytes for column in columns)
    text = json.dumps(_describe(gaussians, columns, None), separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    length = HEADER.size + CHUNK.size + len(text) + CHUNK.size + size
    if length > GLB_BYTES:
        raise SaveError(f"the scene needs {length} bytes, a GLB holds up to {GLB_BYTES}; save as .gltf or .ply")
    file.write(HEADER.pack(MAGIC, 2, length) + CHUNK.pack(len(text), b"JSON") + text + CHUNK.pack(size, b"BIN\0"))
    for piece in _pieces(gaussians, columns):
        file.write(piece)
    return []


def write_gltf(file: BinaryIO, gaussians: Gaussians) -> list[str]:
    """Write a .gltf that holds its numbers as base64; the parameters are those of `write_glb`.

    Raises
    ------
    SaveError
        There are no splats.
    """
    columns = _columns(gaussians)
    uri = "data:application/octet-stream;base64,"
    before, _, after = json.dumps(_describe(gaussians, columns, uri), separators=(",", ":")).partition(uri)
    file.write((before + uri).encode())
    rest = b""
    for piece in _pieces(gaussians, columns):
        whole = rest + piece
        cut = len(whole) - len(whole) % 3
        file.write(binascii.b2a_base64(whole[:cut], newline=False))
        rest = whole[cut:]
    file.write(binascii.b2a_base64(rest, newline=False) + after.encode())
    return []


def _columns(gaussians: Gaussians) -> list[Column]:
    if not len(gaussians):
        raise SaveError("the scene has no splats, and a glTF cannot say so; save as .ply")

    def harmonics(index: int) -> Values:
        return lambda part: gaussians.sh[part, index] * signs[index]

    degree = min(gaussians.sh_degree, SH_DEGREE)
    signs = sh_rotation(np.diag(MEANS_SIGNS), degree).diagonal().astype(np.float32)
    columns = [
        Column("POSITION", "VEC3", "f4", 12, lambda part: gaussians.means[part] * MEANS_SIGNS),
        Column("COLOR_0", "VEC4", "u1", 4, lambda part: _colors(gaussians, part)),
        _ours("ROTATION", "VEC4", 16, lambda part: gaussians.quats[part][:, QUATS_ORDER] * QUATS_SIGNS),
        _ours("SCALE", "VEC3", 12, lambda part: gaussians.scales[part]),
        _ours("OPACITY", "SCALAR", 4, lambda part: gaussians.opacities[part]),
    ]
    names = [f"SH_DEGREE_{n}_COEF_{m}" for n in range(degree + 1) for m in range(2 * n + 1)]
    return columns + [_ours(name, "VEC3", 12, harmonics(index)) for index, name in enumerate(names)]


def _ours(name: str, kind: str, row_bytes: int, values: Values) -> Column:
    return Column(f"{EXTENSION}:{name}", kind, "f4", row_bytes, values)


def _colors(gaussians: Gaussians, part: slice) -> npt.NDArray[np.uint8]:
    """Return what others may draw points with: linear light, and opacity."""
    shown = np.clip(0.5 + SH_C0 * gaussians.sh[part, 0], 0.0, 1.0)
    values: F32 = np.column_stack([to_linear(shown), gaussians.opacities[part]])
    bytes_: npt.NDArray[np.uint8] = np.rint(values * 255.0).astype(np.uint8)
    return bytes_


def _pieces(gaussians: Gaussians, columns: list[Column]) -> Iterator[bytes]:
    for column in columns:
        for first in range(0, len(gaussians), CHUNK_SPLATS):
            yield column.values(slice(first, first + CHUNK_SPLATS)).astype("<" + column.code).tobytes()


def _translation(gaussians: Gaussians) -> dict[str, list[float]]:
    """Return where the scene's origin is: numbers of a JSON are float64, those of a splat float32."""
    if not gaussians.origin:
        return {}
    return {
        "translation": [value * float(sign) for value, sign in zip(gaussians.origin, MEANS_SIGNS, strict=True)]
    }


def _describe(gaussians: Gaussians, columns: list[Column], uri: str | None) -> dict[str, Any]:
    """Return the JSON of a file whose buffer has one column after the other."""
    count, offset = len(gaussians), 0
    views, accessors = [], []
    for index, column in enumerate(columns):
        size = count * column.row_bytes
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": size, "target": ARRAY_BUFFER})
        accessors.append(
            {"bufferView": index, "componentType": COMPONENTS[column.code], "count": count, "type": column.kind}
            | ({"normalized": True} if column.code == "u1" else {})
        )
        offset += size
    ends = gaussians.means.min(axis=0) * MEANS_SIGNS, gaussians.means.max(axis=0) * MEANS_SIGNS
    accessors[0] |= {"min": np.minimum(*ends).tolist(), "max": np.maximum(*ends).tolist()}
    splatting = {"kernel": "ellipse", "colorSpace": COLOR_SPACES[0]}
    primitive = {
        "attributes": {column.name: index for index, column in enumerate(columns)},
        "mode": POINTS,
        "extensions": {EXTENSION: splatting},
    }
    return {
        "asset": {"version": "2.0", "generator": "tsplat"},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0} | _translation(gaussians)],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": offset} | ({"uri": uri} if uri else {})],
    }
