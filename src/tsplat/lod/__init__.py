"""Fewer, merged splats: for the size on screen, or for good."""

from tsplat.lod.cut import Cut
from tsplat.lod.decimate import decimate
from tsplat.lod.draw import default_budget, rasterize_within
from tsplat.lod.hierarchy import Hierarchy, hierarchy

__all__ = ["Cut", "Hierarchy", "decimate", "default_budget", "hierarchy", "rasterize_within"]
