"""Words for kernels that several threads run at once: share work, wait for each other, read the clock.

All state is one int64 array, `new_team`, a cache line for each counter. Waiting means watching a counter,
which is quicker than sleeping by more than a whole stage of a small frame; a thread that has watched
for long lets others use its processor.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import numpy.typing as npt

from tsplat import locks
from tsplat._arguments import ENTRY_TYPE
from tsplat._parts import part

ARRIVED, ROUND, ABANDONED, FIRST_FREE = 0, 8, 16, 24
"""Places in a team's array; a kernel may use FIRST_FREE and every eighth after it for counters of its own."""

SHARES = 4
"""What is left is taken in so many parts by each worker: what lies together stays together, and as the parts get
smaller, nobody waits long for whoever took the hardest."""

PATIENCE = 4096
"""Looks at a counter before others may use the processor: some ten microseconds."""


def new_team(counters: int) -> npt.NDArray[np.int64]:
    """Return the shared state of a team of threads with counters of its own, all zero."""
    return np.zeros(FIRST_FREE + 8 * counters, np.int64)


_lock = locks.lock()


def claim(team: Any, place: int) -> int:
    """Take the next number of a counter; no two threads get the same."""
    with _lock:
        team[place] += 1
        return int(team[place]) - 1


def look(team: Any, place: int) -> int:
    """Read a counter that another thread may be changing."""
    return int(team[place])


def clear(team: Any, place: int) -> None:
    """Set a counter to 0."""
    team[place] = 0


def exchange(team: Any, place: int, expected: int, value: int) -> bool:
    """Set a counter that is what is expected to a value, in one step; return False where it is not."""
    with _lock:
        found = int(team[place]) == expected
        if found:
            team[place] = value
        return found


def enter(entry: int, arguments: int, result: int) -> int:
    """Call machine code by its address, with those of its packed arguments and of a place for what it returns.

    Return 0 unless it failed; see `tsplat._machine_code`.
    """
    return int(ENTRY_TYPE(entry)(arguments, result))


def give_way() -> None:
    """Let other threads use the processor."""
    time.sleep(0)


def nanoseconds() -> int:
    """Read a clock that never goes back."""
    return time.monotonic_ns()


@part
def meet(team, workers):  # type: ignore[no-untyped-def]
    """Wait until all workers are here; return False when the team was abandoned and none will come."""
    before = look(team, ROUND)
    if claim(team, ARRIVED) == workers - 1:
        clear(team, ARRIVED)
        claim(team, ROUND)
        return True
    looks = 0
    while look(team, ROUND) == before:
        if look(team, ABANDONED) != 0:
            return False
        looks += 1
        if looks > PATIENCE:
            give_way()
    return True


@part
def take(team, place, total, least, workers):  # type: ignore[no-untyped-def]
    """Take some of ``total`` things that nobody has taken: return the first, and the one after the last.

    They are a share of those that are left, at least ``least``; none where all are taken. A counter that several
    threads change is dear: so is waiting, each time, until all that was stored so far is on its way.
    """
    first = look(team, place)
    while first < total:
        behind = min(first + max((total - first) // (SHARES * workers), least), total)
        if exchange(team, place, first, behind):
            return first, behind
        first = look(team, place)
    return total, total
