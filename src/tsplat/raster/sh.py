"""Stage 1, colours: spherical harmonics of eight splats at once, from half-precision coefficients.

Source: Sloan 2013, *Efficient Spherical Harmonic Evaluation*; coefficients as gsplat orders them.
"""

from __future__ import annotations

import numpy as np

from tsplat._jit import part
from tsplat._lanes import fma, load, maximum, splat, sqrt, store
from tsplat._moves import load_half
from tsplat.raster.prepare import BLOCK

C1 = 0.4886025119029199
C2 = (1.0925484305920792, 0.31539156525252005, 0.5462742152960396)
C3 = (0.5900435899266435, 2.890611442640554, 0.4570457994644658, 0.3731763325901154, 1.445305721320277)
C4 = (
    2.5033429417967046,
    1.7701307697799307,
    0.9461746957575601,
    0.6690465435572892,
    0.10578554691520431,
    0.47308734787878004,
    0.6258357354491761,
)


@part
def color_eight(first, wanted, stored, eye, means, base_colors, sh_rest, out, at):
    """Write the colours of eight splats from ``first`` on: red to ``out[at]``, green and blue each a BLOCK on.

    ``wanted`` of the ``stored`` coefficients above the constant one are used: 3, 8, 15 or 24.
    """
    padded = len(means) // 3
    x = load(means, first) - splat(eye[0])
    y = load(means, padded + first) - splat(eye[1])
    z = load(means, 2 * padded + first) - splat(eye[2])
    one, zero = splat(np.float32(1.0)), splat(np.float32(0.0))
    scale = one / sqrt(maximum(x * x + y * y + z * z, splat(np.float32(1e-30))))
    x, y, z = x * scale, y * scale, z * scale
    rgb = load(base_colors, first), load(base_colors, padded + first), load(base_colors, 2 * padded + first)
    next_ = first * stored * 3
    c1 = splat(np.float32(C1))
    rgb = _add(rgb, zero - c1 * y, sh_rest, next_)
    rgb = _add(rgb, c1 * z, sh_rest, next_ + 24)
    rgb = _add(rgb, zero - c1 * x, sh_rest, next_ + 48)
    if wanted > 3:
        rgb = _add_degree_2(rgb, x, y, z, sh_rest, next_ + 72)
    if wanted > 8:
        rgb = _add_degree_3(rgb, x, y, z, sh_rest, next_ + 192)
    if wanted > 15:
        rgb = _add_degree_4(rgb, x, y, z, sh_rest, next_ + 360)
    for channel in range(3):
        store(out, at + channel * BLOCK, maximum(rgb[channel], zero))


@part
def _add(rgb, basis, sh_rest, at):
    """Add one basis function times its coefficients, eight splats of red, then green, then blue."""
    return (
        fma(basis, load_half(sh_rest, at), rgb[0]),
        fma(basis, load_half(sh_rest, at + 8), rgb[1]),
        fma(basis, load_half(sh_rest, at + 16), rgb[2]),
    )


@part
def _add_degree_2(rgb, x, y, z, sh_rest, at):
    zero, one, three = splat(np.float32(0.0)), splat(np.float32(1.0)), splat(np.float32(3.0))
    outer, middle, last = splat(np.float32(C2[0])), splat(np.float32(C2[1])), splat(np.float32(C2[2]))
    rgb = _add(rgb, outer * x * y, sh_rest, at)
    rgb = _add(rgb, zero - outer * y * z, sh_rest, at + 24)
    rgb = _add(rgb, middle * (three * z * z - one), sh_rest, at + 48)
    rgb = _add(rgb, zero - outer * x * z, sh_rest, at + 72)
    return _add(rgb, last * (x * x - y * y), sh_rest, at + 96)


@part
def _add_degree_3(rgb, x, y, z, sh_rest, at):
    zero, one = splat(np.float32(0.0)), splat(np.float32(1.0))
    three, five = splat(np.float32(3.0)), splat(np.float32(5.0))
    xx, yy, zz = x * x, y * y, z * z
    outer, product, inner = splat(np.float32(C3[0])), splat(np.float32(C3[1])), splat(np.float32(C3[2]))
    rgb = _add(rgb, zero - outer * y * (three * xx - yy), sh_rest, at)
    rgb = _add(rgb, product * x * y * z, sh_rest, at + 24)
    rgb = _add(rgb, zero - inner * y * (five * zz - one), sh_rest, at + 48)
    rgb = _add(rgb, splat(np.float32(C3[3])) * z * (five * zz - three), sh_rest, at + 72)
    rgb = _add(rgb, zero - inner * x * (five * zz - one), sh_rest, at + 96)
    rgb = _add(rgb, splat(np.float32(C3[4])) * z * (xx - yy), sh_rest, at + 120)
    return _add(rgb, zero - outer * x * (xx - three * yy), sh_rest, at + 144)


@part
def _add_degree_4(rgb, x, y, z, sh_rest, at):
    zero, one, three = splat(np.float32(0.0)), splat(np.float32(1.0)), splat(np.float32(3.0))
    six, seven = splat(np.float32(6.0)), splat(np.float32(7.0))
    xx, yy, zz = x * x, y * y, z * z
    tilted, flat = splat(np.float32(C4[1])) * z, splat(np.float32(C4[3])) * z * (seven * zz - three)
    zonal = splat(np.float32(35.0)) * zz * zz - splat(np.float32(30.0)) * zz + three
    rgb = _add(rgb, splat(np.float32(C4[0])) * x * y * (xx - yy), sh_rest, at)
    rgb = _add(rgb, zero - tilted * y * (three * xx - yy), sh_rest, at + 24)
    rgb = _add(rgb, splat(np.float32(C4[2])) * x * y * (seven * zz - one), sh_rest, at + 48)
    rgb = _add(rgb, zero - flat * y, sh_rest, at + 72)
    rgb = _add(rgb, splat(np.float32(C4[4])) * zonal, sh_rest, at + 96)
    rgb = _add(rgb, zero - flat * x, sh_rest, at + 120)
    rgb = _add(rgb, splat(np.float32(C4[5])) * (xx - yy) * (seven * zz - one), sh_rest, at + 144)
    rgb = _add(rgb, zero - tilted * x * (xx - three * yy), sh_rest, at + 168)
    return _add(rgb, splat(np.float32(C4[6])) * (xx * xx - six * xx * yy + yy * yy), sh_rest, at + 192)
