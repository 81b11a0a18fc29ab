"""Fewer, merged splats: for the size on screen, or for good."""

from tsplat.lod.decimate import decimate

__all__ = ["decimate"]
