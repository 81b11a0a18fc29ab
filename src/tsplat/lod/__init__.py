"""Fewer, merged splats: for the size on screen, or for good."""

from tsplat.lod.cut import Cut
from tsplat.lod.decimate import decimate
from tsplat.lod.draw import default_budget, rasterize_all, rasterize_within
from tsplat.lod.hierarchy import Hierarchy, hierarchy
from tsplat.lod.stored import Stored, open_stored, store
from tsplat.lod.streamed import Streamed, is_scattered, open_streamed, read_levels

__all__ = [
    "Cut", "Hierarchy", "Stored", "Streamed", "decimate", "default_budget", "hierarchy", "is_scattered",
    "open_stored", "open_streamed", "rasterize_all", "rasterize_within", "read_levels", "store",
]  # fmt: skip
