"""How many processors this process may use."""

from __future__ import annotations

import os

FEW = 8
"""Threads that are started where that many are asked for, even on fewer processors."""


def available_processors() -> int:
    """Return how many processors this process may run on, at least 1."""
    if hasattr(os, "sched_getaffinity"):
        return max(1, len(os.sched_getaffinity(0)))
    return os.cpu_count() or 1


def worker_count(threads: int) -> int:
    """Return how many threads work where so many are asked for; 0 means one for each processor.

    More than there are processors only wait for each other, at every step of a frame.
    """
    processors = available_processors()
    return min(threads or processors, max(processors, FEW))
