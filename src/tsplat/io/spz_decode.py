"""Bytes of the streams of an SPZ file to the arrays of `Gaussians`, and the axes they are in.

Most values are one byte, so decoding is a table of 256 numbers.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from tsplat.decode import Decoders
from tsplat.io.arrays import F32, Arrays
from tsplat.io.finish import make_unit
from tsplat.io.smallest_three import missing
from tsplat.io.spz_header import Header
from tsplat.scene import SH_COEFFICIENTS

U8 = npt.NDArray[np.uint8]

COLOUR_SCALE = 0.15
"""A colour's byte, from 0 to 1, is 0.5 plus this times f_dc: it holds some colours below black and above white."""

SMALLEST_BITS = 9
"""Bits of the size of a quat's smaller component; a tenth is its sign."""

OTHERS = np.array([[2, 3, 0], [1, 3, 0], [1, 2, 0], [1, 2, 3]], np.intp)
"""Which components of ``wxyz`` are stored, in order, by the number in ``xyzw`` of the largest."""

MEANS_SIGNS = np.array([1, -1, -1], np.float32)
QUATS_SIGNS = np.array([1, 1, -1, -1], np.float32)
SH_SIGNS = np.array(
    [[1, -1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1, -1, 1, -1, 1, 1, -1, 1, -1, 1]], np.float32
).T
"""What half a turn about x makes of the harmonics: each is odd or even in y and z together."""

_BYTES = np.arange(256, dtype=np.float64)
SCALES = np.exp(_BYTES / 16 - 10).astype(np.float32)
"""What the bytes of a scale stand for: logarithms in sixteenths."""
_OPACITIES = (_BYTES / 255).astype(np.float32)
_FIRST_THREE = (_BYTES / 127.5 - 1).astype(np.float32)
_COLOUR_MIDDLE = np.float32(127.5)
_COLOUR_STEPS = np.full(3, 1 / (255 * COLOUR_SCALE), np.float32)
_REST_MIDDLE = np.float32(128)
_REST_STEP = np.float32(1 / 128)
_PLACES = np.insert(OTHERS, 0, [1, 2, 3, 0], axis=1).astype(np.uint8)
"""Where in ``wxyz`` the largest belongs, by its number in ``xyzw``, and then the others."""


def _smallest_table() -> F32:
    sizes = np.arange(1 << SMALLEST_BITS) / ((1 << SMALLEST_BITS) - 1) * math.sqrt(0.5)
    return np.concatenate([sizes, -sizes]).astype(np.float32)


_SMALLEST = _smallest_table()


def decode(name: str, stream: bytes, header: Header, turned: bool, decode_with: Decoders, out: Arrays) -> None:
    """Decode some splats' bytes of one stream.

    Parameters
    ----------
    name : str
        Of the stream, as in `Header.streams`.
    stream : bytes
        As many as ``out`` has rows for.
    header : Header
        Of the file.
    turned : bool
        Turn the scene by half a turn about x: from right-up-back axes to right-down-front.
    decode_with : Decoders
        As from `tsplat.decode.decoders`.
    out : Arrays
        Where to; the arrays that the stream says nothing of stay as they are.
    """
    values = np.frombuffer(stream, np.uint8)
    match name:
        case "means":
            if header.version == 1:
                _half(stream, out.means)
            else:
                _fixed(stream, header.fractional_bits, out.means)
            if turned:
                _change_signs(out.means, MEANS_SIGNS)
        case "opacities":
            np.take(_OPACITIES, values, out=out.opacities, mode="clip")
        case "colours":
            flat = out.sh.reshape(len(out.sh), -1)
            decode_with.scale(values.reshape(-1, 3), _COLOUR_MIDDLE, _COLOUR_STEPS, 0, flat)
        case "scales":
            np.take(SCALES, values.reshape(-1, 3), out=out.scales, mode="clip")
        case "quats":
            if header.version < 3:
                _first_three(values, out.quats)
            else:
                words = np.frombuffer(stream, "<u4").astype(np.uint32, copy=False)
                decode_with.smallest_three(words, _SMALLEST, _PLACES, out.quats)
            if turned:
                _change_signs(out.quats, QUATS_SIGNS)
        case "sh":
            flat = out.sh.reshape(len(out.sh), -1)
            steps = _rest_steps(out.sh.shape[1], turned)
            decode_with.scale(values.reshape(len(flat), -1), _REST_MIDDLE, steps, 3, flat)


def _fixed(stream: bytes, fractional_bits: int, out: F32) -> None:
    # Each number is read with the byte before it and shifted down, which brings its sign along.
    words = np.ndarray(out.shape, "<i4", b"\0" + stream, strides=(9, 3))
    out[:] = words >> 8
    out *= np.float32(2.0**-fractional_bits)


def _half(stream: bytes, out: F32) -> None:
    out[:] = np.frombuffer(stream, "<f2").reshape(-1, 3)


def _first_three(values: U8, out: F32) -> None:
    out[:, 1:] = _FIRST_THREE[values].reshape(-1, 3)
    out[:, 0] = missing(out[:, 1:])
    make_unit(out)


@lru_cache(maxsize=2 * len(SH_COEFFICIENTS))
def _rest_steps(k: int, turned: bool) -> F32:
    # What one more of a byte makes of each value behind the first three.
    signs = SH_SIGNS if turned else np.ones_like(SH_SIGNS)
    return np.repeat(signs[1:k] * _REST_STEP, 3)


def _change_signs(array: F32, signs: F32) -> None:
    # One column after the other: rows are too short to be quick. NumPy 2.4.6 negates in place wrongly where
    # columns are 16 bytes apart, but multiplies well.
    for column in np.flatnonzero(signs < 0):
        array[:, column] *= -1.0
