"""`tsplat._bits` as instructions."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types

from tsplat import _bits as bits
from tsplat._bits import BATCH
from tsplat._lanes import LANES
from tsplat._llvm.lanes import INT, INT_VECTOR, float8
from tsplat._llvm.words import call, instructions_of, pointer

_BYTE, _SHORT, _LONG = ir.IntType(8), ir.IntType(16), ir.IntType(64)
_SETS, _EIGHT_SETS = ir.VectorType(_SHORT, BATCH), ir.VectorType(_SHORT, LANES)
_BYTES = ir.VectorType(_BYTE, BATCH)


@instructions_of(bits.lowest)
def _lowest(typingctx: Any, bits: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return call(builder, "llvm.cttz.i64", _LONG, [args[0], ir.Constant(ir.IntType(1), 0)])

    return types.int64(types.uint64), codegen


@instructions_of(bits.others)
def _others(typingctx: Any, bits: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.and_(args[0], builder.sub(args[0], ir.Constant(_LONG, 1)))

    return types.uint64(types.uint64), codegen


@instructions_of(bits.count)
def _count(typingctx: Any, bits: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return call(builder, "llvm.ctpop.i64", _LONG, list(args))

    return types.int64(types.uint64), codegen


@instructions_of(bits.lanes_at_least)
def _lanes_at_least(typingctx: Any, x: Any, limit: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.zext(builder.bitcast(builder.fcmp_ordered(">=", *args), _BYTE), _LONG)

    return types.int64(float8, float8), codegen


@instructions_of(bits.transpose_sets)
def _transpose_sets(typingctx: Any, sets: Any, found: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        zero = ir.Constant(_LONG, 0)
        loaded = builder.load(pointer(context, builder, sig.args[0], (args[0], zero), _SETS), align=2)
        upper = builder.trunc(builder.lshr(loaded, ir.Constant(_SETS, [8] * BATCH)), _BYTES)
        for half, first in ((builder.trunc(loaded, _BYTES), 0), (upper, 8)):
            for member in range(first + 7, first - 1, -1):
                # The highest bit is the sign, and signs are gathered by one instruction.
                negative = builder.icmp_signed("<", half, ir.Constant(_BYTES, [0] * BATCH))
                place = pointer(context, builder, sig.args[1], (args[1], ir.Constant(_LONG, member)))
                builder.store(builder.bitcast(negative, _LONG), place)
                half = builder.add(half, half)
        return context.get_dummy_value()

    return types.void(sets, found), codegen


@instructions_of(bits.add_spans)
def _add_spans(typingctx: Any, sets: Any, at: Any, row: Any, before: Any, after: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        place = pointer(context, builder, sig.args[0], args[:2], _EIGHT_SETS)
        before, after = (builder.fptosi(count, INT_VECTOR) for count in args[3:])
        ones = ir.Constant(INT_VECTOR, [15] * LANES)
        span = builder.trunc(builder.and_(builder.shl(ones, before), builder.lshr(ones, after)), _EIGHT_SETS)
        shift = builder.trunc(builder.mul(args[2], ir.Constant(_LONG, 4)), _SHORT)
        shift = builder.insert_element(ir.Constant(_EIGHT_SETS, ir.Undefined), shift, ir.Constant(INT, 0))
        shift = builder.shuffle_vector(shift, shift, ir.Constant(INT_VECTOR, [0] * LANES))
        builder.store(builder.or_(builder.load(place, align=2), builder.shl(span, shift)), place, align=2)
        return context.get_dummy_value()

    return types.void(sets, types.int64, types.int64, float8, float8), codegen
