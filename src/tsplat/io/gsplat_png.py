"""gsplat's PNG compression: a meta.json with ranges, planes of bytes as PNG beside it, harmonics from a palette.

Source: ``PngCompression`` of nerfstudio-project/gsplat. This gives what its ``decompress`` does, to the bit but
for a last place of the means: log scales, logit opacities, means behind a symmetric logarithm in 16 bits.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from tsplat.io.finish import finish
from tsplat.io.npz_arrays import INTEGERS, read_array, read_header
from tsplat.io.options import LoadOptions
from tsplat.io.sog_files import Archive, Files, Folder
from tsplat.io.sog_json import Fields, read_fields
from tsplat.io.sog_planes import PIXELS_MAX
from tsplat.scene import SH_COEFFICIENTS, Gaussians

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
U8 = npt.NDArray[np.uint8]

SHAPES = {"means": (3,), "scales": (3,), "quats": (4,), "opacities": (), "sh0": (1, 3)}
"""What one splat has of each; harmonics come apart."""

MEANS = "means_l.png", "means_u.png"
PALETTE = "shN.npz"
PLANES = (*MEANS, *(f"{name}.png" for name in SHAPES if name != "means"))
"""Files that every scene has; their names are not in the meta.json."""

MODES = {(): "L", (3,): "RGB", (4,): "RGBA", (1, 3): "RGB"}
"""How Pillow calls the pixels of a plane, by the shape of what they hold."""

PALETTE_MAX = 1 << 16
SPARE_SPLATS = 1 << 16
"""More splats than this and than their means have bytes are a trap: sorted as well as can be, each takes one."""

HEAD_BYTES = 24
SPARE_BYTES = 1 << 16


class Range(NamedTuple):
    """What the lowest and the highest number of a plane stand for: one for all channels, or one for each."""

    mins: F32
    maxs: F32

    def of(self, shares: F64) -> F32:
        """Return what shares from 0 to 1 stand for, by the same steps and roundings as PyTorch's."""
        with np.errstate(over="ignore", invalid="ignore"):  # what becomes inf or nan is for finish to find
            return (shares * (self.maxs - self.mins) + self.mins).astype(np.float32)


def files_of(meta: dict[str, Any]) -> list[str]:
    """Return the names of the files beside a meta.json that holds this."""
    return [*PLANES, PALETTE] if meta.get("shN") else list(PLANES)


def read(path: Path, options: LoadOptions, progress: Callable[[float], None]) -> Gaussians:
    """Read the folder of a meta.json; see `tsplat.io.load` for the parameters.

    Raises
    ------
    CorruptFileError
        A file is missing or broken, or contradicts the meta.json.
    """
    files = Folder(path)
    fields = read_fields(files, path.name)
    count, k = _count(fields), _coefficients(fields)
    means = _means(files, fields.inner("means"), count)
    found = {}
    for done, name in enumerate(list(SHAPES)[1:], 2):
        found[name] = _plane(files, name, fields.inner(name), count)
        progress(done / 6)
    sh = found["sh0"].reshape(count, 1, 3)
    if k > 1:
        sh = np.concatenate([sh, _harmonics(path, fields.inner("shN"), count, k)], axis=1)
    progress(1.0)
    with np.errstate(over="ignore", invalid="ignore"):
        scales, opacities = np.exp(found["scales"]), np.reciprocal(1 + np.exp(-found["opacities"].reshape(-1)))
        return finish(path, means, found["quats"], scales, opacities, sh, max_splats=options.max_splats)


def _count(fields: Fields) -> int:
    counts = {name: _shape(fields.inner(name), shape)[0] for name, shape in SHAPES.items()}
    if len(set(counts.values())) > 1:
        listed = ", ".join(f"{name} {count}" for name, count in counts.items())
        raise fields.corrupt(f"has a different number of splats in each field: {listed}; write it again")
    return counts["means"]


def _coefficients(fields: Fields) -> int:
    """Return how many coefficients a colour has."""
    if not fields.has("shN"):
        return 1
    shape = fields.inner("shN").values.get("shape")
    known = [[_count(fields), k - 1, 3] for k in SH_COEFFICIENTS]
    if shape not in known:
        raise fields.inner("shN").wrong("shape", f"one of {', '.join(map(str, known))}")
    return 1 + int(shape[1])


def _shape(fields: Fields, rest: tuple[int, ...]) -> list[int]:
    shape = fields.values.get("shape")
    good = isinstance(shape, list) and len(shape) == 1 + len(rest) and shape[1:] == list(rest)
    if not isinstance(shape, list) or not good or type(shape[0]) is not int or not 0 <= shape[0] <= PIXELS_MAX:
        raise fields.wrong("shape", f"[N{''.join(f', {side}' for side in rest)}] with N from 0 to {PIXELS_MAX}")
    return shape


