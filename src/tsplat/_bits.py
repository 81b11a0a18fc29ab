"""Sets as bits of an integer, for kernels: which lanes, which cells, which splats.

As in `_lanes`, each word is a few instructions when compiled and a plain twin otherwise.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types

from tsplat._jit import device
from tsplat._lanes import _INT, _INT_VECTOR, LANES, _call, _compiled_as, float8

BATCH = 64
"""Members of the largest set: the bits of a uint64."""

_BYTE, _SHORT, _LONG = ir.IntType(8), ir.IntType(16), ir.IntType(64)
_SETS, _EIGHT_SETS = ir.VectorType(_SHORT, BATCH), ir.VectorType(_SHORT, LANES)
_BYTES = ir.VectorType(_BYTE, BATCH)


@device
def _lowest(typingctx: Any, bits: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _call(builder, "llvm.cttz.i64", _LONG, [args[0], ir.Constant(ir.IntType(1), 0)])

    return types.int64(types.uint64), codegen


@device
def _others(typingctx: Any, bits: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.and_(args[0], builder.sub(args[0], ir.Constant(_LONG, 1)))

    return types.uint64(types.uint64), codegen


@device
def _count(typingctx: Any, bits: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _call(builder, "llvm.ctpop.i64", _LONG, list(args))

    return types.int64(types.uint64), codegen


@device
def _lanes_at_least(typingctx: Any, x: Any, limit: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.zext(builder.bitcast(builder.fcmp_ordered(">=", *args), _BYTE), _LONG)

    return types.int64(float8, float8), codegen


@device
def _transpose_sets(typingctx: Any, sets: Any, found: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        source, target = (context.make_array(sig.args[k])(context, builder, args[k]).data for k in range(2))
        loaded = builder.load(builder.bitcast(source, _SETS.as_pointer()), align=2)
        upper = builder.trunc(builder.lshr(loaded, ir.Constant(_SETS, [8] * BATCH)), _BYTES)
        for half, first in ((builder.trunc(loaded, _BYTES), 0), (upper, 8)):
            for member in range(first + 7, first - 1, -1):
                # The highest bit is the sign, and signs are gathered by one instruction.
                negative = builder.icmp_signed("<", half, ir.Constant(_BYTES, [0] * BATCH))
                builder.store(builder.bitcast(negative, _LONG), builder.gep(target, [ir.Constant(_LONG, member)]))
                half = builder.add(half, half)
        return context.get_dummy_value()

    return types.void(sets, found), codegen


@device
def _add_spans(typingctx: Any, sets: Any, at: Any, row: Any, before: Any, after: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = context.make_array(sig.args[0])(context, builder, args[0]).data
        pointer = builder.bitcast(builder.gep(pointer, [args[1]]), _EIGHT_SETS.as_pointer())
        before, after = (builder.fptosi(count, _INT_VECTOR) for count in args[3:])
        ones = ir.Constant(_INT_VECTOR, [15] * LANES)
        span = builder.trunc(builder.and_(builder.shl(ones, before), builder.lshr(ones, after)), _EIGHT_SETS)
        shift = builder.trunc(builder.mul(args[2], ir.Constant(_LONG, 4)), _SHORT)
        shift = builder.insert_element(ir.Constant(_EIGHT_SETS, ir.Undefined), shift, ir.Constant(_INT, 0))
        shift = builder.shuffle_vector(shift, shift, ir.Constant(_INT_VECTOR, [0] * LANES))
        sets = builder.or_(builder.load(pointer, align=2), builder.shl(span, shift))
        builder.store(sets, pointer, align=2)
        return context.get_dummy_value()

    return types.void(sets, types.int64, types.int64, float8, float8), codegen


@_compiled_as(_lowest)
def lowest(bits: Any) -> Any:
    """The lowest member of a uint64; 64 when it has none."""
    return (int(bits) & -int(bits)).bit_length() - 1 if bits else BATCH


@_compiled_as(_others)
def others(bits: Any) -> Any:
    """A uint64 without its lowest member; without any when it has none."""
    return np.uint64(int(bits) & (int(bits) - 1) if bits else 0)


@_compiled_as(_count)
def count(bits: Any) -> Any:
    """How many members a uint64 has."""
    return int(bits).bit_count()


@_compiled_as(_lanes_at_least)
def lanes_at_least(x: Any, limit: Any) -> Any:
    """The lanes of ``x`` that are at least ``limit``."""
    return sum(1 << lane for lane in range(LANES) if x[lane] >= limit[lane])


@_compiled_as(_transpose_sets)
def transpose_sets(sets: Any, found: Any) -> None:
    """Write into ``found``, 16 uint64, which of the 64 sets of a uint16 array have the members 0 to 15."""
    for member in range(16):
        found[member] = sum(1 << i for i in range(BATCH) if int(sets[i]) >> member & 1)


@_compiled_as(_add_spans)
def add_spans(sets: Any, at: Any, row: Any, before: Any, after: Any) -> None:
    """Add cells of a row of a 4 by 4 grid, member ``4 * row + column``, to the eight sets from ``at`` on.

    ``before`` of them are left out on the left and ``after`` on the right, 0 to 4, rounded down.
    """
    for lane in range(LANES):
        for column in range(int(before[lane]), 4 - int(after[lane])):
            sets[at + lane] |= 1 << 4 * row + column
