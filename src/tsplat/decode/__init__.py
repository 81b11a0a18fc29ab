"""Bytes and bit fields of packed splats to float32: by machine code where it is ready, by NumPy until then.

Nothing here knows a file format.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import NamedTuple

from tsplat.decode import plain
from tsplat.decode.plain import read_only

__all__ = ["KERNELS", "Decoders", "decoders", "decoders_ready", "make_ready", "read_only"]

KERNELS = "TSPLAT_DECODE_KERNELS"
"""Set to 1, this variable of the environment has kernels decode, compiled now where they are not ready."""


class Decoders(NamedTuple):
    """The ways in which formats pack numbers; `tsplat.decode.plain` says what they do."""

    look_up: Callable[..., None]
    scale: Callable[..., None]
    between: Callable[..., None]
    smallest_three: Callable[..., None]


def decoders() -> Decoders:
    """Return the quickest decoders that are ready now."""
    if not decoders_ready():
        return Decoders(plain.look_up, plain.scale, plain.between, plain.smallest_three)
    from tsplat.decode import kernels

    return Decoders(kernels.look_up, kernels.scale, kernels.between, kernels.smallest_three)


def decoders_ready() -> bool:
    """Tell whether kernels can be called without being compiled first."""
    return os.environ.get(KERNELS) == "1"


def make_ready() -> None:
    """Load the kernels, or compile them."""
    from tsplat.decode import kernels

    for kernel, arguments in kernels.calls():
        kernel(*arguments)
