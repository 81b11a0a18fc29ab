"""Locks of threads, for a process that may be forked while another of its threads holds one.

In the child that thread is gone, and would never let go. What a lock guards is either made in one step: then it is
free in the child. Or it may be half done, as in LLVM: then a fork waits until nobody is at it.
"""

from __future__ import annotations

import os
import threading
from typing import Any
from weakref import WeakSet

_free_in_children: WeakSet[Any] = WeakSet()

_unforked: list[threading.RLock] = []
"""In the order in which a thread takes them that takes several, which is the order in which they are made."""


def lock() -> threading.RLock:
    """Return a lock that is free in a forked child, unless the thread that forked holds it."""
    made = threading.RLock()  # other locks do not know who holds them
    _free_in_children.add(made)
    return made


def unforked_lock() -> threading.RLock:
    """Return a lock for which a fork waits, for as long as the process lives; a thread may take it again."""
    made = threading.RLock()
    _unforked.append(made)
    return made


def _before_fork() -> None:
    for each in _unforked:
        each.acquire()


def _after_fork() -> None:
    for each in reversed(_unforked):
        each.release()


def _free() -> None:
    for each in list(_free_in_children):
        if not each._is_owned():
            each._at_fork_reinit()
    _after_fork()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before_fork, after_in_parent=_after_fork, after_in_child=_free)
