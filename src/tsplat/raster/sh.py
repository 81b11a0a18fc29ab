"""Stage 2: colours from spherical harmonics, only for what is visible.

Source: Sloan 2013, *Efficient Spherical Harmonic Evaluation*; coefficients as gsplat orders them.
"""

from __future__ import annotations

import math

import numpy as np

from tsplat._jit import claim, kernel
from tsplat.camera import Camera
from tsplat.raster import record as col
from tsplat.raster.prepare import BLOCK, Prepared
from tsplat.raster.workers import on_threads
from tsplat.rendering import RenderOptions
from tsplat.scene import SH_COEFFICIENTS, Gaussians


def color_visible(scene: Prepared, gaussians: Gaussians, camera: Camera, options: RenderOptions) -> None:
    """Fill the colours of the ``records`` that `project` left in a prepared scene."""
    coefficients = min(SH_COEFFICIENTS[options.sh_degree], gaussians.sh.shape[1])
    on_threads(options.worker_count, _color_blocks, np.zeros(1, np.int64), coefficients,
               camera.eye.astype(np.float32), scene.means, gaussians.sh, scene.ids, scene.visible,
               scene.records)  # fmt: skip


@kernel
def _color_blocks(worker, counter, coefficients, eye, means, sh, ids, visible, records):
    basis = np.empty(16, np.float32)
    basis[0] = np.float32(0.28209479177387814)
    while True:
        block = claim(counter)
        if block >= len(visible):
            return
        for record in range(block * BLOCK, block * BLOCK + visible[block]):
            i = np.uint64(ids[record])
            if coefficients > 1:
                _fill_basis(means[0, i] - eye[0], means[1, i] - eye[1], means[2, i] - eye[2], coefficients, basis)
            red = green = blue = np.float32(0.5)
            for k in range(coefficients):
                weight = basis[np.uint64(k)]
                red += weight * sh[i, np.uint64(k), 0]
                green += weight * sh[i, np.uint64(k), 1]
                blue += weight * sh[i, np.uint64(k), 2]
            zero = np.float32(0.0)
            records[record, col.RED], records[record, col.GREEN], records[record, col.BLUE] = (
                max(red, zero), max(green, zero), max(blue, zero)
            )  # fmt: skip


@kernel
def _fill_basis(x, y, z, coefficients, basis):
    """Write the basis functions above the constant one in the direction (x, y, z) of any length."""
    scale = np.float32(1.0) / math.sqrt(max(x * x + y * y + z * z, np.float32(1e-30)))
    x, y, z = x * scale, y * scale, z * scale
    c1 = np.float32(0.4886025119029199)
    basis[1], basis[2], basis[3] = -c1 * y, c1 * z, -c1 * x
    if coefficients <= 4:
        return
    xx, yy, zz = x * x, y * y, z * z
    c2, three, one = np.float32(1.0925484305920792), np.float32(3.0), np.float32(1.0)
    basis[4], basis[5], basis[7] = c2 * x * y, -c2 * y * z, -c2 * x * z
    basis[6] = np.float32(0.31539156525252005) * (three * zz - one)
    basis[8] = np.float32(0.5462742152960396) * (xx - yy)
    if coefficients <= 9:
        return
    c3, five = np.float32(0.5900435899266435), np.float32(5.0)
    c4 = np.float32(0.4570457994644658)
    basis[9], basis[15] = -c3 * y * (three * xx - yy), -c3 * x * (xx - three * yy)
    basis[10] = np.float32(2.890611442640554) * x * y * z
    basis[11], basis[13] = -c4 * y * (five * zz - one), -c4 * x * (five * zz - one)
    basis[12] = np.float32(0.3731763325901154) * z * (five * zz - three)
    basis[14] = np.float32(1.445305721320277) * z * (xx - yy)
