"""Bytes and bit fields of packed splats to float32: by machine code where it is ready, by NumPy until then.

Nothing here knows a file format. Nobody waits for a compiler to read a file: the first run of the viewer compiles
these kernels beside its frames, or whoever calls `make_ready` does.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from tsplat._jit import JIT
from tsplat.decode import plain

__all__ = ["Decoders", "decoders", "make_ready"]


class Decoders(NamedTuple):
    """The ways in which formats pack numbers; `tsplat.decode.plain` says what they do."""

    look_up: Callable[..., None]
    scale: Callable[..., None]
    between: Callable[..., None]
    smallest_three: Callable[..., None]


def decoders() -> Decoders:
    """Return the quickest decoders that are ready now."""
    from tsplat.decode import kernels

    if JIT and all(kernel.ready(*arguments) for kernel, arguments in kernels.calls()):
        return Decoders(kernels.look_up, kernels.scale, kernels.between, kernels.smallest_three)
    return Decoders(plain.look_up, plain.scale, plain.between, plain.smallest_three)


def make_ready() -> None:
    """Load the kernels, or compile them, which takes two or three seconds."""
    from tsplat.decode import kernels

    for kernel, arguments in kernels.calls():
        kernel(*arguments)
