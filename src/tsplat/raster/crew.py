"""Threads that wait for work inside a kernel, so that nothing has to wake them while frame follows frame.

Work is left on a desk: the address of machine code, and packed arguments. Who sits at it watches it for as long
as Python needs between two frames, and then goes to sleep.
"""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import numpy.typing as npt

from tsplat._arguments import WORD
from tsplat._jit import Work, kernel, part
from tsplat._threads import PATIENCE, enter, exchange, give_way, look, nanoseconds
from tsplat.raster.buffers import aligned

STATE, ENTRY, ARGUMENTS, RESULT, RETURNED, FAILED = 0, 8, 9, 10, 11, 12
"""Places on a desk: what goes on, on a cache line of its own; what to call, and with what addresses; what it
returned, which nobody asks for; whether any work failed."""

PLACES, ROOM = 16, 240
"""Of these a desk has so many; behind them is room for so many arguments."""

IDLE, BUSY, ASLEEP, DISMISSED = range(4)
"""The states of a desk."""

WATCH = 1_000_000
"""Nanoseconds that someone watches an empty desk before going to sleep, and that the one who waits for work to be
done watches a busy one before Python may see that Ctrl-C was pressed."""


@kernel
def sit(desk):
    """Do the work that comes until there is none for a while, or never again."""
    while True:
        state = _watch(desk, IDLE)
        if state == BUSY:
            desk[FAILED] |= enter(desk[ENTRY], desk[ARGUMENTS], desk[RESULT])
            exchange(desk, STATE, BUSY, IDLE)
        elif state != IDLE or exchange(desk, STATE, IDLE, ASLEEP):
            return


@kernel
def tell(desk, state):
    """Set the state of a desk at which nobody works; return whether who sits there has to be woken."""
    return not exchange(desk, STATE, IDLE, state) and exchange(desk, STATE, ASLEEP, state)


@kernel
def is_done(desk):
    """Wait for a while; return whether the work on a desk is done."""
    return _watch(desk, BUSY) != BUSY


@part
def _watch(desk, state):
    """Wait for a while for another state than this one; return it."""
    end, looks = nanoseconds() + WATCH, 0
    while look(desk, STATE) == state and nanoseconds() < end:
        looks += 1
        if looks > PATIENCE:
            give_way()
    return look(desk, STATE)


class Mate:
    """A thread with a desk; asleep at first."""

    def __init__(self) -> None:
        self._desk = new_desk()
        self._bell = threading.Event()
        # A daemon, because Python waits for all others before it tells anyone that the process ends.
        self.thread = threading.Thread(target=self._live, name="tsplat", daemon=True)
        self.thread.start()

    def start(self, work: Work[Any], worker: int) -> None:
        """Have work done, as this worker."""
        self._desk[ENTRY] = work.put(self._desk[PLACES:].data.cast("B"), worker)
        self._tell(BUSY)

    def finish(self) -> bool:
        """Wait until the work is done; return whether it went well."""
        while not is_done(self._desk):
            self._bell.set()  # Ctrl-C may have come between telling and waking
        went_well = not self._desk[FAILED]
        self._desk[FAILED] = 0
        return went_well

    def dismiss(self) -> None:
        """End the thread, once its work is done."""
        self.finish()
        self._tell(DISMISSED)
        self.thread.join()

    def _tell(self, state: int) -> None:
        if tell(self._desk, state):
            self._bell.set()

    def _live(self) -> None:
        while self._desk[STATE] != DISMISSED:
            self._bell.wait()
            self._bell.clear()
            sit(self._desk)


def make_ready() -> None:
    """Load or compile what a crew needs."""
    desk = new_desk()
    tell(desk, DISMISSED)
    sit(desk)
    is_done(desk)


def new_desk() -> npt.NDArray[np.int64]:
    """Return a desk without work, where someone sleeps."""
    desk = aligned(PLACES + ROOM, np.int64)
    desk[:PLACES] = 0
    desk[STATE] = ASLEEP
    desk[ARGUMENTS], desk[RESULT] = (desk.ctypes.data + WORD * place for place in (PLACES, RETURNED))
    return desk
