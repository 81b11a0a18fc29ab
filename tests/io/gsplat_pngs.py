"""gsplat's PNG compression written and read back by the steps of its own code, in NumPy."""

from __future__ import annotations

import io
import json
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

Arrays = dict[str, npt.NDArray[np.float32]]
Files = dict[str, bytes]


def compressed(splats: Arrays, labels: npt.NDArray[Any] | None = None, bits: int = 6) -> Files:
    """Return the files of a scene as a trainer keeps it; its number of splats is a square.

    ``shN`` are the centroids, [n, k - 1, 3], of which each splat has the one that its label says.
    """
    splats = dict(splats, means=_log(splats["means"]))
    count = len(splats["means"])
    side = round(count**0.5)
    meta: dict[str, Any] = {}
    files: Files = {}
    for name, values in splats.items():
        if name == "shN":
            meta[name], files[f"{name}.npz"] = _palette(values, labels, count, bits)
            continue
        grid = values.reshape(side, side, -1)
        mins, maxs = grid.min((0, 1)), grid.max((0, 1))
        steps = 2**16 - 1 if name == "means" else 2**8 - 1
        with np.errstate(invalid="ignore"):
            shares = np.nan_to_num((grid - mins) / (maxs - mins))
        pixels = (shares * steps).round().astype(np.uint16)
        if name == "means":
            files["means_l.png"], files["means_u.png"] = _png(pixels & 0xFF), _png(pixels >> 8)
        else:
            files[f"{name}.png"] = _png(pixels.squeeze())
        meta[name] = {
            "shape": list(values.shape),
            "dtype": "float32",
            "mins": mins.tolist(),
            "maxs": maxs.tolist(),
        }
    return {"meta.json": json.dumps(meta).encode(), **files}


def decompressed(files: Files) -> Arrays:
    """Return what gsplat makes of the files: 64-bit arithmetic with 32-bit ranges, rounded at last."""
    meta = json.loads(files["meta.json"])
    splats = {}
    for name, fields in meta.items():
        mins, maxs = (np.array(fields[end], np.float32) for end in ("mins", "maxs"))
        if name == "shN":
            with np.load(io.BytesIO(files["shN.npz"])) as arrays:
                shares = (arrays["centroids"] / (2 ** fields["quantization"] - 1))[arrays["labels"]]
        elif name == "means":
            low, high = (_pixels(files[f"means_{half}.png"]) for half in "lu")
            shares = ((high.astype(np.uint16) << 8) + low) / (2**16 - 1)
        else:
            shares = _pixels(files[f"{name}.png"]) / (2**8 - 1)
        splats[name] = (shares * (maxs - mins) + mins).reshape(fields["shape"]).astype(np.float32)
    splats["means"] = np.sign(splats["means"]) * np.expm1(np.abs(splats["means"]))
    return splats


def _palette(centroids: Any, labels: Any, count: int, bits: int) -> tuple[dict[str, Any], bytes]:
    mins, maxs = centroids.min(), centroids.max()
    shares = (centroids.reshape(len(centroids), -1) - mins) / (maxs - mins)
    stream = io.BytesIO()
    quantized = (shares * (2**bits - 1)).round().astype(np.uint8)
    np.savez_compressed(stream, centroids=quantized, labels=labels.astype(np.uint16))
    about = {"shape": [count, *centroids.shape[1:]], "dtype": "float32", "mins": float(mins), "maxs": float(maxs)}
    return {**about, "quantization": bits}, stream.getvalue()


def _log(values: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    return np.asarray(np.sign(values) * np.log1p(np.abs(values)), np.float32)


def _png(pixels: npt.NDArray[np.uint16]) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(pixels.astype(np.uint8)).save(stream, "PNG")
    return stream.getvalue()


def _pixels(content: bytes) -> npt.NDArray[np.uint8]:
    with Image.open(io.BytesIO(content)) as image:
        return np.asarray(image)
