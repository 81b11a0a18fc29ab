"""The entry of a kernel: from packed arguments, see `tsplat._arguments`, to a call of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import typeof
from numba.core import types
from numba.np.arrayobj import populate_array
from numba.np.numpy_support import from_dtype

from tsplat._machine_code import ENTRY

_BYTE, _STATUS, _LONG = ir.IntType(8), ir.IntType(32), ir.IntType(64)

_HEAD = object.__basicsize__
"""Bytes of what all objects of Python begin with. Those that NumPy puts behind it, for all compiled extensions
alike, are: where the values are, the number of dimensions, where the lengths are, where the strides are."""

_DATA, _LENGTHS, _STRIDES = _HEAD, _HEAD + 16, _HEAD + 24


def type_of(argument: Any) -> Any:
    """Return Numba's type of an argument; every array may be written, so that one kernel does for all."""
    if isinstance(argument, np.ndarray):
        layout = "C" if argument.flags.c_contiguous else "A"
        array: Any = types.Array
        return array(from_dtype(argument.dtype), argument.ndim, layout)
    if isinstance(argument, tuple):
        kinds = [type_of(each) for each in argument]
        return types.Tuple(kinds) if type(argument) is tuple else types.NamedTuple(kinds, type(argument))
    return types.int64 if type(argument) is int else typeof(argument)


def define(context: Any, module: Any, compiled: Any) -> str:
    """Add the entry of a compiled function to a module; return what it leaves, see `_machine_code.RESULTS`."""
    signature = ir.FunctionType(_STATUS, [_LONG.as_pointer(), _LONG.as_pointer()])
    function = ir.Function(module, signature, ENTRY)
    builder = ir.IRBuilder(function.append_basic_block())
    packed, place = function.args
    reader = _Reader(context, builder, packed)
    kinds, result_type = compiled.fndesc.argtypes, compiled.fndesc.restype
    values = [reader.read(kind) for kind in kinds]
    target = context.declare_function(module, compiled.fndesc)
    status, result = context.call_conv.call_function(builder, target, result_type, kinds, values)
    with builder.if_then(status.is_error):
        builder.ret(ir.Constant(_STATUS, 1))
    name = _store_result(context, builder, result_type, result, place)
    builder.ret(ir.Constant(_STATUS, 0))
    return name


def _store_result(context: Any, builder: Any, kind: Any, result: Any, place: Any) -> str:
    if kind == types.none:
        return "nothing"
    if isinstance(kind, types.Float):
        value = builder.bitcast(context.cast(builder, result, kind, types.float64), _LONG)
    elif isinstance(kind, types.Boolean | types.Integer):
        value = context.cast(builder, result, kind, types.uint64 if _unsigned(kind) else types.int64)
    else:
        raise TypeError(f"a kernel returns a number, or nothing, not {kind}")
    builder.store(value, place)
    if _unsigned(kind):
        return "unsigned"
    return {types.Float: "float", types.Boolean: "bool"}.get(type(kind), "int")


def _unsigned(kind: Any) -> bool:
    return kind in types.unsigned_domain


class _Reader:
    """Takes one packed argument after the other."""

    def __init__(self, context: Any, builder: Any, packed: Any) -> None:
        self.context, self.builder, self.packed, self.taken = context, builder, packed, 0

    def read(self, kind: Any) -> Any:
        """Return the next argument as a value of this type."""
        if isinstance(kind, types.BaseTuple):
            return self.context.make_tuple(self.builder, kind, [self.read(each) for each in kind])  # type: ignore[attr-defined]
        if kind == types.none:
            return self.context.get_dummy_value()
        word = self.builder.load(self.builder.gep(self.packed, [ir.Constant(_LONG, self.taken)]))
        self.taken += 1
        return self._array(kind, word) if isinstance(kind, types.Array) else self._number(kind, word)

    def _number(self, kind: Any, word: Any) -> Any:
        if isinstance(kind, types.Float):
            bits = self.builder.trunc(word, ir.IntType(kind.bitwidth)) if kind.bitwidth < 64 else word
            return self.builder.bitcast(bits, self.context.get_value_type(kind))
        return self.context.cast(self.builder, word, types.int64, kind)

    def _array(self, kind: Any, address: Any) -> Any:
        context, builder = self.context, self.builder
        array = context.make_array(kind)(context, builder)
        data = self._field(address, _DATA, array.data.type)
        lengths = self._numbers(self._field(address, _LENGTHS, _LONG.as_pointer()), kind.ndim)
        itemsize = context.get_abi_sizeof(context.get_data_type(kind.dtype))
        if kind.layout == "C":  # known when it is compiled, so that loops over the last axis become vectors
            strides = [ir.Constant(_LONG, itemsize)]
            for length in lengths[:0:-1]:
                strides.insert(0, builder.mul(strides[0], length))
        else:
            strides = self._numbers(self._field(address, _STRIDES, _LONG.as_pointer()), kind.ndim)
        populate_array(array, data, lengths, strides[: kind.ndim], itemsize, None)
        return array._getvalue()

    def _field(self, address: Any, offset: int, kind: Any) -> Any:
        place = self.builder.add(address, ir.Constant(_LONG, offset))
        return self.builder.load(self.builder.inttoptr(place, kind.as_pointer()))

    def _numbers(self, pointer: Any, count: int) -> list[Any]:
        return [self.builder.load(self.builder.gep(pointer, [ir.Constant(_LONG, i)])) for i in range(count)]
