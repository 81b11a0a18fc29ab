"""`tsplat._threads` as instructions and calls of the system."""

from __future__ import annotations

import sys
import time
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types

from tsplat import _threads as threads
from tsplat._llvm.words import call, instructions_of, pointer

_INT, _LONG = ir.IntType(32), ir.IntType(64)


def _place(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return pointer(context, builder, sig.args[0], args)


@instructions_of(threads.claim)
def _claim(typingctx: Any, team: Any, place: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.atomic_rmw("add", _place(context, builder, sig, args), ir.Constant(_LONG, 1), "seq_cst")

    return types.int64(team, types.int64), codegen


@instructions_of(threads.look)
def _look(typingctx: Any, team: Any, place: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load_atomic(_place(context, builder, sig, args), "seq_cst", 8)

    return types.int64(team, types.int64), codegen


@instructions_of(threads.clear)
def _clear(typingctx: Any, team: Any, place: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.store_atomic(ir.Constant(_LONG, 0), _place(context, builder, sig, args), "seq_cst", 8)
        return context.get_dummy_value()

    return types.void(team, types.int64), codegen


@instructions_of(threads.exchange)
def _exchange(typingctx: Any, team: Any, place: Any, expected: Any, value: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        counter = pointer(context, builder, sig.args[0], args[:2])
        return builder.extract_value(builder.cmpxchg(counter, *args[2:], "seq_cst", "seq_cst"), 1)

    return types.boolean(team, types.int64, types.int64, types.int64), codegen


@instructions_of(threads.enter)
def _enter(typingctx: Any, entry: Any, arguments: Any, result: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = ir.FunctionType(_INT, [_LONG, _LONG])  # an address is passed as a number of its size is
        function = builder.inttoptr(args[0], kind.as_pointer())
        return builder.sext(builder.call(function, args[1:]), _LONG)

    return types.int64(types.int64, types.int64, types.int64), codegen


@instructions_of(threads.give_way)
def _give_way(typingctx: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        name = "SwitchToThread" if sys.platform == "win32" else "sched_yield"
        call(builder, name, _INT, [])
        return context.get_dummy_value()

    return types.void(), codegen


@instructions_of(threads.nanoseconds)
def _nanoseconds(typingctx: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if sys.platform == "win32":
            ticks, frequency = (
                _ask_long(builder, name) for name in ("QueryPerformanceCounter", "QueryPerformanceFrequency")
            )
            return builder.mul(ticks, builder.sdiv(ir.Constant(_LONG, 10**9), frequency))
        parts = cgutils.alloca_once(builder, _LONG, size=2)
        call(builder, "clock_gettime", _INT, [ir.Constant(_INT, time.CLOCK_MONOTONIC), parts])
        seconds = builder.load(parts)
        nanoseconds = builder.load(builder.gep(parts, [ir.Constant(_INT, 1)]))
        return builder.add(builder.mul(seconds, ir.Constant(_LONG, 10**9)), nanoseconds)

    return types.int64(), codegen


def _ask_long(builder: Any, name: str) -> Any:
    place = cgutils.alloca_once(builder, _LONG)
    call(builder, name, _INT, [place])
    return builder.load(place)
