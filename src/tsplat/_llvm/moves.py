"""`tsplat._moves` as instructions."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types

from tsplat import _moves as moves
from tsplat._lanes import LANES
from tsplat._llvm.lanes import INT, INT_VECTOR, VECTOR, float8
from tsplat._llvm.words import call, instructions_of, pointer

_HALF_VECTOR = ir.VectorType(ir.HalfType(), LANES)


@instructions_of(moves.store_past_caches)
def _store_past_caches(typingctx: Any, array: Any, offset: Any, value: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        place = pointer(context, builder, sig.args[0], args[:2], VECTOR)
        stored = builder.store(args[2], place, align=4 * LANES)
        stored.set_metadata("nontemporal", builder.module.add_metadata([ir.Constant(INT, 1)]))
        return context.get_dummy_value()

    return types.void(array, types.int64, float8), codegen


@instructions_of(moves.load_half)
def _load_half(typingctx: Any, array: Any, offset: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        place = pointer(context, builder, sig.args[0], args, _HALF_VECTOR)
        return builder.fpext(builder.load(place, align=2), VECTOR)

    return float8(array, types.int64), codegen


@instructions_of(moves.store_half)
def _store_half(typingctx: Any, array: Any, offset: Any, value: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        place = pointer(context, builder, sig.args[0], args[:2], _HALF_VECTOR)
        builder.store(builder.fptrunc(args[2], _HALF_VECTOR), place, align=2)
        return context.get_dummy_value()

    return types.void(array, types.int64, float8), codegen


@instructions_of(moves.store_paired_halves)
def _store_paired_halves(typingctx: Any, array: Any, offset: Any, low: Any, high: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        shorts = ir.VectorType(ir.IntType(16), LANES)
        low, high = (
            builder.zext(builder.bitcast(builder.fptrunc(each, _HALF_VECTOR), shorts), INT_VECTOR)
            for each in args[2:]
        )
        both = builder.or_(low, builder.shl(high, ir.Constant(INT_VECTOR, [16] * LANES)))
        place = pointer(context, builder, sig.args[0], args[:2], VECTOR)
        builder.store(builder.bitcast(both, VECTOR), place, align=4)
        return context.get_dummy_value()

    return types.void(array, types.int64, float8, float8), codegen


@instructions_of(moves.first_halves)
def _first_halves(typingctx: Any, one: Any, other: Any) -> Any:
    return float8(float8, float8), _chosen_lanes([0, 1, 2, 3, 8, 9, 10, 11])


@instructions_of(moves.second_halves)
def _second_halves(typingctx: Any, one: Any, other: Any) -> Any:
    return float8(float8, float8), _chosen_lanes([4, 5, 6, 7, 12, 13, 14, 15])


def _chosen_lanes(lanes: list[int]) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.shuffle_vector(*args, ir.Constant(INT_VECTOR, lanes))

    return codegen


@instructions_of(moves.interleaved)
def _interleaved(typingctx: Any, red: Any, green: Any, blue: Any) -> Any:
    wide = ir.Constant(ir.VectorType(INT, 2 * LANES), list(range(2 * LANES)))

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        red, green, blue = args
        both, padded = builder.shuffle_vector(red, green, wide), builder.shuffle_vector(blue, blue, wide)
        lanes = [lane + LANES * channel for lane in range(LANES) for channel in range(3)]
        rows = [
            builder.shuffle_vector(both, padded, ir.Constant(INT_VECTOR, lanes[first : first + LANES]))
            for first in range(0, 3 * LANES, LANES)
        ]
        return context.make_tuple(builder, sig.return_type, rows)

    return types.UniTuple(float8, 3)(float8, float8, float8), codegen


@instructions_of(moves.store_transposed)
def _store_transposed(
    typingctx: Any, target: Any, at: Any, stride: Any, source: Any, start: Any, distance: Any
) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        target, at, stride, source, start, distance = args
        columns = []
        for _ in range(LANES):
            place = pointer(context, builder, sig.args[3], (source, start), VECTOR)
            columns.append(builder.load(place, align=4))
            start = builder.add(start, distance)
        for row in _transpose(builder, columns):
            builder.store(row, pointer(context, builder, sig.args[0], (target, at), VECTOR), align=4)
            at = builder.add(at, stride)
        return context.get_dummy_value()

    return types.void(target, types.int64, types.int64, source, types.int64, types.int64), codegen


@instructions_of(moves.prefetch)
def _prefetch(typingctx: Any, array: Any, offset: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        address = pointer(context, builder, sig.args[0], args, ir.IntType(8))
        hints = [ir.Constant(INT, value) for value in (0, 3, 1)]  # to read, keep it close, data
        call(builder, "llvm.prefetch.p0", ir.VoidType(), [address, *hints])
        return context.get_dummy_value()

    return types.void(array, types.int64), codegen


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
                    builder.shuffle_vector(*pair, ir.Constant(INT_VECTOR, chosen)) for chosen in (low, high)
                )
    return rows
