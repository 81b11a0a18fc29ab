"""Run one kernel on several threads at once.

Kernels release the interpreter lock, share work and wait for each other through `tsplat._threads`, so
plain threads do; Numba's own parallel layer compiles several times longer and aborts when two
threads enter it.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from tsplat._threads import ABANDONED, ARRIVED, FIRST_FREE

Result = TypeVar("Result")


def on_threads(
    threads: int,
    team: npt.NDArray[np.int64],
    work: Callable[[int], Result],
    *,
    meets: bool = False,
) -> Result:
    """Call ``work(worker)`` for worker 0 to ``threads - 1``, wait for all, return what worker 0 returns.

    ``work`` is a kernel and its job, see `tsplat._jit.Kernel.on`. Workers may wait for each other, so they all run
    at once; ``team`` is what they share. With ``meets`` they have met when worker 0 returns, and the threads of
    the others come home on their own, which saves their waking this one.
    """
    crew = _crew(threads)
    with crew.busy:  # two frames that each held half of the crew would wait for ever
        crew.come_home()
        # The round counts on: a thread on its way home from the last frame may still be looking at it.
        team[ARRIVED] = team[ABANDONED] = 0
        team[FIRST_FREE:] = 0
        try:
            for worker in range(1, threads):
                crew.out.append(crew.pool.submit(work, worker))
            result = work(0)
        except BaseException:
            team[ABANDONED] = 1
            crew.come_home()
            raise
        if not meets:
            crew.come_home()
        return result


class _Crew:
    """The threads beside the calling one, and what they are doing."""

    def __init__(self, threads: int) -> None:
        self.pool = ThreadPoolExecutor(max_workers=max(1, threads - 1), thread_name_prefix="tsplat")
        self.busy = threading.Lock()
        self.out: list[Future[Any]] = []

    def come_home(self) -> None:
        """Wait until all are idle; raise what one of them raised."""
        out, self.out = self.out, []
        for other in out:
            other.result()


_crew = lru_cache(maxsize=4)(_Crew)

# A forked child has none of these threads.
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_crew.cache_clear)
