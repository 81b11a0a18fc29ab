"""Bytes of the streams of an SPZ file to the arrays of `Gaussians`, and the axes they are in.

Most values are one byte, so decoding is a table of 256 numbers.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]
Stream = bytes | memoryview

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
_REST = ((_BYTES - 128) / 128).astype(np.float32)
_FIRST_THREE = (_BYTES / 127.5 - 1).astype(np.float32)


def _smallest_table() -> F32:
    sizes = np.arange(1 << SMALLEST_BITS) / ((1 << SMALLEST_BITS) - 1) * math.sqrt(0.5)
    return np.concatenate([sizes, -sizes]).astype(np.float32)


_SMALLEST = _smallest_table()


def decode_fixed(stream: Stream, fractional_bits: int) -> F32:
    """Return means of 24-bit fixed point numbers."""
    wide = np.zeros((len(stream) // 3, 4), np.uint8)
    wide[:, 1:] = np.frombuffer(stream, np.uint8).reshape(-1, 3)
    # The three bytes lie at the top of 32 bits, so shifting them down brings their sign along.
    numbers = wide.view("<i4") >> 8
    return numbers.reshape(-1, 3) * np.float32(2.0**-fractional_bits)


def decode_half(stream: Stream) -> F32:
    """Return means of float16 numbers; those that are not finite become nan."""
    halves = np.frombuffer(stream, "<f2").reshape(-1, 3)
    return np.where(np.isfinite(halves), halves, np.float16(np.nan)).astype(np.float32)


def decode_scales(stream: Stream) -> F32:
    """Return scales of their logarithms in sixteenths."""
    return _SCALES[np.frombuffer(stream, np.uint8)].reshape(-1, 3)


def decode_opacities(stream: Stream) -> F32:
    """Return opacities, which are activated in the file."""
    return _OPACITIES[np.frombuffer(stream, np.uint8)]


def decode_first_three(stream: Stream) -> F32:
    """Return quats of x, y and z in a byte each; w is what is missing to a length of 1, not negative."""
    quats = np.empty((len(stream) // 3, 4), np.float32)
    quats[:, 1:] = _FIRST_THREE[np.frombuffer(stream, np.uint8)].reshape(-1, 3)
    quats[:, 0] = _missing(quats[:, 1:])
    return quats


def decode_smallest_three(stream: Stream) -> F32:
    """Return quats of 32 bits: which component is largest, and the three others."""
    packed = np.frombuffer(stream, "<u4")
    fields = packed[:, None] >> np.array([20, 10, 0], np.uint32) & np.uint32(1023)
    smallest = _SMALLEST[fields]
    largest = packed >> 30
    quats = np.empty((len(packed), 4), np.float32)
    np.put_along_axis(quats, OTHERS[largest], smallest, axis=1)
    quats[np.arange(len(packed)), (largest + 1) % 4] = _missing(smallest)
    return quats


def decode_sh(colours: Stream, rest: Stream, rest_coefficients: int) -> F32:
    """Return harmonics, [N, 1 + rest_coefficients, 3]."""
    first = np.frombuffer(colours, np.uint8).reshape(-1, 3)
    others = np.frombuffer(rest, np.uint8).reshape(len(first), rest_coefficients, 3)
    sh = np.empty((len(first), 1 + others.shape[1], 3), np.float32)
    sh[:, 0] = _COLOURS[first]
    sh[:, 1:] = _REST[others]
    return sh


def half_turn(means: F32, quats: F32, sh: F32) -> None:
    """Turn a scene by half a turn about x, in place: from right-up-back axes to right-down-front, or back."""
    means *= MEANS_SIGNS
    quats *= QUATS_SIGNS
    sh *= SH_SIGNS[: sh.shape[1]]


def _missing(others: F32) -> F32:
    squares: F32 = np.einsum("ij,ij->i", others, others)
    return np.sqrt(np.maximum(np.float32(0), 1 - squares))
