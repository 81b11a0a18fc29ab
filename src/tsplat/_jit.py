"""Kernels: functions that become machine code when they are first called, unless an earlier process left it."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import lru_cache
from struct import Struct
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, ParamSpec, TypeVar

from tsplat import locks
from tsplat._arguments import Known, Types, described, flat, flat_job, packing
from tsplat._parts import JIT, PARTS, part

if TYPE_CHECKING:
    from tsplat._machine_code import Linked

__all__ = ["JIT", "Kernel", "Progress", "Work", "kernel", "part", "progress"]

P = ParamSpec("P")
Result = TypeVar("Result")

_compiling = locks.lock()


class Progress(NamedTuple):
    """How far compiling is: functions compiled, functions known, and seconds since it began."""

    done: int
    total: int
    seconds: float


class _Watch:
    """Counts what is compiled, for those who wait; loading makes no sound."""

    def __init__(self) -> None:
        self.kernels: list[Any] = []
        self.done: set[Any] = set()
        self.start: float | None = None

    def begin(self) -> None:
        """Look at the clock, at the first function that is compiled."""
        self.start = self.start or time.perf_counter()


_watch = _Watch()


def progress() -> Progress | None:
    """Return how far compiling is, or None where this process has compiled nothing, as most processes do."""
    if _watch.start is None:
        return None
    known = {*_watch.kernels, *PARTS}
    return Progress(len(known & _watch.done), len(known), time.perf_counter() - _watch.start)


class _Code(NamedTuple):
    """A kernel for arguments of some types: what packs their values, and the machine code that takes them."""

    packing: Struct
    linked: Linked

    def __call__(self, values: list[Any]) -> Any:
        return self.linked.run(self.packing.pack(*values))


class Work(Generic[Result]):
    """A kernel and a job, which was looked at once for all workers; a function of the worker's number."""

    def __init__(self, code: _Code, job: Any, values: list[Any]) -> None:
        self._code, self._values = code, values
        self._job = job  # values are addresses of what it holds

    def __call__(self, worker: int) -> Result:
        result: Result = self._code([worker, *self._values])
        return result

    def put(self, place: memoryview, worker: int) -> int:
        """Leave a worker's packed arguments in a place; return the address of the entry that takes them."""
        self._code.packing.pack_into(place, 0, worker, *self._values)
        return self._code.linked.entry


class Kernel(Generic[P, Result]):
    """A function as machine code, made for the types of its arguments when it is first called with them.

    Parameters
    ----------
    function : callable
        It must neither raise, nor allocate arrays, nor touch Python's objects, and it returns a number, or
        nothing. It releases the interpreter lock and divides by zero as IEEE does.
    """

    def __init__(self, function: Callable[P, Result]) -> None:
        self.function = function
        self.codes: dict[Types, _Code] = {}
        self.__name__, self.__doc__ = function.__name__, function.__doc__
        _watch.kernels.append(function)

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> Result:
        """Run it; arguments are given by their places."""
        if not JIT:
            return self.function(*args, **kwargs)
        assert not kwargs
        types, values = flat(args)
        result: Result = self._code(types, args)(values)
        return result

    def on(self, job: Any, known: Known | None = None) -> Work[Result]:
        """Return ``function(worker, job)`` as a function of the worker; the job is looked at only once.

        What is ``known`` of its last fields is not even looked at.
        """
        if not JIT:
            return lambda worker: self.function(worker, job)  # type: ignore[call-arg, return-value]
        types, (_, *values) = flat_job(job, known) if known else flat((0, job))
        return Work(self._code(types, (0, job)), job, values)

    def ready(self, *args: Any) -> bool:
        """Tell whether a call with such arguments would compile nothing."""
        return not JIT or self._find(flat(args).types) is not None

    def _code(self, types: Types, args: tuple[Any, ...]) -> _Code:
        found = self._find(types)
        if found is None:
            with _compiling:
                found = self._find(types) or self._compiled(types, args)
        return found

    def _find(self, types: Types) -> _Code | None:
        """Return the machine code for these types where it is loaded or kept."""
        found = self.codes.get(types)
        if found is None:
            from tsplat._kernel_cache import kept, place  # brings in LLVM

            code = kept(place(self.function, described(types)))
            if code is not None:
                found = self._remember(types, code)
        return found

    def _compiled(self, types: Types, args: tuple[Any, ...]) -> _Code:
        _let_forks_wait()
        from tsplat._compiler import compile_kernel  # brings in Numba
        from tsplat._kernel_cache import keep, place

        _watch.begin()
        code = compile_kernel(self.function, args, _watch.done.add)
        _watch.done.add(self.function)
        keep(place(self.function, described(types)), code)
        return self._remember(types, code)

    def _remember(self, types: Types, code: Any) -> _Code:
        from tsplat._machine_code import linked

        found = self.codes[types] = _Code(packing(types), linked(code))
        return found


@lru_cache(maxsize=1)
def _let_forks_wait() -> None:
    import logging  # noqa: F401  # which has forks wait as well, and Numba logs: it has to come before

    locks.let_forks_wait(_compiling)


def kernel(function: Callable[P, Result]) -> Kernel[P, Result]:
    """Make a kernel of a function, see `Kernel`."""
    return Kernel(function)
