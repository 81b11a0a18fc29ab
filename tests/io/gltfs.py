"""glTF files made by hand for the tests, one object after the other."""

from __future__ import annotations

import base64
import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tsplat import io
from tsplat.scene import Gaussians

EXTENSION = "KHR_gaussian_splatting"
CODES = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "uint32": 5125, "float32": 5126}
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
SPLATTING = {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}


@dataclass
class Made:
    """A glTF in the making: its JSON, and the one buffer."""

    root: dict[str, Any] = field(
        default_factory=lambda: {
            "asset": {"version": "2.0"},
            "extensionsUsed": [EXTENSION],
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": []}],
            "accessors": [],
            "bufferViews": [],
            "buffers": [{"byteLength": 0}],
        }
    )
    content: bytearray = field(default_factory=bytearray)

    def view(self, raw: bytes, **more: Any) -> int:
        """Add bytes at the next multiple of four."""
        self.content += bytes(-len(self.content) % 4)
        at = {"buffer": 0, "byteOffset": len(self.content), "byteLength": len(raw)}
        self.root["bufferViews"].append(at | more)
        self.content += raw
        return len(self.root["bufferViews"]) - 1

    def accessor(self, values: npt.ArrayLike, dtype: str = "float32", **more: Any) -> int:
        """Add rows of numbers of their own."""
        rows = np.asarray(values, dtype)
        rows = rows.reshape(len(rows), -1)
        described = {
            "bufferView": self.view(rows.tobytes()),
            "componentType": CODES[dtype],
            "count": len(rows),
            "type": KINDS[rows.shape[1]],
        }
        self.root["accessors"].append(described | more)
        return len(self.root["accessors"]) - 1

    def primitive(self, attributes: dict[str, int], mesh: int = 0, **more: Any) -> dict[str, Any]:
        """Add a primitive of splats."""
        added = {"mode": 0, "attributes": attributes, "extensions": {EXTENSION: dict(SPLATTING)}} | more
        self.root["meshes"][mesh]["primitives"].append(added)
        return added

    def glb(self) -> bytes:
        """Return the whole file as a GLB."""
        self.root["buffers"][0]["byteLength"] = len(self.content)
        return glb(json.dumps(self.root, separators=(",", ":")).encode(), bytes(self.content))

    def gltf(self, uri: str = "") -> bytes:
        """Return the JSON alone, the buffer at a URI or as base64."""
        encoded = "data:application/gltf-buffer;base64," + base64.b64encode(self.content).decode()
        self.root["buffers"][0] = {"byteLength": len(self.content), "uri": uri or encoded}
        return json.dumps(self.root, separators=(",", ":")).encode()


def glb(text: bytes, content: bytes | None, version: int = 2) -> bytes:
    """Return chunks in the container."""
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if content is not None:
        content += bytes(-len(content) % 4)
        chunks += struct.pack("<I4s", len(content), b"BIN\0") + content
    return struct.pack("<4sII", b"glTF", version, 12 + len(chunks)) + chunks


def attributes_of(made: Made, gaussians: Gaussians, prefix: str = f"{EXTENSION}:") -> dict[str, int]:
    """Add the arrays of a scene as they are, with no axes turned."""
    attributes = {
        "POSITION": made.accessor(gaussians.means),
        f"{prefix}ROTATION": made.accessor(gaussians.quats[:, [1, 2, 3, 0]]),
        f"{prefix}SCALE": made.accessor(gaussians.scales),
        f"{prefix}OPACITY": made.accessor(gaussians.opacities),
    }
    for degree in range(gaussians.sh_degree + 1):
        for m in range(2 * degree + 1):
            name = f"{prefix}SH_DEGREE_{degree}_COEF_{m}"
            attributes[name] = made.accessor(gaussians.sh[:, degree**2 + m])
    return attributes


def scene_of(gaussians: Gaussians) -> Made:
    """Return a glTF of one primitive with the arrays of a scene."""
    made = Made()
    made.primitive(attributes_of(made, gaussians))
    return made


def load_made(folder: Path, made: Made | bytes, name: str = "scene.glb", **options: Any) -> Gaussians:
    """Write a file and load it."""
    path = folder / name
    path.write_bytes(made if isinstance(made, bytes) else made.glb())
    return io.load(path, **options)


def check_alike(found: Gaussians, expected: Gaussians) -> None:
    """Compare two scenes splat by splat; a quat and its negative are the same."""
    np.testing.assert_allclose(found.means, expected.means, rtol=2e-6, atol=2e-6)
    np.testing.assert_allclose(found.scales, expected.scales, rtol=1e-5)
    np.testing.assert_array_equal(found.opacities, expected.opacities)
    np.testing.assert_allclose(found.sh, expected.sh, atol=4e-6)
    np.testing.assert_allclose(np.abs(np.sum(found.quats * expected.quats, axis=1)), 1.0, atol=1e-6)
