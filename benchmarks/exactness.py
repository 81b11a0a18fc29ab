"""How exact pictures are where few digits would show: dB against the float64 reference, and what is off.

python benchmarks/exactness.py
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import atan, degrees, radians, tan

import numpy as np
from tests.raster.compare import psnr
from tests.raster.test_exactness import needles, wall
from tests.scenes import random_gaussians

from tsplat.camera import Camera
from tsplat.raster import rasterize, reference
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

SIZE = {"width": 160, "height": 120}
Case = tuple[str, Gaussians, Camera]


def cases() -> Iterator[Case]:
    """Give scenes and cameras that few digits are hard on."""
    ahead = Camera.look_at((0, 0, 0), (0, 0, 1), (0, -1, 0), fov_y=40.0, **SIZE)
    for thickness in (1e-5, 1e-3, 1e-2):
        yield f"wall, {thickness:g} thick at 4", wall(thickness, 4.0), ahead
    cloud = random_gaussians(np.random.default_rng(3), 3000)
    for times in (1.0, 4.5, 18.0, 100.0):
        fov_y, eye = degrees(2 * atan(tan(radians(20)) / times)), (1.2 * times, 0.8 * times, -3.8 * times)
        yield f"{times:g} times as far", cloud, Camera.look_at(eye, (0, 0, 0), (0, -1, 0), fov_y=fov_y, **SIZE)
    for fov_y in (120.0, 174.0):
        camera = Camera.look_at((0.2, 0.1, -0.6), (0, 0, 0.2), (0, -1, 0), fov_y=fov_y, **SIZE)
        yield f"{fov_y:g} degrees", cloud, camera
    front = Camera.look_at((0.3, 0.2, -4), (0, 0, 0), (0, -1, 0), width=320, height=240, fov_y=40.0)
    for sigma, ratio in ((4, 1e3), (10, 1e3), (30, 1e3), (100, 1e3), (100, 1e4)):
        yield f"60 needles of sigma {sigma}, 1:{ratio:g}", needles(60, sigma, ratio), front
    opaque = replace(cloud, opacities=np.ones(len(cloud), np.float32))
    yield "opacity 1", opaque, Camera.look_at((1.2, 0.8, -3.8), (0, 0, 0), (0, -1, 0), fov_y=40.0, **SIZE)


def main() -> None:
    """Print a row for each case."""
    for name, gaussians, camera in cases():
        fast, slow = (draw(gaussians, camera, RenderOptions()) for draw in (rasterize, reference.rasterize))
        off = np.mean(np.abs(fast.colors - slow.colors).max(axis=2) > 1 / 255)
        alphas = np.abs(fast.alphas - slow.alphas).max()
        print(
            f"{name:32s} {psnr(fast.colors, slow.colors):6.1f} dB, {off:7.2%} off, alpha at most {alphas:.4f} off"
        )


if __name__ == "__main__":
    main()
