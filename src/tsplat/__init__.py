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
from tsplat.rendering import Rendering, RenderOptions, own_antialias
from tsplat.scene import Gaussians

if TYPE_CHECKING:
    from tsplat.io import load

__all__ = ["Camera", "Gaussians", "RenderOptions", "Rendering", "TsplatError", "load", "render"]
__version__ = "0.1.0"


def render(scene: Gaussians, camera: Camera, **options: Any) -> Rendering:
    """Draw a scene; the first call compiles or loads the kernels, later calls reuse them.

    Parameters
    ----------
    scene : Gaussians
        What to draw.
    camera : Camera
        From where, and how large.
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
    from tsplat.raster import rasterize  # brings in Numba, which `import tsplat` should not wait for

    options.setdefault("antialias", own_antialias(scene.antialiased, "classic"))
    return rasterize(scene, camera, RenderOptions(**options))


def __getattr__(name: str) -> Any:
    if name == "load":
        from tsplat.io import load

        return load
    raise AttributeError(f"module 'tsplat' has no attribute '{name}'")
