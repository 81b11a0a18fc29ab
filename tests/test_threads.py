"""Words for kernels on several threads."""

from __future__ import annotations

import os
import signal
import time
import warnings

import numpy as np
import pytest

from tsplat import _threads
from tsplat._jit import kernel
from tsplat.raster.workers import on_threads

WORKERS = 3
ROUNDS = 200


@kernel
def _numbers(worker, job):  # type: ignore[no-untyped-def]
    team, taken = job
    while True:
        number = _threads.claim(team, _threads.FIRST_FREE)
        if number >= taken.shape[1]:
            return
        taken[worker, number] = 1


@kernel
def _rounds(worker, job):  # type: ignore[no-untyped-def]
    """In each round write one's own place, meet, and compare with the neighbour's; count disagreements."""
    team, places = job
    apart = 0
    for number in range(ROUNDS):
        places[worker] = number
        if not _threads.meet(team, WORKERS):
            return -1
        apart += places[(worker + 1) % WORKERS] != number
        if not _threads.meet(team, WORKERS):
            return -1
    return apart


@kernel
def _wait(worker, job):  # type: ignore[no-untyped-def]
    return _threads.meet(job, WORKERS)


@kernel
def _time():  # type: ignore[no-untyped-def]
    return _threads.nanoseconds()


def test_every_number_is_taken_by_exactly_one_worker() -> None:
    team, taken = _threads.new_team(1), np.zeros((WORKERS, 1000), np.int64)
    on_threads(WORKERS, team, _numbers.on((team, taken)))
    assert (taken.sum(0) == 1).all()


def test_nobody_leaves_a_meeting_before_all_have_come() -> None:
    team, places = _threads.new_team(0), np.zeros(WORKERS, np.int64)
    assert on_threads(WORKERS, team, _rounds.on((team, places))) == 0


def test_a_worker_that_never_comes_does_not_keep_the_others_waiting() -> None:
    team = _threads.new_team(0)

    def come(worker: int) -> bool:
        if worker == 0:
            raise KeyboardInterrupt
        assert not _wait(worker, team)
        return True

    with pytest.raises(KeyboardInterrupt):
        on_threads(WORKERS, team, come)


def test_kernels_and_python_read_the_same_clock() -> None:
    before = time.monotonic_ns()
    now = _time()
    assert before <= now <= time.monotonic_ns()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="nothing forks on this system")
def test_a_forked_child_draws_with_threads_of_its_own() -> None:
    team, taken = _threads.new_team(1), np.zeros((WORKERS, 50), np.int64)
    on_threads(WORKERS, team, _numbers.on((team, taken)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # forking beside threads is what is tried here
        child = os.fork()
    if child == 0:
        on_threads(WORKERS, team, _numbers.on((team, taken)))
        os._exit(0)
    deadline = time.monotonic() + 20
    while (ended := os.waitpid(child, os.WNOHANG)) == (0, 0) and time.monotonic() < deadline:
        time.sleep(0.01)
    if ended == (0, 0):
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    assert ended == (child, 0)
