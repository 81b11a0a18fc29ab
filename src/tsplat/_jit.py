"""The only use of njit, so that options never drift; it also counts what is compiled, for those who wait."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numba
from numba.core import event
from numba.extending import intrinsic, register_jitable

from tsplat._compiler import KernelCompiler, PartCompiler
from tsplat._kernel_cache import keep_compiled

Function = TypeVar("Function", bound=Callable[..., Any])

_config: Any = numba.config

JIT = not _config.DISABLE_JIT
"""False under NUMBA_DISABLE_JIT: kernels and lanes then run as plain Python, for tests and debuggers."""

FASTMATH = {"contract", "arcp", "nsz"}
"""Fused multiply-add and reciprocals; nan and infinity keep their meaning, and sums their order:
``reassoc`` would simplify the rounding trick of `_lanes.exp2` away."""

OPTIONS: dict[str, Any] = {
    "nogil": True, "error_model": "numpy", "fastmath": FASTMATH, "no_cfunc_wrapper": True
}  # fmt: skip


class Progress(NamedTuple):
    """How far compiling is: functions compiled, functions known, and seconds since it began."""

    done: int
    total: int
    seconds: float


class _Watch(event.Listener):  # type: ignore[misc]
    """Hears when Numba starts and ends to compile a function; loading one makes no sound."""

    def __init__(self) -> None:
        self.known: set[Any] = set()
        self.done: set[Any] = set()
        self.start: float | None = None

    def on_start(self, event: Any) -> None:
        if self.start is None and event.data["dispatcher"].py_func in self.known:
            self.start = time.perf_counter()

    def on_end(self, event: Any) -> None:
        self.done.add(event.data["dispatcher"].py_func)


_watch = _Watch()
event.register("numba:compile", _watch)


def progress() -> Progress | None:
    """Return how far compiling is, or None where this process has compiled nothing, as most processes do."""
    if _watch.start is None:
        return None
    known = _watch.known.copy()  # another thread may be importing kernels
    return Progress(len(known & _watch.done), len(known), time.perf_counter() - _watch.start)


def kernel(function: Function) -> Function:
    """Compile a function on its first call; it must neither raise nor touch Python objects.

    It releases the interpreter lock, divides by zero as IEEE does, and is cached on disk.
    """
    compiled: Function = numba.njit(function, **OPTIONS, pipeline_class=KernelCompiler)
    if JIT:
        _watch.known.add(function)
        keep_compiled(compiled, function)
    return compiled


def part(function: Function) -> Function:
    """Let kernels call a function, which allocates no arrays; called from Python it is plain Python.

    It has less to compile than a `kernel`: nothing that takes Python's objects apart or counts references, and
    it becomes machine code only within a kernel. A test that wants it compiled makes it a kernel as well:
    ``kernel(function)``.
    """
    if JIT:
        _watch.known.add(function)
    registered: Function = register_jitable(**OPTIONS, _nrt=False, pipeline_class=PartCompiler)(function)
    return registered


def device(function: Callable[..., Any]) -> Any:
    """Make a word for kernels out of LLVM instructions; see `numba.extending.intrinsic`."""
    return intrinsic(function)
