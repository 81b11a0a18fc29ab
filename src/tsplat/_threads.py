"""Words for kernels that several threads run at once: share work, wait for each other, read the clock.

All state is one int64 array, `new_team`, a cache line for each counter. Waiting means watching a counter,
which is quicker than sleeping by more than a whole stage of a small frame; a thread that has watched
for long lets others use its processor.
"""

from __future__ import annotations

import sys
import threading
import time
from typing import Any

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba.core import cgutils, types

from tsplat._jit import JIT, device, part

ARRIVED, ROUND, ABANDONED, FIRST_FREE = 0, 8, 16, 24
"""Places in a team's array; a kernel may use FIRST_FREE and every eighth after it for counters of its own."""

PATIENCE = 4096
"""Looks at a counter before others may use the processor: some ten microseconds."""

_INT, _LONG = ir.IntType(32), ir.IntType(64)


def new_team(counters: int) -> npt.NDArray[np.int64]:
    """Return the shared state of a team of threads with counters of its own, all zero."""
    return np.zeros(FIRST_FREE + 8 * counters, np.int64)


def _place(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return builder.gep(context.make_array(sig.args[0])(context, builder, args[0]).data, [args[1]])


@device
def _claim(typingctx: Any, team: Any, place: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.atomic_rmw("add", _place(context, builder, sig, args), ir.Constant(_LONG, 1), "seq_cst")

    return types.int64(team, types.int64), codegen


@device
def _look(typingctx: Any, team: Any, place: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load_atomic(_place(context, builder, sig, args), "seq_cst", 8)

    return types.int64(team, types.int64), codegen


@device
def _clear(typingctx: Any, team: Any, place: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.store_atomic(ir.Constant(_LONG, 0), _place(context, builder, sig, args), "seq_cst", 8)
        return context.get_dummy_value()

    return types.void(team, types.int64), codegen


@device
def _give_way(typingctx: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        name = "SwitchToThread" if sys.platform == "win32" else "sched_yield"
        builder.call(cgutils.get_or_insert_function(builder.module, ir.FunctionType(_INT, []), name), [])
        return context.get_dummy_value()

    return types.void(), codegen


_plain_lock = threading.Lock()


def _plain_claim(team: Any, place: int) -> int:
    with _plain_lock:
        team[place] += 1
        return int(team[place]) - 1


def _plain_clear(team: Any, place: int) -> None:
    team[place] = 0


claim: Any = _claim if JIT else _plain_claim
"""``claim(team, place)`` takes the next number of a counter; no two threads get the same."""

look: Any = _look if JIT else lambda team, place: int(team[place])
"""``look(team, place)`` reads a counter that another thread may be changing."""

clear: Any = _clear if JIT else _plain_clear
give_way: Any = _give_way if JIT else lambda: time.sleep(0)


@part
def meet(team, workers):  # type: ignore[no-untyped-def]
    """Wait until all workers are here; return False when the team was abandoned and none will come."""
    before = look(team, ROUND)
    if claim(team, ARRIVED) == workers - 1:
        clear(team, ARRIVED)
        claim(team, ROUND)
        return True
    looks = 0
    while look(team, ROUND) == before:
        if look(team, ABANDONED) != 0:
            return False
        looks += 1
        if looks > PATIENCE:
            give_way()
    return True


@device
def _nanoseconds(typingctx: Any) -> Any:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        if sys.platform == "win32":
            ticks, frequency = (
                _ask_long(builder, name) for name in ("QueryPerformanceCounter", "QueryPerformanceFrequency")
            )
            return builder.mul(ticks, builder.sdiv(ir.Constant(_LONG, 10**9), frequency))
        parts = cgutils.alloca_once(builder, _LONG, size=2)
        signature = ir.FunctionType(_INT, [_INT, parts.type])
        clock = cgutils.get_or_insert_function(builder.module, signature, "clock_gettime")
        builder.call(clock, [ir.Constant(_INT, time.CLOCK_MONOTONIC), parts])
        seconds = builder.load(parts)
        nanoseconds = builder.load(builder.gep(parts, [ir.Constant(_INT, 1)]))
        return builder.add(builder.mul(seconds, ir.Constant(_LONG, 10**9)), nanoseconds)

    return types.int64(), codegen


def _ask_long(builder: Any, name: str) -> Any:
    place = cgutils.alloca_once(builder, _LONG)
    signature = ir.FunctionType(_INT, [place.type])
    builder.call(cgutils.get_or_insert_function(builder.module, signature, name), [place])
    return builder.load(place)


nanoseconds: Any = _nanoseconds if JIT else time.monotonic_ns
"""``nanoseconds()`` reads a clock that never goes back."""
