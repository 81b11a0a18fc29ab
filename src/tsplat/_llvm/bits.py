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
_MASKS = ir.VectorType(_SHORT, BATCH)
_FOUR = ir.VectorType(INT, 4)
_LIFT = 8


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


@instructions_of(bits.having)
def _having(typingctx: Any, masks: Any, bit: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        place = pointer(context, builder, sig.args[0], (args[0], ir.Constant(_LONG, 0)), _MASKS)
        loaded = builder.load(place, align=2)
        one = builder.trunc(builder.shl(ir.Constant(_LONG, 1), args[1]), _SHORT)
        wanted = builder.insert_element(ir.Constant(_MASKS, ir.Undefined), one, ir.Constant(INT, 0))
        everywhere = ir.Constant(ir.VectorType(INT, BATCH), [0] * BATCH)
        wanted = builder.shuffle_vector(wanted, ir.Constant(_MASKS, ir.Undefined), everywhere)
        found = builder.icmp_unsigned("!=", builder.and_(loaded, wanted), ir.Constant(_MASKS, [0] * BATCH))
        return builder.bitcast(found, _LONG)

    return types.uint64(masks, types.int64), codegen


@instructions_of(bits.spans)
def _spans(typingctx: Any, ends: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        # Rounding towards zero is rounding down for what is positive.
        positive = builder.fadd(args[0], ir.Constant(args[0].type, [float(_LIFT)] * LANES))
        whole = builder.sub(builder.fptosi(positive, INT_VECTOR), ir.Constant(INT_VECTOR, [_LIFT] * LANES))
        last, minus_first = (
            builder.shuffle_vector(whole, whole, ir.Constant(_FOUR, list(lanes)))
            for lanes in (range(4), range(4, LANES))
        )
        ones = ir.Constant(_FOUR, [15] * 4)
        up_to_last = builder.lshr(ones, builder.sub(ir.Constant(_FOUR, [3] * 4), last))
        from_first = builder.shl(ones, builder.sub(ir.Constant(_FOUR, [0] * 4), minus_first))
        rows = builder.shl(builder.and_(up_to_last, from_first), ir.Constant(_FOUR, [0, 4, 8, 12]))
        return builder.zext(call(builder, "llvm.vector.reduce.or.v4i32", INT, [rows]), _LONG)

    return types.int64(float8), codegen
