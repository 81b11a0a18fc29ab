"""Stage 1: splats to 2D. Visible ones become records of half a cache line each, colour included.

Source: Zwicker et al. 2002, *EWA Splatting*, eq. 31; Kerbl et al. 2023, eq. 5.
"""

from __future__ import annotations

import math

import numpy as np

from tsplat._bits import lanes_at_least
from tsplat._jit import part
from tsplat._lanes import load, minimum, splat, store
from tsplat._moves import store_paired_halves, store_past_caches, store_transposed
from tsplat._threads import meet, take
from tsplat.raster import record as col
from tsplat.raster.cells import TILE
from tsplat.raster.falloff import LOG2_E, OFFSET, SCALE
from tsplat.raster.frame import KEY_SHIFT, NEXT_BLOCK
from tsplat.raster.prepare import BLOCK, HALF_MAX, covariance
from tsplat.raster.sh import color_eight
from tsplat.raster.sight import in_sight
from tsplat.raster.train_depths import NOT_YET, fill_train_depths

STRIDE = np.uint64(BLOCK)
"""BLOCK, unsigned as the indices are: a constant distance that LLVM can prove free of overlap."""

# Rows of the scratch memory of a block, BLOCK values each: first those of the record, then what is packed into it,
# whether it is seen, and its first and last tile, the column in the low 16 bits of an integer, the row above.
RED, GREEN, BLUE, DEPTH = 8, 9, 10, 11
SEEN, FIRST_TILE, LAST_TILE = 12, 13, 14
# Then what the loops hand to each other.
INVERSE_Z, A, B, D, SQUARED_RADIUS, LENGTHINESS = 15, 16, 17, 18, 19, 20
KEY = 21

ROWS_BY_SPLAT = 20 * BLOCK
"""Behind the first of these rows, the records of eight splats, at the end."""

LEAST = 4
"""Blocks that a worker takes at least: a page of each array, within which a processor reads ahead by itself."""

NEEDLE = 500.0
"""How much larger the product of the variances than the determinant may be: beyond, float32 has too few digits."""

LEAST_DETERMINANT = 1e-9
"""Share of the product of the variances that a determinant has at least, whatever rounding left of it."""

LOG2_TILE = np.int32(int(math.log2(TILE)))


@part
def project(worker, frame):
    """Fill ``records``, ``depth_keys``, ``tiles`` and ``visible``, block by block."""
    scratch = frame.scratch[worker]
    eye = frame.numbers[28:31]
    place, behind = -1, 0
    while True:
        place += 1
        if place == behind:
            place, behind = take(frame.team, NEXT_BLOCK, len(frame.blocks), LEAST, frame.workers)
            if place == len(frame.blocks):
                return meet(frame.team, frame.workers)
        block = np.int64(frame.blocks[place])
        if not in_sight(block, frame.numbers, frame.bounds):
            frame.visible[place] = 0
            continue
        start = block * BLOCK
        if frame.numbers[37] > 0 and frame.train_depths[start] == NOT_YET:
            fill_train_depths(start, frame.means, frame.frusta, frame.train_depths)
        _project_block(start, frame, scratch)
        if frame.coefficients > 0:
            half = splat(np.float32(0.5))
            for first in range(0, BLOCK, 8):
                if lanes_at_least(load(scratch, SEEN * BLOCK + first), half) != 0:
                    color_eight(start + first, frame.coefficients, frame.coefficients_stored, eye, frame.means,
                                frame.base_colors, frame.sh_rest, scratch, RED * BLOCK + first)  # fmt: skip
        frame.visible[place] = _keep_visible(
            place * BLOCK, scratch, frame.past_caches, frame.records, frame.depth_keys, frame.tiles
        )


@part
def _project_block(start, frame, scratch):
    """Branch-free and over plain arrays, so that LLVM makes vectors of it.

    A few loops in place of one: each is short enough for the processor to have several of its rounds under way.
    """
    numbers = frame.numbers
    _project_means(start, frame.viewmat, frame.nearest_key, frame.means, scratch)
    _project_covars(start, numbers, frame.covars, scratch)
    if numbers[37] > 0:
        _widen_near(start, numbers, frame.train_depths, scratch)
    _fill_opacities(start, frame.log2_opacities, scratch)
    if numbers[20] != numbers[21]:
        _compensate_opacities(numbers, scratch)
    _shape_splats(numbers, scratch)
    _sharpen_needles(start, frame, scratch)
    _place_splats(start, numbers, frame.base_colors, scratch)


