"""Stage 1: splats to 2D. Visible ones become records of one cache line each.

Source: Zwicker et al. 2002, *EWA Splatting*, eq. 31; Kerbl et al. 2023, eq. 5.
"""

from __future__ import annotations

import math

import numpy as np

from tsplat._jit import claim, kernel
from tsplat.camera import Camera
from tsplat.raster import record as col
from tsplat.raster.prepare import BLOCK, Prepared
from tsplat.raster.workers import on_threads
from tsplat.rendering import JACOBIAN_LIMIT, RenderOptions

LOG2_E = math.log2(math.e)

STRIDE = np.uint64(BLOCK)
"""BLOCK, unsigned as the indices are: a constant distance that LLVM can prove free of overlap."""


def project(scene: Prepared, camera: Camera, options: RenderOptions, tile_size: int) -> int:
    """Fill ``records``, ``ids``, ``tiles`` and ``visible`` of a prepared scene, all but the colours.

    Returns
    -------
    int
        Splats that touch the image.
    """
    (fx, _, cx), (_, fy, cy), _ = camera.K
    margin = (JACOBIAN_LIMIT - 1.0) * 0.5
    added, reference = options.filter2d(math.sqrt(fx * fy))
    numbers = [
        *camera.viewmat[:3].ravel(), fx, fy, cx, cy,
        -cx / fx - margin * camera.width / fx, (camera.width - cx) / fx + margin * camera.width / fx,
        -cy / fy - margin * camera.height / fy, (camera.height - cy) / fy + margin * camera.height / fy,
        added, reference, options.near_plane, options.far_plane,
        math.log2(options.alpha_min), options.sigma_extent**2,
    ]  # fmt: skip
    on_threads(options.worker_count, _project_blocks, np.zeros(1, np.int64), np.asarray(numbers, np.float32),
               camera.width, camera.height, tile_size, scene.means, scene.covars, scene.log2_opacities,
               scene.records, scene.ids, scene.tiles, scene.visible)  # fmt: skip
    return int(scene.visible.sum())


@kernel
def _project_blocks(worker, counter, numbers, width, height, tile_size, means, covars, log2_opacities,
                    records, ids, tiles, visible):  # fmt: skip
    # What the vector loop leaves for the scalar one, a stretch of BLOCK values for each quantity.
    scratch = np.empty(10 * BLOCK, np.float32)
    n = log2_opacities.shape[0]
    while True:
        block = claim(counter)
        start = block * BLOCK
        if start >= n:
            return
        count = min(BLOCK, n - start)
        _project_block(start, count, numbers, means, covars, log2_opacities, scratch)
        visible[block] = _keep_visible(
            start, count, numbers, width, height, tile_size, scratch, records, ids, tiles
        )


@kernel
def _project_block(start, count, numbers, means, covars, log2_opacities, scratch):
    """Branch-free and over plain arrays, so that LLVM makes vectors of it."""
    r00, r01, r02, tx, r10, r11, r12, ty, r20, r21, r22, tz = numbers[:12]
    fx, fy, cx, cy, u_min, u_max, v_min, v_max, added, reference = numbers[12:22]
    log2_alpha_min, squared_extent = numbers[24], numbers[25]
    one, half = np.float32(1.0), np.float32(0.5)
    two_ln2 = np.float32(2.0 / LOG2_E)
    for j in range(count):
        i = np.uint64(start + j)  # unsigned: no branch for a negative index, which would end vectorisation
        k = np.uint64(j)
        mx, my, mz = means[0, i], means[1, i], means[2, i]
        z = r20 * mx + r21 * my + r22 * mz + tz
        inverse_z = one / z
        x = (r00 * mx + r01 * my + r02 * mz + tx) * inverse_z
        y = (r10 * mx + r11 * my + r12 * mz + ty) * inverse_z
        u, v = min(max(x, u_min), u_max), min(max(y, v_min), v_max)
        gx, gy = fx * inverse_z, fy * inverse_z
        j00, j01, j02 = gx * (r00 - u * r20), gx * (r01 - u * r21), gx * (r02 - u * r22)
        j10, j11, j12 = gy * (r10 - v * r20), gy * (r11 - v * r21), gy * (r12 - v * r22)
        xx, xy, xz, yy, yz, zz = covars[0, i], covars[1, i], covars[2, i], covars[3, i], covars[4, i], covars[5, i]
        p0, p1, p2 = xx * j00 + xy * j01 + xz * j02, xy * j00 + yy * j01 + yz * j02, xz * j00 + yz * j01 + zz * j02
        q0, q1, q2 = xx * j10 + xy * j11 + xz * j12, xy * j10 + yy * j11 + yz * j12, xz * j10 + yz * j11 + zz * j12
        a = j00 * p0 + j01 * p1 + j02 * p2
        b = j10 * p0 + j11 * p1 + j12 * p2
        d = j10 * q0 + j11 * q1 + j12 * q2
        determinant_reference = (a + reference) * (d + reference) - b * b
        a, d = a + added, d + added
        inverse = one / (a * d - b * b)
        log2_opacity = log2_opacities[i] + half * _log2(max(determinant_reference * inverse, np.float32(1e-12)))
        squared_radius = min(two_ln2 * (log2_opacity - log2_alpha_min), squared_extent)
        scratch[k], scratch[1 * STRIDE + k], scratch[2 * STRIDE + k] = fx * x + cx - half, fy * y + cy - half, z
        scratch[3 * STRIDE + k], scratch[4 * STRIDE + k], scratch[5 * STRIDE + k] = (
            d * inverse,
            b * inverse,
            a * inverse,
        )
        scratch[6 * STRIDE + k] = log2_opacity
        scratch[7 * STRIDE + k] = squared_radius
        scratch[8 * STRIDE + k] = math.sqrt(max(squared_radius * a, np.float32(0.0)))
        scratch[9 * STRIDE + k] = math.sqrt(max(squared_radius * d, np.float32(0.0)))


