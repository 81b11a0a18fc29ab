"""Bytes of the streams of an SPZ file to the arrays of `Gaussians`, and the axes they are in.

Most values are one byte, so decoding is a table of 256 numbers.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from tsplat.io.arrays import F32, Arrays
from tsplat.io.smallest_three import fill_quats, missing, sources
from tsplat.io.spz_header import Header

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
_SCALES = np.exp(_BYTES / 16 - 10).astype(np.float32)
_OPACITIES = (_BYTES / 255).astype(np.float32)
_COLOURS = ((_BYTES / 255 - 0.5) / COLOUR_SCALE).astype(np.float32)
_FIRST_THREE = (_BYTES / 127.5 - 1).astype(np.float32)
_REST_STEP = np.float32(1 / 128)
_SMALLEST_SHIFTS = np.array([20, 10, 0], np.uint32)
_PLACES = sources(OTHERS)


def _smallest_table() -> F32:
    sizes = np.arange(1 << SMALLEST_BITS) / ((1 << SMALLEST_BITS) - 1) * math.sqrt(0.5)
    return np.concatenate([sizes, -sizes]).astype(np.float32)


_SMALLEST = _smallest_table()


def decode(name: str, stream: bytes, header: Header, turned: bool, out: Arrays) -> None:
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
            out.sh[:, 0] = np.take(_COLOURS, values.reshape(-1, 3), mode="clip")
        case "scales":
            np.take(_SCALES, values.reshape(-1, 3), out=out.scales, mode="clip")
        case "quats":
            (_first_three if header.version < 3 else _smallest_three)(stream, out.quats)
            if turned:
                _change_signs(out.quats, QUATS_SIGNS)
        case "sh":
            _rest(values, turned, out.sh)


def _fixed(stream: bytes, fractional_bits: int, out: F32) -> None:
    # Each number is read with the byte before it and shifted down, which brings its sign along.
    words = np.ndarray(out.shape, "<i4", b"\0" + stream, strides=(9, 3))
    out[:] = words >> 8
    out *= np.float32(2.0**-fractional_bits)


def _half(stream: bytes, out: F32) -> None:
    out[:] = np.frombuffer(stream, "<f2").reshape(-1, 3)


def _first_three(stream: bytes, out: F32) -> None:
    out[:, 1:] = _FIRST_THREE[np.frombuffer(stream, np.uint8)].reshape(-1, 3)
    out[:, 0] = missing(out[:, 1:])


def _smallest_three(stream: bytes, out: F32) -> None:
    packed = np.frombuffer(stream, "<u4")
    fields = packed[:, None] >> _SMALLEST_SHIFTS & np.uint32(1023)
    fill_quats(np.take(_SMALLEST, fields, mode="clip"), packed >> 30, _PLACES, out)


def _rest(values: U8, turned: bool, sh: F32) -> None:
    signs = (SH_SIGNS if turned else np.ones_like(SH_SIGNS))[1 : sh.shape[1]]
    steps = np.repeat(signs * _REST_STEP, 3, axis=1).ravel()
    # The highest bit turned over makes a byte's distance from 128 of it.
    distances = (values ^ 128).view(np.int8).reshape(len(sh), -1)
    sh.reshape(len(sh), -1)[:, 3:] = distances * steps


def _change_signs(array: F32, signs: F32) -> None:
    # One column after the other: rows are too short to be quick. NumPy 2.4.6 negates in place wrongly where
    # columns are 16 bytes apart, but multiplies well.
    for column in np.flatnonzero(signs < 0):
        array[:, column] *= -1.0
