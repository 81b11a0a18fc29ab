"""3D Gaussian splat scenes in any terminal, on the CPU: live, over SSH, or as images.

>>> import tsplat
>>> scene = tsplat.load("garden.ply")
>>> camera = tsplat.Camera.look_at((0, 0, -3), (0, 0, 0), (0, -1, 0), width=1280, height=720, fov_y=55.0)
>>> tsplat.render(scene, camera).save("garden.png")
"""

# Nothing is imported before it is asked for, not even by annotations: ``python -m tsplat`` comes here while a
# numpy.py, or a typing.py, in the current folder would still be taken for the real one.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from tsplat.camera import Camera
    from tsplat.drawing import render
    from tsplat.errors import TsplatError
    from tsplat.io import load
    from tsplat.rendering import Rendering, RenderOptions
    from tsplat.scene import Gaussians

__all__ = ["Camera", "Gaussians", "RenderOptions", "Rendering", "TsplatError", "load", "render"]
__version__ = "0.1.0"

_MODULES = {
    "Camera": "camera",
    "Gaussians": "scene",
    "RenderOptions": "rendering",
    "Rendering": "rendering",
    "TsplatError": "errors",
    "load": "io",
    "render": "drawing",
}


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module 'tsplat' has no attribute '{name}'")
    from importlib import import_module

    found = globals()[name] = getattr(import_module(f"tsplat.{_MODULES[name]}"), name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
