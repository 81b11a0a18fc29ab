"""Words for kernels that move eight float32 lanes in other ways than `_lanes.load` and `_lanes.store` do.

As in `_lanes`, each is a few instructions when compiled and a plain twin otherwise.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types

from tsplat._jit import device
from tsplat._lanes import _INT, _INT_VECTOR, _VECTOR, LANES, _call, _compiled_as, _vector_pointer, float8

_HALF_VECTOR = ir.VectorType(ir.HalfType(), LANES)


@device
def _store_past_caches(typingctx: Any, array: Any, offset: Any, value: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _vector_pointer(context, builder, sig.args[0], *args[:2])
        stored = builder.store(args[2], pointer, align=4 * LANES)
        stored.set_metadata("nontemporal", builder.module.add_metadata([ir.Constant(_INT, 1)]))
        return context.get_dummy_value()

    return types.void(array, types.int64, float8), codegen


@device
def _load_half(typingctx: Any, array: Any, offset: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = context.make_array(sig.args[0])(context, builder, args[0]).data
        pointer = builder.bitcast(builder.gep(pointer, [args[1]]), _HALF_VECTOR.as_pointer())
        return builder.fpext(builder.load(pointer, align=2), _VECTOR)

    return float8(array, types.int64), codegen


@device
def _store_half(typingctx: Any, array: Any, offset: Any, value: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = context.make_array(sig.args[0])(context, builder, args[0]).data
        pointer = builder.bitcast(builder.gep(pointer, [args[1]]), _HALF_VECTOR.as_pointer())
        builder.store(builder.fptrunc(args[2], _HALF_VECTOR), pointer, align=2)
        return context.get_dummy_value()

    return types.void(array, types.int64, float8), codegen


@device
def _store_paired_halves(typingctx: Any, array: Any, offset: Any, low: Any, high: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        shorts = ir.VectorType(ir.IntType(16), LANES)
        low, high = (
            builder.zext(builder.bitcast(builder.fptrunc(each, _HALF_VECTOR), shorts), _INT_VECTOR)
            for each in args[2:]
        )
        both = builder.or_(low, builder.shl(high, ir.Constant(_INT_VECTOR, [16] * LANES)))
        pointer = _vector_pointer(context, builder, sig.args[0], *args[:2])
        builder.store(builder.bitcast(both, _VECTOR), pointer, align=4)
        return context.get_dummy_value()

    return types.void(array, types.int64, float8, float8), codegen


@device
def _store_rows(typingctx: Any, array: Any, upper: Any, lower: Any, value: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        _store_two_rows(
            context, builder, sig.args[0], args[:3], args[3], ir.Constant(_VECTOR, ir.Undefined), range(8)
        )
        return context.get_dummy_value()

    return types.void(array, types.int64, types.int64, float8), codegen


@device
def _store_rows_rgb(typingctx: Any, array: Any, upper: Any, lower: Any, red: Any, green: Any, blue: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        red, green, blue = args[3:]
        wide = ir.VectorType(_INT, 2 * LANES)
        both = builder.shuffle_vector(red, green, ir.Constant(wide, list(range(16))))
        padded = builder.shuffle_vector(blue, blue, ir.Constant(wide, list(range(16))))
        lanes = [lane + 8 * channel for lane in range(LANES) for channel in range(3)]
        _store_two_rows(context, builder, sig.args[0], args[:3], both, padded, lanes)
        return context.get_dummy_value()

    return types.void(array, types.int64, types.int64, float8, float8, float8), codegen


@device
def _store_transposed(
    typingctx: Any, target: Any, at: Any, stride: Any, source: Any, start: Any, distance: Any
) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        target, at, stride, source, start, distance = args
        columns = []
        for _ in range(LANES):
            pointer = _vector_pointer(context, builder, sig.args[3], source, start)
            columns.append(builder.load(pointer, align=4))
            start = builder.add(start, distance)
        for row in _transpose(builder, columns):
            builder.store(row, _vector_pointer(context, builder, sig.args[0], target, at), align=4)
            at = builder.add(at, stride)
        return context.get_dummy_value()

    return types.void(target, types.int64, types.int64, source, types.int64, types.int64), codegen


def _transpose(builder: Any, columns: list[Any]) -> list[Any]:
    """Return the rows of eight columns: pairs of lanes are exchanged at distance 1, then 2, then 4."""
    rows = list(columns)
    for distance in (1, 2, 4):
        low = [lane + (LANES - distance if lane & distance else 0) for lane in range(LANES)]
        high = [lane + (LANES if lane & distance else distance) for lane in range(LANES)]
        for first in range(LANES):
            if not first & distance:
                pair = rows[first], rows[first + distance]
                rows[first], rows[first + distance] = (
                    builder.shuffle_vector(*pair, ir.Constant(_INT_VECTOR, chosen)) for chosen in (low, high)
                )
    return rows


def _store_two_rows(
    context: Any, builder: Any, array_type: Any, place: Any, first: Any, second: Any, lanes: Any
) -> None:
    """Store half of the chosen lanes of two vectors at the upper offset, half at the lower one."""
    array, *offsets = place
    pointer = context.make_array(array_type)(context, builder, array).data
    half = len(lanes) // 2
    for offset, chosen in zip(offsets, (lanes[:half], lanes[half:]), strict=True):
        row = builder.shuffle_vector(first, second, ir.Constant(ir.VectorType(_INT, half), list(chosen)))
        target = builder.bitcast(builder.gep(pointer, [offset]), row.type.as_pointer())
        builder.store(row, target, align=4)


@device
def _prefetch(typingctx: Any, array: Any, offset: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = context.make_array(sig.args[0])(context, builder, args[0]).data
        address = builder.bitcast(builder.gep(pointer, [args[1]]), ir.IntType(8).as_pointer())
        hints = [ir.Constant(_INT, value) for value in (0, 3, 1)]  # to read, keep it close, data
        _call(builder, "llvm.prefetch.p0", ir.VoidType(), [address, *hints])
        return context.get_dummy_value()

    return types.void(array, types.int64), codegen


@_compiled_as(_store_past_caches)
def store_past_caches(array: Any, offset: Any, value: Any) -> None:
    """Put eight values into an array that starts a cache line, from a multiple of eight on, past the caches."""
    array[offset : offset + LANES] = value


@_compiled_as(_load_half)
def load_half(array: Any, offset: Any) -> Any:
    """The eight half-precision values of a flat uint16 array that start at ``offset``."""
    return array[offset : offset + LANES].view(np.float16).astype(np.float32)


@_compiled_as(_store_half)
def store_half(array: Any, offset: Any, value: Any) -> None:
    """Put eight values into a flat uint16 array from ``offset`` on, as half-precision numbers."""
    array[offset : offset + LANES] = value.astype(np.float16).view(np.uint16)


@_compiled_as(_store_paired_halves)
def store_paired_halves(array: Any, offset: Any, low: Any, high: Any) -> None:
    """Put two half-precision numbers into each of eight float32 of a flat array, ``low`` in the low bits."""
    low, high = (each.astype(np.float16).view(np.uint16).astype(np.uint32) for each in (low, high))
    array[offset : offset + LANES] = (low | high << np.uint32(16)).view(np.float32)


@_compiled_as(_store_rows)
def store_rows(array: Any, upper: Any, lower: Any, value: Any) -> None:
    """Put the first four lanes at offset ``upper`` of a flat float32 array, the others at ``lower``."""
    array[upper : upper + 4], array[lower : lower + 4] = value[:4], value[4:]


@_compiled_as(_store_rows_rgb)
def store_rows_rgb(array: Any, upper: Any, lower: Any, red: Any, green: Any, blue: Any) -> None:
    """Put red, green and blue of the first four lanes at offset ``upper``, of the others at ``lower``."""
    pixels = np.stack([red, green, blue], 1).ravel()
    array[upper : upper + 12], array[lower : lower + 12] = pixels[:12], pixels[12:]


@_compiled_as(_store_transposed)
def store_transposed(target: Any, at: Any, stride: Any, source: Any, start: Any, distance: Any) -> None:
    """Copy eight vectors, ``distance`` apart, as the columns of eight rows of eight values, ``stride`` apart."""
    for lane in range(LANES):
        for column in range(LANES):
            target[at + lane * stride + column] = source[start + column * distance + lane]


@_compiled_as(_prefetch)
def prefetch(array: Any, offset: Any) -> None:
    """Ask the processor to bring the cache line of ``array[offset]`` closer; changes no value."""
