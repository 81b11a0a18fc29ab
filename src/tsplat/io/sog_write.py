"""A scene as a SOG of version 2, zipped: each value a byte or two in a plane, splats in Morton order.

Source: the SOG specification on developer.playcanvas.com, and what PlayCanvas' *splat-transform* writes: the sizes
of planes and of the palette.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
from dataclasses import replace
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from tsplat.framing import Bulk, bulk
from tsplat.importance import importance
from tsplat.io.compressed_ply_write import morton_order
from tsplat.io.losses import brought_nearer, counted, too_far
from tsplat.io.sog import META_NAME
from tsplat.io.sog_codebook import fit_codebook, nearest_levels
from tsplat.io.sog_meta import ANTIALIASED, PALETTE_MAX
from tsplat.io.sog_palette import fit_palette
from tsplat.io.sog_splats import COEFFICIENTS, QUAT_TAG, ROW_CENTROIDS
from tsplat.scene import Gaussians

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
U8 = npt.NDArray[np.uint8]
Planes = dict[str, bytes]
Field = dict[str, Any]

MEANS_STEPS = 0xFFFF

ROOM = 4.0
"""Radii of the bulk about its middle in which everything keeps its place."""

LEAST_STEPS = 1024
"""The bulk has at least so many steps to a radius: 0.1 pixels in a picture of 240 rows."""

BANDS_MAX = 3

PALETTE_LEAST = 1024
"""A smaller scene has a colour for each splat."""

TINY = float(np.finfo(np.float32).tiny)

SH_REACH = 1e4
"""Coefficients beyond degree 0 are kept within plus and minus this, where squares do not overflow."""

LEAST_WEIGHT = 0.01
"""What every value weighs beside its share, where 1 is the mean: small splats have scales and colours, too."""


def write(file: BinaryIO, gaussians: Gaussians) -> list[str]:
    """Write a zipped SOG, and return what of its range is cut.

    Values become the nearest that a byte or two can hold. Beyond degree 0, up to 65536 colours
    stand for all others; what is beyond degree 3 is left out.
    """
    box = bulk(gaussians)
    low, high = _bounds(gaussians.means, box)
    far = too_far(gaussians, low, high)
    problem = "far away are brought nearer, and made smaller by as much: else the bulk would lose detail"
    losses = counted(far, problem)
    scene = brought_nearer(gaussians, box, low, high) if far.any() else gaussians
    scene = replace(scene, extra=None).take(morton_order(scene.means))
    planes: Planes = {}
    meta: Field = {
        "version": 2,
        "asset": {"generator": "tsplat"},
        "count": len(scene),
        "means": _add_means(planes, scene.means),
        "scales": _add_scales(planes, scene.scales),
        "quats": _add_quats(planes, scene.quats),
        "sh0": _add_colors(planes, scene.sh[:, 0], scene.opacities),
    }
    if scene.antialiased:
        meta |= {"model": ANTIALIASED, "antialias": True}
    if len(scene) and scene.sh_degree:
        meta["shN"] = _add_palette(planes, scene)
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in {META_NAME: json.dumps(meta).encode(), **planes}.items():
            # An entry without a time: the same scene makes the same bytes.
            archive.writestr(zipfile.ZipInfo(name), content)
    return losses


def _bounds(means: F32, box: Bulk) -> tuple[F64, F64]:
    """Return the box in which steps are fine enough for the bulk: around everything, unless that is too much."""
    if not len(means):
        return box.low, box.high
    inner = _logs(np.stack([box.center - ROOM * box.radius, box.center + ROOM * box.radius]))
    # A step is as much longer as the coordinate, and 1, at which it is.
    most = MEANS_STEPS / LEAST_STEPS * box.radius / (1.0 + np.abs(box.center) + box.radius)
    spare = np.maximum(most - (inner[1] - inner[0]), 0.0) / 2.0
    all_logs = _logs(np.stack([means.min(axis=0), means.max(axis=0)]))
    fits = all_logs[1] - all_logs[0] <= most
    low, high = np.where(fits, all_logs[0], inner[0] - spare), np.where(fits, all_logs[1], inner[1] + spare)
    edges = np.sign([low, high]) * np.expm1(np.abs([low, high]))
    return np.where(fits, means.min(axis=0), edges[0]), np.where(fits, means.max(axis=0), edges[1])


def _logs(means: npt.NDArray[np.floating]) -> F64:
    logs: F64 = np.sign(means) * np.log1p(np.abs(means.astype(np.float64)))
    return logs


def _add_means(planes: Planes, means: F32) -> Field:
    logs = _logs(means)
    mins, maxs = (logs.min(axis=0), logs.max(axis=0)) if len(logs) else (np.zeros(3), np.zeros(3))
    steps = np.rint((logs - mins) * (MEANS_STEPS / np.where(maxs > mins, maxs - mins, 1.0))).astype(np.uint16)
    files = [_add_rows(planes, "means_l", steps & 0xFF), _add_rows(planes, "means_u", steps >> 8)]
    return {"mins": mins.tolist(), "maxs": maxs.tolist(), "files": files}


def _add_scales(planes: Planes, scales: F32) -> Field:
    logs = np.log(np.maximum(scales, np.float32(TINY)))
    # A hundredth of a large one shows, of a tiny one it does not.
    codebook = fit_codebook(logs, _weights(scales))
    return {"codebook": codebook.tolist(), "files": [_add_rows(planes, "scales", nearest_levels(logs, codebook))]}


def _add_quats(planes: Planes, quats: F32) -> Field:
    # A quat and its negative are one rotation: the largest component is made positive and left out.
    largest = np.abs(quats).argmax(axis=1)[:, None]
    upright = quats * np.where(np.take_along_axis(quats, largest, axis=1) < 0, -1, 1)
    others = np.take_along_axis(upright, np.arange(3) + (np.arange(3) >= largest), axis=1)
    small = np.rint((others * math.sqrt(0.5) + 0.5) * 255)
    return {"files": [_add_rows(planes, "quats", np.concatenate([small, QUAT_TAG + largest], axis=1))]}


def _add_colors(planes: Planes, sh0: F32, opacities: F32) -> Field:
    codebook = fit_codebook(sh0)
    rows = np.concatenate([nearest_levels(sh0, codebook), np.rint(opacities[:, None] * 255)], axis=1)
    return {"codebook": codebook.tolist(), "files": [_add_rows(planes, "sh0", rows)]}


def _add_palette(planes: Planes, scene: Gaussians) -> Field:
    bands = min(scene.sh_degree, BANDS_MAX)
    k = COEFFICIENTS[bands]
    colors = np.clip(scene.sh[:, 1 : 1 + k], -SH_REACH, SH_REACH).reshape(len(scene), 3 * k)
    # The root, as a few splats of the background would else take all colours.
    weights = _weights(np.sqrt(importance(scene.scales, scene.opacities)))
    centroids, labels = fit_palette(colors, weights, _palette_size(len(scene)))
    codebook = fit_codebook(centroids)
    pixels = nearest_levels(centroids, codebook).reshape(-1, 3)
    shape = (math.ceil(len(centroids) / ROW_CENTROIDS), ROW_CENTROIDS * k)
    files = [
        _add_plane(planes, "shN_centroids", pixels, shape),
        _add_rows(planes, "shN_labels", np.stack([labels & 0xFF, labels >> 8], axis=1)),
    ]
    return {"count": len(centroids), "bands": bands, "codebook": codebook.tolist(), "files": files}


def _palette_size(count: int) -> int:
    return min(PALETTE_MAX, max(PALETTE_LEAST, 1 << count.bit_length() - 1))


def _weights(sizes: F32) -> F32:
    # How much each matters, 1 in the mean.
    mean = np.mean(sizes, dtype=np.float64) if sizes.size else 0.0
    weights: F32 = (sizes / max(float(mean), TINY) + LEAST_WEIGHT).astype(np.float32)
    return weights


def _add_rows(planes: Planes, name: str, rows: npt.NDArray[Any]) -> str:
    # A pixel for each splat; sides are multiples of four, as other writers have them.
    width = 4 * max(1, math.ceil(math.sqrt(len(rows)) / 4))
    return _add_plane(planes, name, rows, (4 * max(1, math.ceil(len(rows) / width / 4)), width))


def _add_plane(planes: Planes, name: str, rows: npt.NDArray[Any], shape: tuple[int, int]) -> str:
    from PIL import Image

    pixels = np.zeros((shape[0] * shape[1], 4), np.uint8)
    pixels[:, 3] = 255
    pixels[: len(rows), : rows.shape[1]] = rows
    stream = io.BytesIO()
    image = Image.fromarray(pixels.reshape(*shape, 4))
    # Exact: colours stay as they are where the fourth byte, no transparency here, is 0.
    image.save(stream, "WEBP", lossless=True, exact=True)
    planes[f"{name}.webp"] = stream.getvalue()
    return f"{name}.webp"
