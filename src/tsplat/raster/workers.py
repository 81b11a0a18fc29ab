"""Run one kernel on several threads at once.

Kernels release the interpreter lock and share the work among themselves through `_jit.claim`, so
plain threads do; Numba's own parallel layer compiles several times longer and aborts when two
threads enter it.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any


def on_threads(threads: int, function: Callable[..., None], *args: Any) -> None:
    """Call ``function(worker, *args)`` for worker 0 to ``threads - 1`` and wait for all."""
    others = [_pool(threads).submit(function, worker, *args) for worker in range(1, threads)]
    try:
        function(0, *args)
    finally:
        for other in others:
            other.result()


@lru_cache(maxsize=4)
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=threads, thread_name_prefix="tsplat")
