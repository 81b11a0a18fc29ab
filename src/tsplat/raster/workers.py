"""Run one kernel on several threads at once.

Kernels release the interpreter lock, share work and wait for each other through `tsplat._threads`, so
plain threads do; Numba's own parallel layer compiles several times longer and aborts when two
threads enter it.
"""

from __future__ import annotations

import atexit
import os
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from tsplat import locks
from tsplat._jit import JIT, Work
from tsplat._machine_code import BEYOND
from tsplat._threads import ABANDONED, ARRIVED, FIRST_FREE
from tsplat.raster.crew import Mate

Result = TypeVar("Result")


def on_threads(
    threads: int,
    team: npt.NDArray[np.int64],
    work: Work[Result],
    *,
    meets: bool = False,
) -> Result:
    """Call ``work(worker)`` for worker 0 to ``threads - 1``, wait for all, return what worker 0 returns.

    ``work`` is a kernel and its job, see `tsplat._jit.Kernel.on`. Workers may wait for each other, so they all run
    at once; ``team`` is what they share. With ``meets`` they have met when worker 0 returns, and the threads of
    the others come home on their own.
    """
    if threads > 1 and JIT:
        return _crew.work(threads, team, work, meets=meets)
    _begin(team)
    if threads == 1:
        return work(0)

    def come(worker: int) -> Result:
        try:
            return work(worker)
        except BaseException:
            team[ABANDONED] = 1
            raise

    with ThreadPoolExecutor(threads) as pool:
        first, *_ = pool.map(come, range(threads))
        return first


def _begin(team: npt.NDArray[np.int64]) -> None:
    # The round counts on: a thread on its way home from the last frame may still be looking at it.
    team[ARRIVED] = team[ABANDONED] = 0
    team[FIRST_FREE:] = 0


class _Crew:
    """The threads beside the calling one: as many as were ever wanted."""

    def __init__(self) -> None:
        self._mates: list[Mate] = []
        self._out: list[Mate] = []
        self._busy = locks.lock()
        self._team: npt.NDArray[np.int64] | None = None

    def work(self, threads: int, team: npt.NDArray[np.int64], work: Work[Result], *, meets: bool) -> Result:
        """Do what `on_threads` says."""
        with self._busy:  # two frames that each held half of the crew would wait for ever
            self._come_home()
            _begin(team)
            self._team = team  # which those who have met may still be looking at
            while len(self._mates) < threads - 1:
                self._mates.append(Mate())
            try:
                for worker in range(1, threads):
                    mate = self._mates[worker - 1]
                    self._out.append(mate)
                    mate.start(work, worker)
                result = work(0)
            except BaseException:
                team[ABANDONED] = 1
                self._come_home()
                raise
            if not meets:
                self._come_home()
            return result

    def dismiss(self) -> None:
        """End all threads."""
        while self._mates:
            self._mates.pop().dismiss()

    def _come_home(self) -> None:
        """Wait until all are done."""
        went_well = True
        while self._out:
            went_well &= self._out[-1].finish()
            self._out.pop()
        if not went_well:
            raise IndexError(BEYOND)


_crew = _Crew()


@atexit.register
def _dismiss() -> None:
    _crew.dismiss()


def _hire() -> None:
    global _crew
    _crew = _Crew()


# A forked child has none of these threads.
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_hire)
