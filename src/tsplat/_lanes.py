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
def _eighth_power(typingctx: Any, x: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        power = args[0]
        for _ in range(3):
            power = builder.fmul(power, power)
        return power

    return float8(float8), codegen


@device
def _sqrt(typingctx: Any, x: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return _call(builder, f"llvm.sqrt.v{LANES}f32", _VECTOR, list(args))

    return float8(float8), codegen


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


@_compiled_as(_eighth_power)
def eighth_power(x: Any) -> Any:
    """``x**8``; infinity where that is too large."""
    with np.errstate(over="ignore"):
        return x**8


@_compiled_as(_sqrt)
def sqrt(x: Any) -> Any:
    """Square roots; nan below zero."""
    with np.errstate(invalid="ignore"):
        return np.sqrt(x)
