"""Eight float32 lanes: the small vocabulary in which kernels spell SIMD.

``Float8`` values support ``+ - * /`` among themselves and the functions below. LLVM's vectors are
portable (AVX2, AVX-512, NEON), and Numba keeps them in registers. With NUMBA_DISABLE_JIT the same
names work on float32 [8] arrays, so a kernel reads and runs the same either way.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel.models import PrimitiveModel
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, register_model

from tsplat._jit import JIT, device

LANES = 8
_FLOAT, _INT = ir.FloatType(), ir.IntType(32)
_VECTOR, _INT_VECTOR = ir.VectorType(_FLOAT, LANES), ir.VectorType(_INT, LANES)
_HALF_VECTOR = ir.VectorType(ir.HalfType(), LANES)

EXP2_CUBIC = (0.0551716672, 0.2426111221, 0.6932609858, 0.9999280736)
"""2**f for f in [-0.5, 0.5], highest power first: the least relative error a cubic can have, 7.5e-5."""

ROUNDING_MAGIC = 12582912.0
"""1.5 * 2**23: adding it leaves the nearest integer in the low bits of a float32."""


class Float8Type(types.Type):  # type: ignore[misc]
    """Numba's type of eight float32 lanes."""

    def __init__(self) -> None:
        super().__init__(name="Float8")


float8 = Float8Type()


@register_model(Float8Type)  # type: ignore[untyped-decorator]
class _Float8Model(PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, fe_type: Any) -> None:
        super().__init__(manager, fe_type, _VECTOR)


def _define_operator(symbol: Callable[..., Any], instruction: str) -> None:
    class Template(AbstractTemplate):  # type: ignore[misc]
        def generic(self, args: Any, kws: Any) -> Any:
            return signature(float8, *args) if args == (float8, float8) and not kws else None

    infer_global(symbol)(Template)

    @lower_builtin(symbol, float8, float8)  # type: ignore[untyped-decorator]
    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return getattr(builder, instruction)(*args, flags=("contract",))


for _symbol, _instruction in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _define_operator(_symbol, _instruction)


def _constant(value: float) -> Any:
    return ir.Constant(_VECTOR, [float(np.float32(value))] * LANES)


def _vector_pointer(context: Any, builder: Any, array_type: Any, array: Any, offset: Any) -> Any:
    pointer = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(pointer, [offset]), _VECTOR.as_pointer())


def _call(builder: Any, name: str, result: Any, args: list[Any]) -> Any:
    function_type = ir.FunctionType(result, [arg.type for arg in args])
    return builder.call(cgutils.get_or_insert_function(builder.module, function_type, name), args)


@device
def _splat(typingctx: Any, value: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), args[0], ir.Constant(_INT, 0))
        return builder.shuffle_vector(
            one, ir.Constant(_VECTOR, ir.Undefined), ir.Constant(_INT_VECTOR, [0] * LANES)
        )

    return float8(types.float32), codegen


