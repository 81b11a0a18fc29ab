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
from numba.core import event
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, Flags
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target
from numba.extending import register_jitable

from tsplat._llvm import entry
from tsplat._machine_code import MachineCode
from tsplat._parts import PARTS

FASTMATH = {"contract", "arcp", "nsz"}
"""Fused multiply-add and reciprocals; nan and infinity keep their meaning, and sums their order:
``reassoc`` would simplify the rounding trick of `_lanes.exp2` away."""

OPTIONS: dict[str, Any] = {
    "error_model": "numpy", "fastmath": FASTMATH, "_nrt": False,
    "no_cfunc_wrapper": True, "no_cpython_wrapper": True,
}  # fmt: skip
"""No Python objects and nothing that counts references, so machine code needs nothing of Numba's to run."""

ROOM = 1 << 16
"""Pointers in a frame: for it, Python reserves a megabyte, most of it untouched, and half is left for others."""


def compile_kernel(
    function: Callable[..., Any], arguments: tuple[Any, ...], heard: Callable[[Callable[..., Any]], None]
) -> MachineCode:
    """Compile a function for the types of such arguments.

    Parameters
    ----------
    function : callable
        As `tsplat._jit.Kernel` takes it.
    arguments : tuple
        As it will be called with.
    heard : callable
        Called with every part when it is compiled.

    Raises
    ------
    numba.core.errors.NumbaError
        It is not what a kernel can be.
    """
    listener = _Listener(heard)
    event.register("numba:compile", listener)
    collecting = gc.isenabled()
    gc.disable()  # most of what there is is still used
    try:
        code: MachineCode = with_room(_compiled)(function, arguments)
        return code
    finally:
        if collecting:
            gc.enable()
        event.unregister("numba:compile", listener)


@global_compiler_lock  # type: ignore[untyped-decorator]
def _compiled(function: Callable[..., Any], arguments: tuple[Any, ...]) -> MachineCode:
    _register_parts()
    context = cpu_target.target_context
    flags = Flags()
    cpu_target.options.parse_as_flags(flags, OPTIONS | {"nopython": True})
    types = tuple(entry.type_of(each) for each in arguments)
    pipeline = PartCompiler(cpu_target.typing_context, context, None, types, None, flags, {})
    compiled = pipeline.compile_extra(function)
    library = _KernelLibrary(context.codegen(), function.__name__)
    library.add_linking_library(compiled.library)
    module, context = library.create_ir_module("entry"), pipeline.state.targetctx
    with context.push_code_library(library):
        result = entry.define(context, module, compiled)
    library.add_ir_module(module)
    library.finalize()
    return MachineCode(result, library.object_file)


_registered = 0


def _register_parts() -> None:
    """Tell Numba of the parts that were defined since the last time."""
    global _registered
    for function in PARTS[_registered:]:
        register_jitable(**OPTIONS, pipeline_class=PartCompiler)(function)
        _registered += 1


class _Listener(event.Listener):  # type: ignore[misc]
    """Hears when Numba has compiled a part."""

    def __init__(self, heard: Callable[[Callable[..., Any]], None]) -> None:
        self.heard = heard

    def on_start(self, event: Any) -> None:
        pass

    def on_end(self, event: Any) -> None:
        self.heard(event.data["dispatcher"].py_func)


class PartCompiler(Compiler):  # type: ignore[misc]
    """Compiles a function as far as a kernel needs it: into LLVM's language."""

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


class _KernelLibrary(JITCodeLibrary):  # type: ignore[misc]
    """A kernel with all its parts, which becomes an object file instead of being linked here."""

    object_file: bytes

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        assert not self._dynamic_globals, f"{self.name}: holds addresses of this process"
        self._verify_declare_only_symbols()
        called = [function.name for function in self._final_module.functions if function.is_declaration]
        if missing := [name for name in called if name.startswith(("numba", "NRT"))]:
            raise TypeError(f"kernel {self.name} needs {', '.join(missing)}, which only Numba has")
        self.object_file = self._codegen._tm.emit_object(self._final_module)
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
