"""The whole renderer in plain float64 NumPy: no tiles, no boxes, slow and obvious.

Every kernel is tested against this. Read it beside Kerbl et al. 2023, *3D Gaussian Splatting for
Real-Time Radiance Field Rendering*; names and thresholds are gsplat's.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from tsplat.camera import Camera
from tsplat.rendering import (
    ALPHA_MAX,
    FAR_PLANE,
    JACOBIAN_LIMIT,
    TRANSMITTANCE_MIN,
    Rendering,
    RenderOptions,
)
from tsplat.scene import SH_COEFFICIENTS, Gaussians
from tsplat.train_views import NEAREST, TrainViews

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
Index = npt.NDArray[np.intp]

NOISE_BITS = 12
"""Of a depth, a sum of four terms in float64."""

BATCH = 128
"""Splats blended at once; only memory depends on it."""


def rasterize(gaussians: Gaussians, camera: Camera, options: RenderOptions) -> Rendering:
    """Draw a scene; the arguments and the result are those of `tsplat.raster.rasterize`."""
    covars = covariances(gaussians.quats, gaussians.scales)
    means2d, depths, covars2d = project(gaussians.means, covars, camera)
    covars2d = widen_near(covars2d, depths, gaussians.means, camera, options)
    conics, opacities = dilate(covars2d, gaussians.opacities, camera, options)
    colors = evaluate_sh(gaussians.sh, gaussians.means - camera.eye, options.sh_degree)
    order = sort(depths, options)
    image = composite(
        means2d[order], conics[order], opacities[order], colors[order], depths[order], camera, options
    )
    variance = options.softening(focal_length(camera))
    return replace(image, colors=soften(image.colors, variance), alphas=soften(image.alphas, variance))


def covariances(quats: npt.ArrayLike, scales: npt.ArrayLike) -> F64:
    """Return R S S^T R^T, float64 [N, 3, 3] (eq. 6)."""
    w, x, y, z = np.asarray(quats, np.float64).T
    rotation = np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1),
        ],
        -2,
    )
    stretched = rotation * np.asarray(scales, np.float64)[:, None, :]
    result: F64 = stretched @ stretched.transpose(0, 2, 1)
    return result


def project(means: npt.ArrayLike, covars: F64, camera: Camera) -> tuple[F64, F64, F64]:
    """Return means2d [N, 2] in pixels, depths [N] and undilated 2D covariances [N, 2, 2] (eq. 5)."""
    rotation, translation = camera.viewmat[:3, :3], camera.viewmat[:3, 3]
    x, y, z = (np.asarray(means, np.float64) @ rotation.T + translation).T
    (fx, _, cx), (_, fy, cy), _ = camera.K
    with np.errstate(all="ignore"):  # splats at depth 0 are dropped by `sort`
        u = _clamp_to_view(x / z, camera.width, fx, cx)
        v = _clamp_to_view(y / z, camera.height, fy, cy)
        zero = np.zeros_like(z)
        jacobian = np.stack(
            [np.stack([fx / z, zero, -fx * u / z], -1), np.stack([zero, fy / z, -fy * v / z], -1)], -2
        )
        to_image = jacobian @ rotation
        means2d = np.stack([fx * x / z + cx, fy * y / z + cy], -1)
        return means2d, z, to_image @ covars @ to_image.transpose(0, 2, 1)


def _clamp_to_view(tangent: F64, side: int, focal: float, centre: float) -> F64:
    margin = (JACOBIAN_LIMIT - 1.0) * 0.5 * side / focal
    return np.clip(tangent, -centre / focal - margin, (side - centre) / focal + margin)


def widen_near(covars2d: F64, depths: F64, means: npt.ArrayLike, camera: Camera, options: RenderOptions) -> F64:
    """Return 2D covariances of which those nearer than any training camera was have its blur in the world."""
    if options.train_views is None:
        return covars2d
    with np.errstate(all="ignore"):
        nearer = np.maximum(train_depths(means, options.train_views) / depths, 1.0)
    gained: F64 = options.near_blur(focal_length(camera)) * (nearer**2 - 1.0)
    return covars2d + gained[:, None, None] * np.eye(2)


def train_depths(means: npt.ArrayLike, views: TrainViews) -> F64:
    """Return the least depth [N] in a view that has the mean in it; -1 where none has."""
    found = np.full(len(np.asarray(means)), np.inf)
    for frustum in views.frusta.astype(np.float64):
        sideways, down, depth = (np.asarray(means, np.float64) @ frustum[:, :3].T + frustum[:, 3]).T
        in_view = (np.abs(sideways) < depth) & (np.abs(down) < depth) & (depth > NEAREST)
        found = np.where(in_view, np.minimum(found, depth), found)
    return np.where(found < FAR_PLANE, found, -1.0)


def dilate(covars2d: F64, opacities: npt.ArrayLike, camera: Camera, options: RenderOptions) -> tuple[F64, F64]:
    """Return the conics [N, 2, 2] of the widened covariances, and the opacities [N] that go with them."""
    added, reference = options.filter2d(focal_length(camera))
    widened = covars2d + added * np.eye(2)
    with np.errstate(all="ignore"):
        ratio = _determinant(covars2d + reference * np.eye(2)) / _determinant(widened)
        a, b, d = widened[:, 0, 0], widened[:, 0, 1], widened[:, 1, 1]
        conics = (
            np.stack([np.stack([d, -b], -1), np.stack([-b, a], -1)], -2) / _determinant(widened)[:, None, None]
        )
        return conics, np.asarray(opacities, np.float64) * np.sqrt(np.maximum(ratio, 0.0))


def _determinant(matrices: F64) -> F64:
    result: F64 = matrices[:, 0, 0] * matrices[:, 1, 1] - matrices[:, 0, 1] * matrices[:, 1, 0]
    return result


def focal_length(camera: Camera) -> float:
    """Return the geometric mean of fx and fy, in pixels."""
    return math.sqrt(camera.K[0, 0] * camera.K[1, 1])


def evaluate_sh(sh: npt.ArrayLike, directions: npt.ArrayLike, degree: int) -> F64:
    """Return colours [N, 3], not below 0, seen along ``directions`` (from the eye, any length)."""
    coefficients = np.asarray(sh, np.float64)
    directions = np.asarray(directions, np.float64)
    basis = sh_basis(directions / np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-30))
    used = min(SH_COEFFICIENTS[degree], coefficients.shape[1])
    colors: F64 = np.maximum(0.5 + np.einsum("nk,nkc->nc", basis[:, :used], coefficients[:, :used]), 0.0)
    return colors


def sh_basis(directions: F64) -> F64:
    """Return the 25 real spherical harmonics of unit directions, [N, 25]; Sloan 2013, appendix A2."""
    x, y, z = directions.T
    one = np.ones_like(x)
    return np.stack(
        [
            math.sqrt(1 / (4 * math.pi)) * one,
            -math.sqrt(3 / (4 * math.pi)) * y,
            math.sqrt(3 / (4 * math.pi)) * z,
            -math.sqrt(3 / (4 * math.pi)) * x,
            math.sqrt(15 / (4 * math.pi)) * x * y,
            -math.sqrt(15 / (4 * math.pi)) * y * z,
            math.sqrt(5 / (16 * math.pi)) * (3 * z * z - 1),
            -math.sqrt(15 / (4 * math.pi)) * x * z,
            math.sqrt(15 / (16 * math.pi)) * (x * x - y * y),
            -math.sqrt(35 / (32 * math.pi)) * y * (3 * x * x - y * y),
            math.sqrt(105 / (4 * math.pi)) * x * y * z,
            -math.sqrt(21 / (32 * math.pi)) * y * (5 * z * z - 1),
            math.sqrt(7 / (16 * math.pi)) * z * (5 * z * z - 3),
            -math.sqrt(21 / (32 * math.pi)) * x * (5 * z * z - 1),
            math.sqrt(105 / (16 * math.pi)) * z * (x * x - y * y),
            -math.sqrt(35 / (32 * math.pi)) * x * (x * x - 3 * y * y),
            math.sqrt(315 / (16 * math.pi)) * x * y * (x * x - y * y),
            -math.sqrt(315 / (32 * math.pi)) * y * z * (3 * x * x - y * y),
            math.sqrt(45 / (16 * math.pi)) * x * y * (7 * z * z - 1),
            -math.sqrt(45 / (32 * math.pi)) * y * z * (7 * z * z - 3),
            math.sqrt(9 / (256 * math.pi)) * (35 * z**4 - 30 * z * z + 3),
            -math.sqrt(45 / (32 * math.pi)) * x * z * (7 * z * z - 3),
            math.sqrt(45 / (64 * math.pi)) * (x * x - y * y) * (7 * z * z - 1),
            -math.sqrt(315 / (32 * math.pi)) * x * z * (x * x - 3 * y * y),
            math.sqrt(315 / (256 * math.pi)) * (x**4 - 6 * x * x * y * y + y**4),
        ],
        -1,
    )


def sort(depths: F64, options: RenderOptions) -> Index:
    """Return the indices of the splats between the planes, nearest first, equal depths in file order."""
    kept = np.flatnonzero((depths > options.near_plane) & (depths < options.far_plane))
    # The last bits depend on the order that terms are added in: splats at one depth may differ in them.
    bits = depths[kept].view(np.int64) >> NOISE_BITS
    return kept[np.argsort(bits, kind="stable")]


def composite(
    means2d: F64, conics: F64, opacities: F64, colors: F64, depths: F64, camera: Camera, options: RenderOptions
) -> Rendering:
    """Blend splats that are sorted by depth (eq. 3); shapes as the functions above return them."""
    ys, xs = np.mgrid[0.5 : camera.height, 0.5 : camera.width]
    pixels = np.stack([xs.ravel(), ys.ravel()], -1)
    transmittance = np.ones(len(pixels))
    finished = np.zeros(len(pixels), bool)
    sums = np.zeros((len(pixels), 4))
    values = np.concatenate([colors, depths[:, None]], 1)
    for start in range(0, len(means2d), BATCH):
        batch = slice(start, start + BATCH)
        alphas = _alphas(means2d[batch], conics[batch], opacities[batch], pixels, options)
        after = transmittance * np.cumprod(1.0 - alphas, 0)
        stopped = np.logical_or.accumulate((after <= TRANSMITTANCE_MIN) & (alphas > 0), 0) | finished
        alphas[stopped] = 0.0
        after = transmittance * np.cumprod(1.0 - alphas, 0)
        before = np.concatenate([transmittance[None], after[:-1]])
        sums += (before * alphas).T @ values[batch]
        transmittance, finished = after[-1], stopped[-1]
    return _rendering(sums, transmittance, camera, options)


def _alphas(means2d: F64, conics: F64, opacities: F64, pixels: F64, options: RenderOptions) -> F64:
    """Return what each splat covers of each pixel, [splats, pixels] (eq. 4)."""
    dx, dy = pixels.T[:, None, :] - means2d.T[:, :, None]
    squared = (
        conics[:, 0, 0, None] * dx * dx + 2 * conics[:, 0, 1, None] * dx * dy + conics[:, 1, 1, None] * dy * dy
    )
    alphas = opacities[:, None] * np.exp(-0.5 * squared)
    seen = (alphas >= options.alpha_min) & (squared <= options.sigma_extent**2)
    return np.where(seen, np.minimum(alphas, ALPHA_MAX), 0.0)


def _rendering(sums: F64, transmittance: F64, camera: Camera, options: RenderOptions) -> Rendering:
    shape = (camera.height, camera.width)
    colors = sums[:, :3] + transmittance[:, None] * np.asarray(options.background)
    alphas = 1.0 - transmittance
    depths = np.where(alphas > 0, sums[:, 3] / np.maximum(alphas, 1e-10), 0.0)
    return Rendering(
        colors.reshape(*shape, 3).astype(np.float32),
        alphas.reshape(shape).astype(np.float32),
        depths.reshape(shape).astype(np.float32) if options.depths else None,
    )


def soften(image: F32, variance: float) -> F32:
    """Blur rows and then columns by so many pixels squared; at its rim an image is continued as it ends."""
    for axis in (0, 1):
        padded = np.pad(image.astype(np.float64), [(int(axis == each),) * 2 for each in range(image.ndim)], "edge")
        before, after = (np.take(padded, start + np.arange(image.shape[axis]), axis) for start in (0, 2))
        image = ((1.0 - variance) * image + 0.5 * variance * (before + after)).astype(np.float32)
    return image
