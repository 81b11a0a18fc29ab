"""Functions that kernels are made of, remembered until something is compiled, which most processes never do."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])

JIT = os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0")
"""False under NUMBA_DISABLE_JIT: kernels and their words then run as plain Python, for tests and debuggers."""

PARTS: list[Callable[..., Any]] = []
"""Every part, in the order of their definition."""


def part(function: Function) -> Function:
    """Let kernels call a function, which allocates no arrays; called from Python it is plain Python.

    It becomes machine code only within a kernel. A test that wants it compiled makes it a kernel as well:
    ``kernel(function)``.
    """
    PARTS.append(function)
    return function
