"""3D Gaussian splat scenes in any terminal, on the CPU: live, over SSH, or as images.

>>> import tsplat
>>> scene = tsplat.load("garden.ply")
>>> camera = tsplat.Camera.look_at((0, 0, -3), (0, 0, 0), (0, -1, 0), width=1280, height=720, fov_y=55.0)
>>> tsplat.render(scene, camera).save("garden.png")
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tsplat.camera import Camera
from tsplat.errors import TsplatError
from tsplat.given import whole
from tsplat.rendering import Rendering, RenderOptions, own_antialias
from tsplat.scene import Gaussians, a_scene

if TYPE_CHECKING:
    from tsplat.io import load
    from tsplat.lod import Stored

__all__ = ["Camera", "Gaussians", "RenderOptions", "Rendering", "TsplatError", "load", "render"]
__version__ = "0.1.0"


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
        An option is out of its range.
    """
    if not hasattr(scene, "antialiased"):
        a_scene(scene)
    options.setdefault("antialias", own_antialias(scene.antialiased, "classic"))
    chosen = RenderOptions(**options)
    if lod is False:
        from tsplat.drawing import draw_all

        return draw_all(scene, camera, chosen)
    # Levels of detail are most kernels there are; `import tsplat` does not wait for them.
    from tsplat.lod import default_budget, rasterize_within

    budget = default_budget(camera) if lod is True else whole("lod", lod, 1)
    return rasterize_within(scene, camera, chosen, budget)


def __getattr__(name: str) -> Any:
    if name == "load":
        from tsplat.io import load

        return load
    raise AttributeError(f"module 'tsplat' has no attribute '{name}'")
