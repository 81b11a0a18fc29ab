"""Streamed SOGs made of a scene: leaves cut along x, each with levels of half as many splats, a file for each."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from tsplat import io
from tsplat.lod import decimate
from tsplat.scene import Gaussians


def write_stream(folder: Path, gaussians: Gaussians, leaves: int, levels: int) -> Path:
    """Write a scene; return the path of its lod-meta.json. The files of level 2 begin with ``2_``."""
    inner = np.quantile(gaussians.means[:, 0], np.arange(1, leaves) / leaves)
    names: list[str] = []
    lods: list[dict[str, Any]] = [{} for _ in range(leaves)]
    for level in range(levels):
        coarse = decimate(gaussians, len(gaussians) >> level)
        leaf_of = np.searchsorted(inner, coarse.means[:, 0])
        for leaf in range(leaves):
            part = coarse.take(np.flatnonzero(leaf_of == leaf))
            lods[leaf][str(level)] = {"file": len(names), "offset": 0, "count": len(part)}
            names.append(f"{level}_{leaf}.sog")
            io.save(folder / names[-1], part)
    children = [{"bound": {}, "lods": each} for each in lods]
    return write_meta(folder, names, levels, children)


def write_meta(folder: Path, names: list[str], levels: int, children: list[Any], **more: object) -> Path:
    """Write a lod-meta.json with these leaves; return its path."""
    tree = {"lodLevels": levels, "environment": None, "filenames": names, "tree": {"children": children}, **more}
    path = folder / "lod-meta.json"
    path.write_text(json.dumps(tree))
    return path
