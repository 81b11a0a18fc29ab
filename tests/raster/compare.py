"""How close two images are, in the words of the design: 50 dB, and 1/255 in 99.9 % of pixels."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from tsplat.camera import Camera
from tsplat.raster import rasterize, reference
from tsplat.rendering import Rendering, RenderOptions
from tsplat.scene import Gaussians


def psnr(image: npt.ArrayLike, truth: npt.ArrayLike) -> float:
    """Return the peak signal-to-noise ratio in dB for a peak of 1."""
    error = float(np.mean((np.asarray(image, np.float64) - np.asarray(truth, np.float64)) ** 2))
    return -10.0 * math.log10(max(error, 1e-20))


def assert_like_reference(gaussians: Gaussians, camera: Camera, options: RenderOptions) -> Rendering:
    """Draw with both renderers, require that they agree, and return the fast one's image."""
    fast, slow = rasterize(gaussians, camera, options), reference.rasterize(gaussians, camera, options)
    assert psnr(fast.colors, slow.colors) >= 50.0
    apart = np.abs(fast.colors - slow.colors).max(axis=2) > 1 / 255
    assert apart.sum() <= max(1, apart.size // 1000)
    assert np.mean(np.abs(fast.alphas - slow.alphas) > 1 / 255) <= 0.001 + 1 / apart.size
    if fast.depths is not None and slow.depths is not None:
        solid = slow.alphas > 0.5
        off = np.abs(fast.depths[solid] / slow.depths[solid] - 1.0) > 0.01
        assert off.sum() <= max(1, off.size // 1000)
    return fast


def front_camera(width: int = 64, height: int = 48) -> Camera:
    """Return a camera that sees all of `tests.scenes.random_gaussians`."""
    return Camera.look_at((0.3, 0.2, -4.0), (0, 0, 0), (0, -1, 0), width=width, height=height, fov_y=40.0)
