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
_MASKS = ir.VectorType(_SHORT, BATCH)
_FOUR = ir.VectorType(_INT, 4)
_LIFT = 8


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
def _having(typingctx: Any, masks: Any, bit: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = context.make_array(sig.args[0])(context, builder, args[0]).data
        loaded = builder.load(builder.bitcast(pointer, _MASKS.as_pointer()), align=2)
        one = builder.trunc(builder.shl(ir.Constant(_LONG, 1), args[1]), _SHORT)
        wanted = builder.insert_element(ir.Constant(_MASKS, ir.Undefined), one, ir.Constant(_INT, 0))
        everywhere = ir.Constant(ir.VectorType(_INT, BATCH), [0] * BATCH)
        wanted = builder.shuffle_vector(wanted, ir.Constant(_MASKS, ir.Undefined), everywhere)
        found = builder.icmp_unsigned("!=", builder.and_(loaded, wanted), ir.Constant(_MASKS, [0] * BATCH))
        return builder.bitcast(found, _LONG)

    return types.uint64(masks, types.int64), codegen


@device
def _spans(typingctx: Any, ends: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        # Rounding towards zero is rounding down for what is positive.
        positive = builder.fadd(args[0], ir.Constant(args[0].type, [float(_LIFT)] * LANES))
        whole = builder.sub(builder.fptosi(positive, _INT_VECTOR), ir.Constant(_INT_VECTOR, [_LIFT] * LANES))
        last, minus_first = (
            builder.shuffle_vector(whole, whole, ir.Constant(_FOUR, list(lanes)))
            for lanes in (range(4), range(4, LANES))
        )
        ones = ir.Constant(_FOUR, [15] * 4)
        up_to_last = builder.lshr(ones, builder.sub(ir.Constant(_FOUR, [3] * 4), last))
        from_first = builder.shl(ones, builder.sub(ir.Constant(_FOUR, [0] * 4), minus_first))
        rows = builder.shl(builder.and_(up_to_last, from_first), ir.Constant(_FOUR, [0, 4, 8, 12]))
        return builder.zext(_call(builder, "llvm.vector.reduce.or.v4i32", _INT, [rows]), _LONG)

    return types.int64(float8), codegen


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


@_compiled_as(_having)
def having(masks: Any, bit: Any) -> Any:
    """Which of the 64 sets of a uint16 array have the member ``bit``, 0 to 15, as a uint64."""
    return np.uint64(sum(1 << i for i in range(BATCH) if int(masks[i]) >> bit & 1))


@_compiled_as(_spans)
def spans(ends: Any) -> Any:
    """The cells of a 4 by 4 grid between two ends in each row, member ``4 * row + column``.

    Ends are rounded down. A row reaches to column ``ends[row]``, -1 to 3, from column
    ``-ends[row + 4]``, 0 to 4, where -1 and 4 mean none.
    """
    last, first = np.floor(ends[:4]), -np.floor(ends[4:])
    return sum(
        1 << 4 * row + column for row in range(4) for column in range(4) if first[row] <= column <= last[row]
    )
