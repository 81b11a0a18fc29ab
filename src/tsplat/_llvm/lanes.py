"""`tsplat._lanes` as instructions: LLVM's vectors are portable (AVX2, AVX-512, NEON) and kept in registers."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.core.datamodel.models import PrimitiveModel
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, register_model

from tsplat import _lanes as lanes
from tsplat._lanes import EXP2_CUBIC, LANES, ROUNDING_MAGIC
from tsplat._llvm.words import call, instructions_of, pointer

INT = ir.IntType(32)
VECTOR, INT_VECTOR = ir.VectorType(ir.FloatType(), LANES), ir.VectorType(INT, LANES)


class Float8Type(types.Type):  # type: ignore[misc]
    """Numba's type of eight float32 lanes."""

    def __init__(self) -> None:
        super().__init__(name="Float8")


float8 = Float8Type()


@register_model(Float8Type)  # type: ignore[untyped-decorator]
class _Float8Model(PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, fe_type: Any) -> None:
        super().__init__(manager, fe_type, VECTOR)


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
    return ir.Constant(VECTOR, [float(np.float32(value))] * LANES)


@instructions_of(lanes.splat)
def _splat(typingctx: Any, value: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        one = builder.insert_element(ir.Constant(VECTOR, ir.Undefined), args[0], ir.Constant(INT, 0))
        return builder.shuffle_vector(one, ir.Constant(VECTOR, ir.Undefined), ir.Constant(INT_VECTOR, [0] * LANES))

    return float8(types.float32), codegen


@instructions_of(lanes.load)
def _load(typingctx: Any, array: Any, offset: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load(pointer(context, builder, sig.args[0], args, VECTOR), align=4)

    return float8(array, types.int64), codegen


@instructions_of(lanes.store)
def _store(typingctx: Any, array: Any, offset: Any, value: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.store(args[2], pointer(context, builder, sig.args[0], args[:2], VECTOR), align=4)
        return context.get_dummy_value()

    return types.void(array, types.int64, float8), codegen


@instructions_of(lanes.fma)
def _fma(typingctx: Any, x: Any, y: Any, z: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return call(builder, f"llvm.fma.v{LANES}f32", VECTOR, list(args))

    return float8(float8, float8, float8), codegen


@instructions_of(lanes.minimum)
def _minimum(typingctx: Any, x: Any, y: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        # One instruction, where llvm.minnum needs three to get nan right.
        return builder.select(builder.fcmp_ordered("<", *args), *args)

    return float8(float8, float8), codegen


@instructions_of(lanes.maximum)
def _maximum(typingctx: Any, x: Any, y: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", *args), *args)

    return float8(float8, float8), codegen


@instructions_of(lanes.where_at_least)
def _where_at_least(typingctx: Any, x: Any, limit: Any, value: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">=", args[0], args[1]), args[2], _constant(0.0))

    return float8(float8, float8, float8), codegen


@instructions_of(lanes.where_above)
def _where_above(typingctx: Any, x: Any, limit: Any, value: Any, other: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", args[0], args[1]), args[2], args[3])

    return float8(float8, float8, float8, float8), codegen


@instructions_of(lanes.minus_abs)
def _minus_abs(typingctx: Any, x: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        sign = ir.Constant(INT_VECTOR, [-(2**31)] * LANES)
        return builder.bitcast(builder.or_(builder.bitcast(args[0], INT_VECTOR), sign), VECTOR)

    return float8(float8), codegen


@instructions_of(lanes.exp2)
def _exp2(typingctx: Any, x: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        magic = _constant(ROUNDING_MAGIC)
        shifted = builder.fadd(args[0], magic)
        fraction = builder.fsub(args[0], builder.fsub(shifted, magic))
        power = _constant(EXP2_CUBIC[0])
        for coefficient in EXP2_CUBIC[1:]:
            power = call(builder, f"llvm.fma.v{LANES}f32", VECTOR, [power, fraction, _constant(coefficient)])
        exponent = builder.shl(builder.bitcast(shifted, INT_VECTOR), ir.Constant(INT_VECTOR, [23] * LANES))
        return builder.bitcast(builder.add(builder.bitcast(power, INT_VECTOR), exponent), VECTOR)

    return float8(float8), codegen


@instructions_of(lanes.eighth_power)
def _eighth_power(typingctx: Any, x: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        power = args[0]
        for _ in range(3):
            power = builder.fmul(power, power)
        return power

    return float8(float8), codegen


@instructions_of(lanes.sqrt)
def _sqrt(typingctx: Any, x: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return call(builder, f"llvm.sqrt.v{LANES}f32", VECTOR, list(args))

    return float8(float8), codegen
