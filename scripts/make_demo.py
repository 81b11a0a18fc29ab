"""Make the demo scene of the wheel from a level of a streamed SOG: ``make_demo.py SOURCE [TARGET]``.

SOURCE is the folder of one level (``meta.json`` and its images), e.g. ``../shared/scenes/playbot/2_0``.
The PLY is an ordinary one; it packs well in a wheel because splats near each other follow each other
and every value is rounded to a step that cannot be seen.

Source: the SOG format, version 2, https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog
"""

from __future__ import annotations

import json
import sys
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

from tsplat import io
from tsplat.scene import SH_COEFFICIENTS, Gaussians

F32 = npt.NDArray[np.float32]
U8 = npt.NDArray[np.uint8]

SH_DEGREE = 1
STEPS = {"means": 2**-12, "scales": 2**-3, "quats": 2**-6, "opacities": 2**-2, "sh0": 2**-5, "shN": 2**-4}
"""Rounding steps, those of scales and opacities for the logs and logits that the file holds. Together they
cost 0.05 dB against unrounded values, and degree 1 instead of 2 costs 1.6 dB; either saves a third."""


def main(arguments: list[str]) -> int:
    """Write the demo and say how large it is."""
    if len(arguments) not in (1, 2):
        print(__doc__)
        return 2
    target = Path(arguments[1]) if len(arguments) == 2 else io.demo_path()
    io.save(target, rounded(in_morton_order(read_sog(Path(arguments[0])))))
    raw = target.read_bytes()
    print(f"{target}: {len(raw) / 1e6:.2f} MB, {len(zlib.compress(raw, 6)) / 1e6:.2f} MB deflated")
    return 0


def read_sog(folder: Path) -> Gaussians:
    """Read an unbundled SOG, version 2."""
    meta = json.loads((folder / "meta.json").read_text())
    n = meta["count"]

    def pixels(field: str, index: int = 0) -> U8:
        with Image.open(folder / meta[field]["files"][index]) as image:
            return np.asarray(image.convert("RGBA")).reshape(-1, 4)[:n]

    low, high = (np.array(meta["means"][name]) for name in ("mins", "maxs"))
    fraction = (pixels("means", 1)[:, :3] * 256.0 + pixels("means")[:, :3]) / 65535.0
    logs = low + (high - low) * fraction
    sh0 = pixels("sh0")
    dc = np.array(meta["sh0"]["codebook"], np.float32)[sh0[:, :3]]
    return Gaussians(
        (np.sign(logs) * np.expm1(np.abs(logs))).astype(np.float32),
        _unpacked_quats(pixels("quats")),
        np.exp(np.array(meta["scales"]["codebook"])[pixels("scales")[:, :3]]).astype(np.float32),
        (sh0[:, 3] / 255.0).astype(np.float32),
        np.concatenate([dc[:, None], _higher_sh(folder, meta["shN"], pixels("shN", 1))], axis=1).astype(
            np.float32
        ),
    )


def in_morton_order(gaussians: Gaussians) -> Gaussians:
    """Return the same splats, neighbours in space next to each other."""
    low, high = gaussians.means.min(axis=0), gaussians.means.max(axis=0)
    cells = ((gaussians.means - low) / (high - low) * 1023.0).astype(np.uint64)
    code = np.zeros(len(gaussians), np.uint64)
    for bit in range(10):
        for axis in range(3):
            code |= ((cells[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return gaussians.take(np.argsort(code, kind="stable"))


def rounded(gaussians: Gaussians) -> Gaussians:
    """Return the scene as a file of few significant bits keeps it."""
    k = SH_COEFFICIENTS[SH_DEGREE]
    opacities = np.clip(gaussians.opacities.astype(np.float64), 1e-3, 1.0 - 1e-3)
    logits = _to_step(np.log(opacities / (1.0 - opacities)), "opacities")
    sh = np.concatenate([_to_step(gaussians.sh[:, :1], "sh0"), _to_step(gaussians.sh[:, 1:k], "shN")], axis=1)
    return Gaussians(
        _to_step(gaussians.means, "means"),
        _to_step(gaussians.quats * np.where(gaussians.quats[:, :1] < 0.0, -1.0, 1.0), "quats"),
        np.exp(_to_step(np.log(gaussians.scales), "scales")),
        (1.0 / (1.0 + np.exp(-logits))).astype(np.float32),
        sh,
    )


def _to_step(values: npt.NDArray[Any], name: str) -> F32:
    whole_steps: F32 = np.round(values / STEPS[name]).astype(np.float32)
    return whole_steps * np.float32(STEPS[name])


def _unpacked_quats(packed: U8) -> F32:
    # Three components in the colours; alpha - 252 tells which one, the largest, was left out.
    quats = np.zeros((len(packed), 4))
    small = (packed[:, :3] / 255.0 - 0.5) * np.sqrt(2.0)
    largest = packed[:, 3].astype(np.intp) - 252
    for left_out in range(4):
        rows = np.flatnonzero(largest == left_out)
        others = [axis for axis in range(4) if axis != left_out]
        quats[rows[:, None], others] = small[rows]
    quats[np.arange(len(quats)), largest] = np.sqrt(np.maximum(0.0, 1.0 - (small**2).sum(axis=1)))
    return quats.astype(np.float32)


def _higher_sh(folder: Path, meta: dict[str, Any], labels: U8) -> F32:
    # A palette: 64 entries to a row of the image, side by side the coefficients of each.
    coefficients = SH_COEFFICIENTS[meta["bands"]] - 1
    with Image.open(folder / meta["files"][0]) as image:
        entries = np.asarray(image.convert("RGB")).reshape(-1, coefficients, 3)
    label = labels[:, 0].astype(np.intp) + 256 * labels[:, 1].astype(np.intp)
    higher: F32 = np.array(meta["codebook"], np.float32)[entries[label]]
    return higher


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
