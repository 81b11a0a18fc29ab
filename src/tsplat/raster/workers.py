"""Run one kernel on several threads at once.

Kernels release the interpreter lock, share work and wait for each other through `tsplat._threads`, so
plain threads do; Numba's own parallel layer compiles several times longer and aborts when two
threads enter it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from tsplat._threads import ABANDONED

Job = TypeVar("Job")
Result = TypeVar("Result")


def on_threads(
    threads: int, team: npt.NDArray[np.int64], function: Callable[[int, Job], Result], job: Job
) -> Result:
    """Call ``function(worker, job)`` for worker 0 to ``threads - 1``, wait for all, return what worker 0 returns.

    Workers may wait for each other, so they all run at once; ``team`` is what they share, cleared before.
    """
    pool, busy = _pool(threads)
    with busy:  # two frames that each held half of the pool would wait for ever
        team[:] = 0
        others = [pool.submit(function, worker, job) for worker in range(1, threads)]
        try:
            return function(0, job)
        except BaseException:
            team[ABANDONED] = 1
            raise
        finally:
            for other in others:
                other.result()


@lru_cache(maxsize=4)
def _pool(threads: int) -> tuple[ThreadPoolExecutor, threading.Lock]:
    return ThreadPoolExecutor(max_workers=max(1, threads - 1), thread_name_prefix="tsplat"), threading.Lock()
