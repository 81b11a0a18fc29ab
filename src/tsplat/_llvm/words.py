"""Words for kernels: functions that are plain Python for Python, and a few instructions in a kernel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import infer, infer_global, make_intrinsic_template

Definition = TypeVar("Definition", bound=Callable[..., Any])


def instructions_of(word: Callable[..., Any]) -> Callable[[Definition], Definition]:
    """Say what a word is in kernels, by a function such as `numba.extending.intrinsic` takes."""

    def define(definition: Definition) -> Definition:
        template = make_intrinsic_template(word, definition, word.__name__)
        infer(template)
        infer_global(word, types.Function(template))
        return definition

    return define


def call(builder: Any, name: str, result: Any, args: list[Any]) -> Any:
    """Call a function of LLVM's or of the system's."""
    function_type = ir.FunctionType(result, [arg.type for arg in args])
    return builder.call(cgutils.get_or_insert_function(builder.module, function_type, name), args)


def pointer(context: Any, builder: Any, array_type: Any, place: Sequence[Any], kind: Any = None) -> Any:
    """Return where a value lies, given a flat array and an offset, or what of another kind begins there."""
    array, offset = place
    value = builder.gep(context.make_array(array_type)(context, builder, array).data, [offset])
    return builder.bitcast(value, kind.as_pointer()) if kind else value