@device
def _load(typingctx: Any, array: Any, offset: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load(_vector_pointer(context, builder, sig.args[0], *args), align=4)

    return float8(array, types.int64), codegen


@device
def _store(typingctx: Any, array: Any, offset: Any, value: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.store(args[2], _vector_pointer(context, builder, sig.args[0], *args[:2]), align=4)
        return context.get_dummy_value()

    return types.void(array, types.int64, float8), codegen


@device
def _store_past_caches(typingctx: Any, array: Any, offset: Any, value: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        pointer = _vector_pointer(context, builder, sig.args[0], *args[:2])
        stored = builder.store(args[2], pointer, align=4 * LANES)
        stored.set_metadata("nontemporal", builder.module.add_metadata([ir.Constant(_INT, 1)]))
        return context.get_dummy_value()

    return types.void(array, types.int64, float8), codegen


@device
def _fma(typingctx: Any, x: Any, y: Any, z: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _call(builder, f"llvm.fma.v{LANES}f32", _VECTOR, list(args))

    return float8(float8, float8, float8), codegen


@device
def _minimum(typingctx: Any, x: Any, y: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        # One instruction, where llvm.minnum needs three to get nan right.
        return builder.select(builder.fcmp_ordered("<", *args), *args)

    return float8(float8, float8), codegen


@device
def _maximum(typingctx: Any, x: Any, y: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", *args), *args)

    return float8(float8, float8), codegen


@device
def _where_at_least(typingctx: Any, x: Any, limit: Any, value: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">=", args[0], args[1]), args[2], _constant(0.0))

    return float8(float8, float8, float8), codegen


@device
def _where_above(typingctx: Any, x: Any, limit: Any, value: Any, other: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", args[0], args[1]), args[2], args[3])

    return float8(float8, float8, float8, float8), codegen


@device
def _minus_abs(typingctx: Any, x: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        sign = ir.Constant(_INT_VECTOR, [-(2**31)] * LANES)
        return builder.bitcast(builder.or_(builder.bitcast(args[0], _INT_VECTOR), sign), _VECTOR)

    return float8(float8), codegen


@device
def _exp2(typingctx: Any, x: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        magic = _constant(ROUNDING_MAGIC)
        shifted = builder.fadd(args[0], magic)
        fraction = builder.fsub(args[0], builder.fsub(shifted, magic))
        power = _constant(EXP2_CUBIC[0])
        for coefficient in EXP2_CUBIC[1:]:
            power = _call(builder, f"llvm.fma.v{LANES}f32", _VECTOR, [power, fraction, _constant(coefficient)])
        exponent = builder.shl(builder.bitcast(shifted, _INT_VECTOR), ir.Constant(_INT_VECTOR, [23] * LANES))
        return builder.bitcast(builder.add(builder.bitcast(power, _INT_VECTOR), exponent), _VECTOR)

    return float8(float8), codegen


@device
def _sqrt(typingctx: Any, x: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _call(builder, f"llvm.sqrt.v{LANES}f32", _VECTOR, list(args))

    return float8(float8), codegen


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


def _compiled_as(device_function: Any) -> Callable[[Callable[..., Any]], Any]:
    """Replace a word's plain twin, which says what it means, by the instructions that do it."""
    return lambda plain: device_function if JIT else plain


@_compiled_as(_splat)
def splat(value: Any) -> Any:
    """Eight times the same float32."""
    return np.full(LANES, value, np.float32)


@_compiled_as(_load)
def load(array: Any, offset: Any) -> Any:
    """The eight values of a flat float32 array that start at ``offset``."""
    return array[offset : offset + LANES].copy()


@_compiled_as(_store)
def store(array: Any, offset: Any, value: Any) -> None:
    """Put eight values into a flat float32 array from ``offset`` on."""
    array[offset : offset + LANES] = value


@_compiled_as(_store_past_caches)
def store_past_caches(array: Any, offset: Any, value: Any) -> None:
    """Put eight values into an array that starts a cache line, from a multiple of eight on, past the caches."""
    array[offset : offset + LANES] = value


@_compiled_as(_fma)
def fma(x: Any, y: Any, z: Any) -> Any:
    """``x * y + z``, rounded once where the processor can."""
    return x * y + z


@_compiled_as(_minimum)
def minimum(x: Any, y: Any) -> Any:
    """The smaller of two lanes; ``y`` where either is nan."""
    return np.where(x < y, x, y)


@_compiled_as(_maximum)
def maximum(x: Any, y: Any) -> Any:
    """The larger of two lanes; ``y`` where either is nan."""
    return np.where(x > y, x, y)


@_compiled_as(_where_at_least)
def where_at_least(x: Any, limit: Any, value: Any) -> Any:
    """``value`` where ``x >= limit``, else 0."""
    return np.where(x >= limit, value, np.float32(0.0))


@_compiled_as(_where_above)
def where_above(x: Any, limit: Any, value: Any, other: Any) -> Any:
    """``value`` where ``x > limit``, else ``other``."""
    return np.where(x > limit, value, other)


@_compiled_as(_minus_abs)
def minus_abs(x: Any) -> Any:
    """``-|x|``."""
    return -np.abs(x)


@_compiled_as(_exp2)
def exp2(x: Any) -> Any:
    """``2**x`` to a relative 1e-4 for x in [-120, 120]; anything, never a trap, elsewhere."""
    shifted = x + np.float32(ROUNDING_MAGIC)
    fraction = x - (shifted - np.float32(ROUNDING_MAGIC))
    power = np.full(LANES, EXP2_CUBIC[0], np.float32)
    for coefficient in EXP2_CUBIC[1:]:
        power = power * fraction + np.float32(coefficient)
    return (power.view(np.int32) + (shifted.view(np.int32) << 23)).view(np.float32)


@_compiled_as(_sqrt)
def sqrt(x: Any) -> Any:
    """Square roots; nan below zero."""
    return np.sqrt(x)


@_compiled_as(_load_half)
def load_half(array: Any, offset: Any) -> Any:
    """The eight half-precision values of a flat uint16 array that start at ``offset``."""
    return array[offset : offset + LANES].view(np.float16).astype(np.float32)


@_compiled_as(_store_half)
def store_half(array: Any, offset: Any, value: Any) -> None:
    """Put eight values into a flat uint16 array from ``offset`` on, as half-precision numbers."""
    array[offset : offset + LANES] = value.astype(np.float16).view(np.uint16)


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