def _range(fields: Fields, channels: int) -> Range:
    with np.errstate(over="ignore"):
        ends = (fields.numbers(name, channels, channels).astype(np.float32) for name in ("mins", "maxs"))
        return Range(*ends)


def _means(files: Files, fields: Fields, count: int) -> F32:
    low, high = MEANS
    if not count:
        return np.zeros((0, 3), np.float32)
    size = files.size(low) + files.size(high)
    if count > SPARE_SPLATS + size:
        raise files.corrupt(low, f"and {high} hold {size} bytes, expected at least {count} for {count} splats")
    words = _pixels(files, high, count, (3,)).astype(np.uint16) << 8 | _pixels(files, low, count, (3,))
    logs = _range(fields, 3).of(words / (2**16 - 1))
    with np.errstate(over="ignore", invalid="ignore"):
        means: F32 = np.sign(logs) * np.expm1(np.abs(logs))
    return means


def _plane(files: Files, name: str, fields: Fields, count: int) -> F32:
    shape = SHAPES[name]
    if not count:
        return np.zeros((0, *shape), np.float32)
    pixels = _pixels(files, f"{name}.png", count, shape)
    return _range(fields, math.prod(shape)).of(pixels / (2**8 - 1))


def _harmonics(path: Path, fields: Fields, count: int, k: int) -> F32:
    if not count:
        return np.zeros((0, k - 1, 3), np.float32)
    bits = fields.count("quantization", 1, 8)
    with Archive(path.parent / PALETTE) as archive:
        heads = {name: read_header(archive, f"{name}.npy", INTEGERS) for name in ("centroids", "labels")}
        shape = heads["centroids"].shape
        if len(shape) != 2 or not 1 <= shape[0] <= PALETTE_MAX or shape[1] != 3 * (k - 1):
            problem = f"has shape {str(list(shape))[:60]}, expected 1 to {PALETTE_MAX} rows of {3 * (k - 1)}"
            raise archive.corrupt("centroids.npy", problem)
        if heads["labels"].shape != (count,):
            problem = f"has shape {str(list(heads['labels'].shape))[:60]}, expected [{count}]"
            raise archive.corrupt("labels.npy", problem)
        centroids, labels = (read_array(archive, f"{name}.npy", head) for name, head in heads.items())
        if labels.min() < 0 or labels.max() >= len(centroids):
            problem = f"holds label {labels.max():.0f} or one below 0, expected 0 to {len(centroids) - 1}"
            raise archive.corrupt("labels.npy", problem)
    palette = _range(fields, 1).of(centroids.astype(np.float64) / (2**bits - 1))
    return palette[labels.astype(np.intp)].reshape(count, k - 1, 3)


def _pixels(files: Files, name: str, count: int, shape: tuple[int, ...]) -> U8:
    """Return the pixels of a plane, one for each splat, of as many channels as the shape has.

    Raises
    ------
    CorruptFileError
        It is no PNG, broken, or of another size or kind; nothing was decoded where its header says so.
    """
    head = files.read(name, HEAD_BYTES)
    width, height = (int.from_bytes(head[start : start + 4], "big") for start in (16, 20))
    if not head.startswith(b"\x89PNG\r\n\x1a\n") or head[12:16] != b"IHDR":
        raise files.corrupt(name, f"begins with {head[:8]!r}, expected a PNG image")
    if width * height != count:
        raise files.corrupt(name, f"is {width}x{height} pixels, expected {count}, one for each splat")
    limit = 5 * count + SPARE_BYTES  # noise takes all its bytes, and a few for its tables
    encoded = files.read(name, limit + 1)
    if len(encoded) > limit:
        raise files.corrupt(name, f"holds more than {limit} bytes, expected less of {width}x{height} pixels")
    mode, pixels = _decoded(files, name, encoded)
    if mode != MODES[shape]:
        raise files.corrupt(name, f"has pixels of kind {mode}, expected {MODES[shape]} of 8 bits")
    return pixels.reshape(count, *shape)


def _decoded(files: Files, name: str, encoded: bytes) -> tuple[str, U8]:
    from PIL import Image

    try:
        with Image.open(io.BytesIO(encoded), formats=("PNG",)) as image:
            return image.mode, np.asarray(image)
    except (OSError, SyntaxError, RuntimeError, EOFError, ValueError, Image.DecompressionBombError) as error:
        raise files.corrupt(name, "cannot be decoded, expected a whole PNG image") from error