@part
def _project_means(start, viewmat, nearest_key, means, scratch):
    """Fill X and Y, still at depth 1, DEPTH and INVERSE_Z, and KEY.

    Sums are those of float64: through a long lens, or far from the origin, float32 would leave a splat beside its
    place, and order those of one wall anew in each frame.
    """
    r00, r01, r02, tx, r10, r11, r12, ty, r20, r21, r22, tz = viewmat
    padded = np.uint64(len(means) // 3)
    for j in range(BLOCK):
        i = np.uint64(start + j)  # unsigned: no branch for a negative index, which would end vectorisation
        k = np.uint64(j)
        mx, my, mz = means[i], means[padded + i], means[np.uint64(2) * padded + i]
        depth = np.float64(r20 * mx + r21 * my + r22 * mz + tz)
        key = np.int64(depth.view(np.uint64) >> np.uint64(KEY_SHIFT)) - nearest_key
        key = min(max(key, np.int64(0)), np.int64(0xFFFFFFFF))
        scratch[np.uint64(KEY) * STRIDE + k] = np.uint32(key).view(np.float32)
        z = np.float32(depth)
        inverse_z = np.float32(1.0) / z
        scratch[np.uint64(col.X) * STRIDE + k] = np.float32(r00 * mx + r01 * my + r02 * mz + tx) * inverse_z
        scratch[np.uint64(col.Y) * STRIDE + k] = np.float32(r10 * mx + r11 * my + r12 * mz + ty) * inverse_z
        scratch[np.uint64(DEPTH) * STRIDE + k], scratch[np.uint64(INVERSE_Z) * STRIDE + k] = z, inverse_z


@part
def _project_covars(start, numbers, covars, scratch):
    """Fill the 2D covariance in pixels squared, not yet widened: A B; B D."""
    r00, r01, r02, _, r10, r11, r12, _, r20, r21, r22, _ = numbers[:12]
    fx, fy, _, _, u_min, u_max, v_min, v_max = numbers[12:20]
    padded = np.uint64(len(covars) // 6)
    for j in range(BLOCK):
        i, k = np.uint64(start + j), np.uint64(j)
        inverse_z = scratch[np.uint64(INVERSE_Z) * STRIDE + k]
        u = min(max(scratch[np.uint64(col.X) * STRIDE + k], u_min), u_max)
        v = min(max(scratch[np.uint64(col.Y) * STRIDE + k], v_min), v_max)
        gx, gy = fx * inverse_z, fy * inverse_z
        j00, j01, j02 = gx * (r00 - u * r20), gx * (r01 - u * r21), gx * (r02 - u * r22)
        j10, j11, j12 = gy * (r10 - v * r20), gy * (r11 - v * r21), gy * (r12 - v * r22)
        xx, xy, xz = covars[i], covars[padded + i], covars[np.uint64(2) * padded + i]
        yy, yz = covars[np.uint64(3) * padded + i], covars[np.uint64(4) * padded + i]
        zz = covars[np.uint64(5) * padded + i]
        scratch[np.uint64(A) * STRIDE + k] = _between(j00, j01, j02, j00, j01, j02, xx, xy, xz, yy, yz, zz)
        scratch[np.uint64(B) * STRIDE + k] = _between(j10, j11, j12, j00, j01, j02, xx, xy, xz, yy, yz, zz)
        scratch[np.uint64(D) * STRIDE + k] = _between(j10, j11, j12, j10, j11, j12, xx, xy, xz, yy, yz, zz)


@part
def _between(a0, a1, a2, b0, b1, b2, xx, xy, xz, yy, yz, zz):
    """Return the product of a row, a covariance and a column."""
    p0, p1, p2 = xx * b0 + xy * b1 + xz * b2, xy * b0 + yy * b1 + yz * b2, xz * b0 + yz * b1 + zz * b2
    return a0 * p0 + a1 * p1 + a2 * p2


@part
def _widen_near(start, numbers, train_depths, scratch):
    """Let the blur of training grow with splats that the eye is nearer to than any training camera was."""
    near_blur, one = numbers[37], np.float32(1.0)
    for j in range(BLOCK):
        k = np.uint64(j)
        nearer = max(train_depths[np.uint64(start + j)] * scratch[np.uint64(INVERSE_Z) * STRIDE + k], one)
        gained = near_blur * (nearer * nearer - one)
        scratch[np.uint64(A) * STRIDE + k] += gained
        scratch[np.uint64(D) * STRIDE + k] += gained


@part
def _fill_opacities(start, log2_opacities, scratch):
    """Fill PEAK, still the logarithm of the opacity."""
    for j in range(BLOCK):
        scratch[np.uint64(col.PEAK) * STRIDE + np.uint64(j)] = log2_opacities[np.uint64(start + j)]


@part
def _compensate_opacities(numbers, scratch):
    """Take from the opacity what widening beyond the reference adds to the area; classic rendering adds none."""
    added, reference, half = numbers[20], numbers[21], np.float32(0.5)
    for j in range(BLOCK):
        k = np.uint64(j)
        a, b = scratch[np.uint64(A) * STRIDE + k], scratch[np.uint64(B) * STRIDE + k]
        d = scratch[np.uint64(D) * STRIDE + k]
        share = ((a + reference) * (d + reference) - b * b) / ((a + added) * (d + added) - b * b)
        scratch[np.uint64(col.PEAK) * STRIDE + k] += half * _log2(max(share, np.float32(1e-12)))


@part
def _shape_splats(numbers, scratch):
    """Widen the 2D covariance, and fill all that follows from it and the opacity alone."""
    added, log2_alpha_min, squared_extent = numbers[20], numbers[24], numbers[25]
    one, two_ln2, fold = np.float32(1.0), np.float32(2.0 / LOG2_E), np.float32(-0.5 * LOG2_E)
    scale, offset = np.float32(SCALE), np.float32(OFFSET)
    for j in range(BLOCK):
        k = np.uint64(j)
        a, b = scratch[np.uint64(A) * STRIDE + k] + added, scratch[np.uint64(B) * STRIDE + k]
        d = scratch[np.uint64(D) * STRIDE + k] + added
        determinant = a * d - b * b
        inverse = one / determinant
        scratch[np.uint64(LENGTHINESS) * STRIDE + k] = a * d - np.float32(NEEDLE) * determinant
        log2_opacity = scratch[np.uint64(col.PEAK) * STRIDE + k]
        squared_radius = min(two_ln2 * (log2_opacity - log2_alpha_min), squared_extent)
        conic = scale * fold * inverse
        scratch[np.uint64(A) * STRIDE + k], scratch[np.uint64(D) * STRIDE + k] = a, d
        scratch[np.uint64(SQUARED_RADIUS) * STRIDE + k] = squared_radius
        scratch[np.uint64(col.CONIC_A) * STRIDE + k] = conic * d
        scratch[np.uint64(col.CONIC_B) * STRIDE + k] = -(conic + conic) * b
        scratch[np.uint64(col.CONIC_C) * STRIDE + k] = conic * a
        scratch[np.uint64(col.PEAK) * STRIDE + k] = scale * log2_opacity + offset


@part
def _sharpen_needles(start, frame, scratch):
    """Do for the needles of a block, in float64, what `_project_covars` and those after it did for all splats."""
    zero = splat(np.float32(0.0))
    for first in range(0, BLOCK, 8):
        if lanes_at_least(load(scratch, LENGTHINESS * BLOCK + first), zero) != 0:
            for j in range(first, first + 8):
                if scratch[np.uint64(LENGTHINESS) * STRIDE + np.uint64(j)] >= np.float32(0.0):
                    _sharpen(np.uint64(start + j), np.uint64(j), frame, scratch)


@part
def _sharpen(i, k, frame, scratch):
    numbers = frame.numbers
    r00, r01, r02, tx, r10, r11, r12, ty, r20, r21, r22, tz = frame.viewmat
    fx, fy, _, _, u_min, u_max, v_min, v_max, added, reference = numbers[12:22]
    splats = np.uint64(len(frame.log2_opacities))
    mx, my, mz = frame.means[i], frame.means[splats + i], frame.means[np.uint64(2) * splats + i]
    z = r20 * mx + r21 * my + r22 * mz + tz
    u = min(max((r00 * mx + r01 * my + r02 * mz + tx) / z, u_min), u_max)
    v = min(max((r10 * mx + r11 * my + r12 * mz + ty) / z, v_min), v_max)
    gx, gy = fx / z, fy / z
    j00, j01, j02 = gx * (r00 - u * r20), gx * (r01 - u * r21), gx * (r02 - u * r22)
    j10, j11, j12 = gy * (r10 - v * r20), gy * (r11 - v * r21), gy * (r12 - v * r22)
    xx, xy, xz, yy, yz, zz = _sharp_covariance(i, splats, frame)
    a = _between(j00, j01, j02, j00, j01, j02, xx, xy, xz, yy, yz, zz)
    b = _between(j10, j11, j12, j00, j01, j02, xx, xy, xz, yy, yz, zz)
    d = _between(j10, j11, j12, j10, j11, j12, xx, xy, xz, yy, yz, zz)
    if numbers[37] > 0:
        nearer = max(frame.train_depths[i] / z, 1.0)
        a, d = a + numbers[37] * (nearer * nearer - 1.0), d + numbers[37] * (nearer * nearer - 1.0)
    unwidened = (a + reference) * (d + reference) - b * b
    a, d = a + added, d + added
    determinant = max(a * d - b * b, LEAST_DETERMINANT * a * d)
    log2_opacity = np.float64(frame.log2_opacities[i])
    if added != reference:
        log2_opacity += 0.5 * math.log2(max(unwidened / determinant, 1e-12))
    conic = -0.5 * LOG2_E * SCALE / determinant
    scratch[np.uint64(SQUARED_RADIUS) * STRIDE + k] = min(
        2.0 / LOG2_E * (log2_opacity - numbers[24]), np.float64(numbers[25])
    )
    scratch[np.uint64(col.CONIC_A) * STRIDE + k] = conic * d
    scratch[np.uint64(col.CONIC_B) * STRIDE + k] = -2.0 * conic * b
    scratch[np.uint64(col.CONIC_C) * STRIDE + k] = conic * a
    scratch[np.uint64(col.PEAK) * STRIDE + k] = SCALE * log2_opacity + OFFSET


@part
def _sharp_covariance(i, splats, frame):
    """Return a covariance in float64: of what it was made of where that is known, else as it was rounded."""
    three, four = np.uint64(3) * i, np.uint64(4) * i
    if three < np.uint64(len(frame.scales)):
        w, x, y, z = frame.quats[four : four + np.uint64(4)]
        sx, sy, sz = frame.scales[three : three + np.uint64(3)]
        return covariance(w, x, y, z, sx, sy, sz)
    xx, xy, xz, yy, yz, zz = frame.covars[i::splats]
    return np.float64(xx), np.float64(xy), np.float64(xz), np.float64(yy), np.float64(yz), np.float64(zz)


@part
def _place_splats(start, numbers, base_colors, scratch):
    """Fill the centre in pixels, what the ellipse covers of the image, and the colour without direction."""
    fx, fy, cx, cy = numbers[12:16]
    near, far, _, _, last_x, last_y = numbers[22:28]
    first_x, first_y = numbers[38:40]
    zero, one, half = np.float32(0.0), np.float32(1.0), np.float32(0.5)
    padded = np.uint64(len(base_colors) // 3)
    for j in range(BLOCK):
        i, k = np.uint64(start + j), np.uint64(j)
        a, d = scratch[np.uint64(A) * STRIDE + k], scratch[np.uint64(D) * STRIDE + k]
        z, squared_radius = scratch[np.uint64(DEPTH) * STRIDE + k], scratch[np.uint64(SQUARED_RADIUS) * STRIDE + k]
        x = fx * scratch[np.uint64(col.X) * STRIDE + k] + cx - half
        y = fy * scratch[np.uint64(col.Y) * STRIDE + k] + cy - half
        radius_x, radius_y = math.sqrt(max(squared_radius * a, zero)), math.sqrt(max(squared_radius * d, zero))
        left, right = max(np.ceil(x - radius_x), first_x), min(np.floor(x + radius_x), last_x)
        top, bottom = max(np.ceil(y - radius_y), first_y), min(np.floor(y + radius_y), last_y)
        seen = (z > near) & (z < far) & (squared_radius > zero) & (left <= right) & (top <= bottom)
        scratch[np.uint64(col.X) * STRIDE + k], scratch[np.uint64(col.Y) * STRIDE + k] = x, y
        scratch[np.uint64(RED) * STRIDE + k] = max(base_colors[i], zero)
        scratch[np.uint64(GREEN) * STRIDE + k] = max(base_colors[padded + i], zero)
        scratch[np.uint64(BLUE) * STRIDE + k] = max(base_colors[np.uint64(2) * padded + i], zero)
        scratch[np.uint64(SEEN) * STRIDE + k] = one if seen else zero
        scratch[np.uint64(FIRST_TILE) * STRIDE + k] = _tile_of(left, top)
        scratch[np.uint64(LAST_TILE) * STRIDE + k] = _tile_of(right, bottom)


@part
def _tile_of(x, y):
    """Return a tile as the bits of a float32: scratch memory by two names would end vectorisation."""
    return np.uint32(np.int32(x) >> LOG2_TILE | np.int32(y) >> LOG2_TILE << np.int32(16)).view(np.float32)


@part
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


@part
def _keep_visible(start, scratch, past_caches, records, depth_keys, tiles):
    """Write the record of each splat that covers the centre of a pixel; return how many there are.

    Every record is written where the next visible one belongs, so there is nothing to mispredict. Where all are
    more than the caches hold, they go past them, unless some would be overwritten.
    """
    kept = np.uint64(start)
    half = splat(np.float32(0.5))
    for first in range(0, BLOCK, 8):
        _pack_colors(scratch, first)
        store_transposed(scratch, ROWS_BY_SPLAT, col.LENGTH, scratch, first, BLOCK)
        if past_caches and lanes_at_least(load(scratch, SEEN * BLOCK + first), half) == 0xFF:
            for row in range(0, 8 * col.LENGTH, col.LENGTH):
                store_past_caches(records, np.int64(kept) * col.LENGTH + row, load(scratch, ROWS_BY_SPLAT + row))
        else:
            record = kept
            for lane in range(8):
                store(records, np.int64(record) * col.LENGTH, load(scratch, ROWS_BY_SPLAT + lane * col.LENGTH))
                record += _seen(scratch, np.uint64(first + lane))
        for lane in range(8):
            k = np.uint64(first + lane)
            depth_keys[kept] = _word(scratch, KEY, k)
            tiles[kept] = _word(scratch, FIRST_TILE, k) | _word(scratch, LAST_TILE, k) << np.uint64(32)
            kept += _seen(scratch, k)
    return np.int32(kept - np.uint64(start))


@part
def _pack_colors(scratch, first):
    """Fill COLOR of eight splats, and the column behind it."""
    most = splat(np.float32(HALF_MAX))
    red, green = (
        minimum(load(scratch, RED * BLOCK + first), most),
        minimum(load(scratch, GREEN * BLOCK + first), most),
    )
    blue = minimum(load(scratch, BLUE * BLOCK + first), most)
    store_paired_halves(scratch, col.COLOR * BLOCK + first, red, green)
    store_paired_halves(scratch, (col.COLOR + 1) * BLOCK + first, blue, splat(np.float32(0.0)))


@part
def _seen(scratch, k):
    return np.uint64(_word(scratch, SEEN, k) != np.uint64(0))


@part
def _word(scratch, row, k):
    return np.uint64(np.float32(scratch[np.uint64(row) * STRIDE + k]).view(np.uint32))