@kernel
def _log2(x):
    """Base-2 logarithm to 2e-6 for normal positive x: atanh series about 1, the exponent from the bits."""
    bits = np.float32(x).view(np.int32)
    shifted = bits - np.int32(0x3F3504F3)  # so that the mantissa lies in [sqrt(1/2), sqrt(2))
    exponent = shifted >> np.int32(23)
    mantissa = np.int32(bits - (exponent << np.int32(23))).view(np.float32)
    s = (mantissa - np.float32(1.0)) / (mantissa + np.float32(1.0))
    s2 = s * s
    series = np.float32(2.88539008) + s2 * (np.float32(0.961796694) + s2 * np.float32(0.577078016))
    return np.float32(exponent) + s * series


@kernel
def _keep_visible(start, count, numbers, width, height, tile_size, scratch, records, ids, tiles):
    """Write the record of each splat that covers the centre of a pixel; return how many there are."""
    near, far, log2_alpha_min, squared_extent = numbers[22], numbers[23], numbers[24], numbers[25]
    fold = np.float32(-0.5 * LOG2_E)
    zero, last_x, last_y = np.float32(0.0), np.float32(width - 1), np.float32(height - 1)
    kept = start
    for j in range(count):
        depth, squared_radius = scratch[2 * BLOCK + j], scratch[7 * BLOCK + j]
        if not (near < depth < far and squared_radius > zero):
            continue
        x, y, radius_x, radius_y = (
            scratch[j],
            scratch[1 * BLOCK + j],
            scratch[8 * BLOCK + j],
            scratch[9 * BLOCK + j],
        )
        left, right = max(math.ceil(x - radius_x), zero), min(math.floor(x + radius_x), last_x)
        top, bottom = max(math.ceil(y - radius_y), zero), min(math.floor(y + radius_y), last_y)
        if not (left <= right and top <= bottom):
            continue
        log2_opacity = scratch[6 * BLOCK + j]
        records[kept, col.X], records[kept, col.Y], records[kept, col.DEPTH] = x, y, depth
        records[kept, col.CONIC_A] = fold * scratch[3 * BLOCK + j]
        records[kept, col.CONIC_B] = -(fold + fold) * scratch[4 * BLOCK + j]
        records[kept, col.CONIC_C] = fold * scratch[5 * BLOCK + j]
        records[kept, col.LOG2_OPACITY] = log2_opacity
        records[kept, col.LOG2_CUT] = max(log2_alpha_min, log2_opacity + fold * squared_extent)
        records[kept, col.LEFT], records[kept, col.TOP] = left, top
        records[kept, col.RIGHT], records[kept, col.BOTTOM] = right, bottom
        ids[kept] = start + j
        tiles[kept, 0], tiles[kept, 1] = np.int64(left) // tile_size, np.int64(top) // tile_size
        tiles[kept, 2], tiles[kept, 3] = np.int64(right) // tile_size, np.int64(bottom) // tile_size
        kept += 1
    return kept - start
