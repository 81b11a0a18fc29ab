"""A scene drawn, wherever it lies: in memory, or on disk."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tsplat.camera import Camera
from tsplat.rendering import Rendering, RenderOptions
from tsplat.scene import Gaussians

if TYPE_CHECKING:
    from tsplat.lod import Stored


def draw_all(scene: Gaussians | Stored, camera: Camera, options: RenderOptions) -> Rendering:
    """Draw every splat; see `tsplat.raster.rasterize`."""
    # What is not needed is not imported: levels of detail are most kernels there are.
    if isinstance(scene, Gaussians):
        from tsplat.raster import rasterize

        return rasterize(scene, camera, options)
    from tsplat.lod import rasterize_all

    return rasterize_all(scene, camera, options)
