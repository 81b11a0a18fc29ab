"""A scene drawn within a budget of splats."""

from __future__ import annotations

from tsplat.camera import Camera
from tsplat.given import whole
from tsplat.lod.cut import Cut
from tsplat.lod.hierarchy import hierarchy
from tsplat.lod.stored import Stored
from tsplat.raster import rasterize, rasterize_blocks
from tsplat.rendering import Rendering, RenderOptions
from tsplat.scene import Gaussians, a_scene

SPLATS_A_PIXEL = 2.5
"""Splats drawn for each pixel where nobody says how many: more of them are hardly seen."""

LEAST_BUDGET, LARGEST_BUDGET = 20_000, 500_000
"""Splats that even the smallest picture gets, a few milliseconds, and that even the largest does."""


def rasterize_all(scene: Gaussians | Stored, camera: Camera, options: RenderOptions) -> Rendering:
    """Draw every splat of a scene, in memory or on disk; see `tsplat.raster.rasterize`.

    Raises
    ------
    CorruptFileError
        It is on disk, and its file changed.
    """
    if isinstance(scene, Stored):
        scene.read_rest()
        scene.tree.check()
        return rasterize_blocks(scene.tree.scene, scene.finest, camera, options)
    return rasterize(a_scene(scene), camera, options)


def rasterize_within(
    scene: Gaussians | Stored, camera: Camera, options: RenderOptions, budget: int, cut: Cut | None = None
) -> Rendering:
    """Draw a scene with about so many splats in sight, merged where that shows least.

    Parameters
    ----------
    scene : Gaussians or Stored
        What to draw; levels of detail that are not stored are built on the first call, and kept with the scene.
        Of a streamed one that is being read, what is there is drawn.
    camera : Camera
        From where, and how large.
    options : RenderOptions
        How.
    budget : int
        About so many splats in sight, though never fewer than 256; a scene of no more is drawn as it is.
    cut : Cut, optional
        What chose the splats of the last frame, so that nothing flickers between two levels.

    Returns
    -------
    Rendering
        As `tsplat.raster.rasterize` returns it.

    Raises
    ------
    CorruptFileError
        The scene is on disk, and its file changed.
    """
    budget = whole("budget", budget, 0)
    scene = scene if isinstance(scene, Stored) else a_scene(scene)
    if len(scene) <= budget and (isinstance(scene, Gaussians) or scene.complete):
        return rasterize_all(scene, camera, options)
    tree = scene.tree if isinstance(scene, Stored) else hierarchy(scene, options.worker_count)
    blocks = (cut or Cut(tree)).blocks(camera, options, budget)
    tree.check()
    return rasterize_blocks(tree.scene, blocks, camera, options)


def default_budget(camera: Camera) -> int:
    """Return how many splats a picture of this size gets where nobody says how many."""
    wanted = round(SPLATS_A_PIXEL * camera.width * camera.height)
    return min(max(LEAST_BUDGET, wanted), LARGEST_BUDGET)
