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


def lock() -> threading.RLock:
    """Return a lock that is free in a forked child, unless the thread that forked holds it."""
    made = threading.RLock()  # other locks do not know who holds them
    _free_in_children.add(made)
    return made


def let_forks_wait(held: threading.RLock) -> None:
    """Let every fork wait for a lock, from now on.

    Of several, the one that a thread takes first is the last to be given here, as forks begin with the last.
    """
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(before=held.acquire, after_in_parent=held.release, after_in_child=held.release)


def _free() -> None:
    for each in list(_free_in_children):
        if not each._is_owned():
            each._at_fork_reinit()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_free)
