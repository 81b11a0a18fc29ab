"""Several threads for the chunks of a file: NumPy and what unpacks let go of the interpreter's lock."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from typing import TypeVar

import numpy as np

from tsplat import locks
from tsplat.processors import available_processors

Item = TypeVar("Item")

THREADS_MAX = 4
"""More would only wait for the memory, and for the one that reads."""


def on_threads(work: Callable[[Item], None], items: Iterable[Item]) -> None:
    """Call ``work`` with every item, on this thread and some more, and return when all is done.

    Parameters
    ----------
    work : callable
        Called on several threads at once, so each item needs a place of its own to write to. NumPy keeps silent
        about what overflows or is nan in it: `tsplat.io.finish.finish` looks for that.
    items : iterable
        Asked for the next item only when a thread has nothing to do, by one thread at a time: it may read a file,
        and at most one item a thread is in memory. A context that it enters, such as that of `numpy.errstate`, it
        leaves before it yields.

    Raises
    ------
    Exception
        Whatever ``work`` or ``items`` raised; the other threads have stopped by then.
    """
    waiting, lock = iter(items), locks.lock()
    end = object()

    def run() -> None:
        nonlocal waiting
        try:
            with np.errstate(all="ignore"):
                while True:
                    with lock:
                        item = next(waiting, end)
                    if item is end:
                        return
                    work(item)  # type: ignore[arg-type]
        except BaseException:
            with lock:
                waiting = iter(())
            raise

    others = min(available_processors(), THREADS_MAX) - 1
    if not others:
        return run()
    with ThreadPoolExecutor(others) as pool:
        running = [pool.submit(copy_context().run, run) for _ in range(others)]
        run()
    for each in running:
        each.result()
    return None
