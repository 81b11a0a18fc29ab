"""How Numba compiles kernels and their parts: as it always does, but without what takes half of the time.

A person waits for it on the first run ever.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from types import FunctionType
from typing import Any

import numba
import numba._dynfunc as dynfunc
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler

ROOM = 1 << 16
"""Pointers in a frame: for it, Python reserves a megabyte, most of it untouched, and half is left for others."""


class KernelCompiler(Compiler):  # type: ignore[misc]
    """Compiles a function that Python calls, and its parts on the way."""

    def compile_extra(self, func: Callable[..., Any]) -> Any:
        """Compile, without looking for garbage over and over: most of what there is is still used."""
        collecting = gc.isenabled()
        gc.disable()
        try:
            return with_room(super().compile_extra)(func)
        finally:
            if collecting:
                gc.enable()


class PartCompiler(Compiler):  # type: ignore[misc]
    """Compiles a function that only kernels call, as far as they need it: into LLVM's language."""

    def __init__(
        self, typing_context: Any, target_context: Any, _: Any, args: Any, result: Any, flags: Any, names: Any
    ) -> None:
        flags.no_compile = True
        library = _PartLibrary(target_context.codegen(), "part")
        super().__init__(typing_context, target_context, library, args, result, flags, names)

    def compile_extra(self, func: Callable[..., Any]) -> Any:
        """Compile, and give what has no address a function that stands for it when Numba looks it up."""
        compiled = super().compile_extra(func)
        sign = dynfunc.make_function(numba, func.__name__, "", 0, compiled.environment, ())
        self.state.targetctx.insert_user_function(sign, compiled.fndesc, [compiled.library])
        return compiled._replace(entry_point=sign)


class _PartLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Code that is optimised, and translated for the processor, as part of a kernel and never by itself."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


def with_room(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that does the same, and quicker where calls are many and deep.

    Python keeps its frames in chunks of 16 kilobytes, and gives a chunk back to the system as soon as its last
    frame ends. A loop that happens to call across the end of a chunk maps memory at every turn. Behind a frame
    larger than that there is one chunk with room for thousands of frames.
    """

    def roomy(*args: Any) -> Any:
        return function(*args)

    code = roomy.__code__.replace(co_stacksize=ROOM)
    return FunctionType(code, roomy.__globals__, closure=roomy.__closure__)
