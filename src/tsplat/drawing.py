"""A scene drawn, wherever it lies: in memory, or on disk."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

from tsplat.camera import Camera
from tsplat.errors import CameraError, OptionError, shown
from tsplat.given import whole
from tsplat.rendering import Rendering, RenderOptions, own_antialias
from tsplat.scene import Gaussians, a_scene

if TYPE_CHECKING:
    from tsplat.lod import Stored


def render(scene: Gaussians | Stored, camera: Camera, *, lod: bool | int = False, **options: Any) -> Rendering:
    """Draw a scene; the first call compiles or loads the kernels, later calls reuse them.

    Parameters
    ----------
    scene : Gaussians or Stored
        What to draw: in memory, a .tsplat on disk, from `tsplat.lod.open_stored`, or a streamed SOG with its own
        levels of detail, from `tsplat.lod.open_streamed`.
    camera : Camera
        From where, and how large.
    lod : bool or int
        Draw about so many splats, merged where that shows least; True means 2.5 for each pixel, False all.
        Levels of detail that a scene does not have are built on the first such call, in seconds for millions of
        splats, and kept.
    **options
        Fields of `RenderOptions`: sh_degree, antialias, background, threads, ... Without ``antialias`` a scene
        trained with antialiasing is drawn with ``mip``, others with ``classic``.

    Returns
    -------
    Rendering
        float32 ``colors`` [H, W, 3], ``alphas`` [H, W] and ``depths`` [H, W].

    Raises
    ------
    OptionError
        An option is out of its range, or there is none of that name.
    SceneError, CameraError
        What is given is no scene, or no camera.
    """
    if not hasattr(scene, "antialiased"):
        a_scene(scene)
    if not isinstance(camera, Camera):
        raise CameraError(f"camera must be a tsplat.Camera, got {shown(camera)}")
    if unknown := options.keys() - {field.name for field in fields(RenderOptions)}:
        raise OptionError(f"there is no option {shown(min(unknown))}; see help(tsplat.RenderOptions)")
    options.setdefault("antialias", own_antialias(scene.antialiased, "classic"))
    chosen = RenderOptions(**options)
    if lod is False:
        return draw_all(scene, camera, chosen)
    # Levels of detail are most kernels there are; who draws all does not wait for them.
    from tsplat.lod import default_budget, rasterize_within

    budget = default_budget(camera) if lod is True else whole("lod", lod, 1)
    return rasterize_within(scene, camera, chosen, budget)


def draw_all(scene: Gaussians | Stored, camera: Camera, options: RenderOptions) -> Rendering:
    """Draw every splat; see `tsplat.raster.rasterize`."""
    # What is not needed is not imported: levels of detail are most kernels there are.
    if isinstance(scene, Gaussians):
        from tsplat.raster import rasterize

        return rasterize(scene, camera, options)
    from tsplat.lod import rasterize_all

    return rasterize_all(scene, camera, options)
