"""The only use of njit, so that options and the place of the disk cache never drift.

Numba notices an edit only in the file of the kernel itself, not in the helpers it calls. Here the
cache folder is named after everything that can change the machine code, so it is never stale,
and it lies in the user's cache, so a read-only installation compiles once as well.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numba
import platformdirs
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

Function = TypeVar("Function", bound=Callable[..., Any])

_config: Any = numba.config

JIT = not _config.DISABLE_JIT
"""False under NUMBA_DISABLE_JIT: kernels and lanes then run as plain Python, for tests and debuggers."""

FASTMATH = {"contract", "arcp", "nsz"}
"""Fused multiply-add and reciprocals; nan and infinity keep their meaning, and sums their order:
``reassoc`` would simplify the rounding trick of `_lanes.exp2` away."""


def kernel(function: Function) -> Function:
    """Compile a function on its first call; it must neither raise nor touch Python objects.

    It releases the interpreter lock, divides by zero as IEEE does, and is cached on disk.
    """
    folder = _cache_folder()
    with _numba_cache_dir(folder):
        compiled: Function = numba.njit(
            function, cache=folder is not None, nogil=True, error_model="numpy", fastmath=FASTMATH
        )
    return compiled


@lru_cache(maxsize=1)
def _cache_folder() -> Path | None:
    """Return the folder for machine code, or None where no such folder can be written."""
    chosen = os.environ.get("NUMBA_CACHE_DIR") or platformdirs.user_cache_dir("tsplat")
    folder = Path(chosen) / f"kernels-{_source_digest()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


def _source_digest() -> str:
    """Return a name for all that decides the machine code besides the processor, which Numba checks."""
    digest = hashlib.sha256(f"{numba.__version__} {_config.BOUNDSCHECK}".encode())
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        source = path.read_bytes()
        if b"tsplat._jit" in source or b"tsplat._lanes" in source:
            digest.update(source)
    digest.update(Path(__file__).read_bytes())
    return digest.hexdigest()[:16]


@contextmanager
def _numba_cache_dir(folder: Path | None) -> Iterator[None]:
    # Numba asks for its cache folder once, when the decorator runs; other users of Numba keep theirs.
    before = _config.CACHE_DIR
    _config.CACHE_DIR = str(folder or "")
    try:
        yield
    finally:
        _config.CACHE_DIR = before


def device(function: Callable[..., Any]) -> Any:
    """Make a word for kernels out of LLVM instructions; see `numba.extending.intrinsic`."""
    return intrinsic(function)


@device
def _atomic_claim(typingctx: Any, counter: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer = context.make_array(signature.args[0])(context, builder, args[0]).data
        return builder.atomic_rmw("add", pointer, ir.Constant(ir.IntType(64), 1), "monotonic")

    return types.int64(counter), codegen


def _plain_claim(counter: Any) -> int:
    counter[0] += 1
    return int(counter[0]) - 1


claim: Any = _atomic_claim if JIT else _plain_claim
"""``claim(counter)`` takes the next number of a shared int64 [1] array; no two threads get the same."""
