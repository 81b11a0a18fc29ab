"""SOG scenes for the tests: planes and meta.json made up here, packed by zipfile and Pillow, decoded slowly."""

from __future__ import annotations

import io
import json
import math
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

SH_COEFFICIENTS = (0, 3, 8, 15)
SH_DEGREE_0 = ("means_l", "means_u", "quats", "scales", "sh0")


@dataclass
class Scene:
    """A meta.json and the planes it names, as arrays of bytes."""

    meta: dict[str, Any]
    planes: dict[str, np.ndarray]

    def files(self, encode: Any = None) -> dict[str, bytes]:
        """Return the contents of all files by name."""
        files = {f"{name}.webp": (encode or webp)(pixels) for name, pixels in self.planes.items()}
        return {"meta.json": json.dumps(self.meta).encode(), **files}

    def zipped(self, kind: int = zipfile.ZIP_STORED) -> bytes:
        """Return the bytes of a .sog file."""
        return zipped(self.files(), kind)


def zipped(files: dict[str, bytes], kind: int = zipfile.ZIP_STORED) -> bytes:
    """Return a zip archive of files."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", kind) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def webp(pixels: np.ndarray) -> bytes:
    """Return a lossless WebP image that keeps colours under clear pixels, too."""
    buffer = io.BytesIO()
    Image.fromarray(pixels, "RGBA").save(buffer, "WEBP", lossless=True, exact=True, quality=0, method=0)
    return buffer.getvalue()


def write_folder(folder: Path, files: dict[str, bytes]) -> Path:
    """Write files beside each other and return the path of their meta.json."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder / "meta.json"


def made_up(rng: np.random.Generator, count: int = 7, bands: int = 1, size: tuple[int, int] = (4, 2)) -> Scene:
    """Return a scene of version 2 with random bytes everywhere."""
    width, height = size
    names = SH_DEGREE_0 if bands == 0 else (*SH_DEGREE_0, "shN_labels")
    planes = {name: rng.integers(0, 256, (height, width, 4), dtype=np.uint8) for name in names}
    planes["quats"][..., 3] = rng.integers(252, 256, (height, width))
    # The smallest three of a unit quat stay within a ball.
    planes["quats"][..., :3] = rng.integers(70, 186, (height, width, 3))
    planes["scales"] %= 16
    meta: dict[str, Any] = {
        "version": 2,
        "count": count,
        "means": {"mins": [-1.5, -0.5, 0.25], "maxs": [2.0, 0.75, 3.0], "files": ["means_l.webp", "means_u.webp"]},
        "scales": {"codebook": rounded(rng.uniform(-7, -2, 16)), "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": {"codebook": rounded(rng.uniform(-2, 2, 256)), "files": ["sh0.webp"]},
    }
    if bands:
        planes["shN_labels"][..., 1] = 0
        planes["shN_labels"][..., 0] %= 70
        planes["shN_centroids"] = rng.integers(0, 256, (2, 64 * SH_COEFFICIENTS[bands], 4), dtype=np.uint8) % 32
        meta["shN"] = {
            "count": 70,
            "bands": bands,
            "codebook": rounded(rng.uniform(-1, 1, 32)),
            "files": ["shN_centroids.webp", "shN_labels.webp"],
        }
    return Scene(meta, planes)


def made_up_old(rng: np.random.Generator, bands: int = 1) -> Scene:
    """Return a scene of version 1: ranges where version 2 has codebooks, and no count."""
    scene = made_up(rng, 7, bands)
    meta = scene.meta
    del meta["version"], meta["count"]
    meta["means"]["shape"] = [7, 3]
    meta["scales"] = {"mins": [-7, -6, -5], "maxs": [-2, -1.5, -1], "files": ["scales.webp"]}
    meta["sh0"] = {"mins": [-2, -1.5, -1, -5], "maxs": [2, 1.5, 1, 7], "files": ["sh0.webp"]}
    if bands:
        meta["shN"] = {"mins": -0.75, "maxs": 0.5, "files": meta["shN"]["files"]}
    return scene


def rounded(values: np.ndarray) -> list[float]:
    """Return numbers that are short in JSON."""
    return [round(float(value), 2) for value in values]


def read_slowly(scene: Scene, index: int) -> dict[str, list[float]]:
    """Return one splat, worked out number by number as the specification describes it."""
    meta, old = scene.meta, "version" not in scene.meta

    def pixel(name: str) -> list[int]:
        return [int(value) for value in scene.planes[name].reshape(-1, 4)[index]]

    def between(field: dict[str, Any], channel: int, share: float) -> float:
        low, high = (np.ravel(field[key])[channel] for key in ("mins", "maxs"))
        return float(low + (high - low) * share)

    def value(field: str, channel: int, byte: int) -> float:
        return between(meta[field], channel, byte / 255) if old else meta[field]["codebook"][byte]

    low, high, scales, color = pixel("means_l"), pixel("means_u"), pixel("scales"), pixel("sh0")
    logs = [between(meta["means"], axis, (256 * high[axis] + low[axis]) / 65535) for axis in range(3)]
    *three, tag = pixel("quats")
    quat = [(byte / 255 - 0.5) * math.sqrt(2) for byte in three]
    quat.insert(tag - 252, math.sqrt(1 - sum(each * each for each in quat)))
    sh = [value("sh0", channel, color[channel]) for channel in range(3)]
    if "shN" in meta:
        labels = pixel("shN_labels")
        k = scene.planes["shN_centroids"].shape[1] // 64
        row, column = divmod(labels[0] + 256 * labels[1], 64)
        for texel in scene.planes["shN_centroids"][row, column * k : column * k + k]:
            sh += [value("shN", 0 if old else channel, int(texel[channel])) for channel in range(3)]
    opacity = 1 / (1 + math.exp(-between(meta["sh0"], 3, color[3] / 255))) if old else color[3] / 255
    return {
        "means": [math.copysign(math.exp(abs(log)) - 1, log) for log in logs],
        "quats": quat,
        "scales": [math.exp(value("scales", axis, scales[axis])) for axis in range(3)],
        "opacities": [opacity],
        "sh": sh,
    }
