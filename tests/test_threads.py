"""Words for kernels on several threads."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable

import numpy as np
import pytest

from tsplat import _threads
from tsplat._jit import JIT, Work, kernel
from tsplat.raster import crew
from tsplat.raster.workers import on_threads

compiled_only = pytest.mark.skipif(not JIT, reason="needs compiled kernels")

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
def _parts(worker, job):  # type: ignore[no-untyped-def]
    """Write beside each thing that this worker took how many it took with it; count what it takes when all are."""
    team, taken, least = job
    total = taken.shape[1]
    first, behind = _threads.take(team, _threads.FIRST_FREE, total, least, WORKERS)
    while first < total:
        for each in range(first, behind):
            taken[worker, each] += behind - first
        first, behind = _threads.take(team, _threads.FIRST_FREE, total, least, WORKERS)
    return behind - first


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
def _exchange(counters, expected, value):  # type: ignore[no-untyped-def]
    return _threads.exchange(counters, 1, expected, value)


@kernel
def _enter(entry, arguments, result):  # type: ignore[no-untyped-def]
    return _threads.enter(entry, arguments, result)


@kernel
def _add(worker, numbers):  # type: ignore[no-untyped-def]
    return worker + numbers[0]


@kernel
def _time():  # type: ignore[no-untyped-def]
    return _threads.nanoseconds()


@pytest.mark.parametrize(("total", "least"), [(0, 1), (1, 1), (7, 4), (1000, 1), (1000, 300)])
def test_parts_that_are_taken_get_smaller_and_nothing_is_left_or_taken_twice(total: int, least: int) -> None:
    for _ in range(ROUNDS if JIT else 1):  # two that take at the same moment are rare
        team, taken = _threads.new_team(1), np.zeros((WORKERS, total), np.int64)
        assert on_threads(WORKERS, team, _parts.on((team, taken, least))) == 0
        assert ((taken > 0).sum(0) == 1).all()
        sizes = taken.sum(0)
        assert (np.diff(sizes) <= 0).all()
        if total:
            assert sizes[0] == max(total // (_threads.SHARES * WORKERS), min(least, total))
            assert sizes[-1] <= least


def test_every_number_is_taken_by_exactly_one_worker() -> None:
    team, taken = _threads.new_team(1), np.zeros((WORKERS, 1000), np.int64)
    on_threads(WORKERS, team, _numbers.on((team, taken)))
    assert (taken.sum(0) == 1).all()


def test_nobody_leaves_a_meeting_before_all_have_come() -> None:
    team, places = _threads.new_team(0), np.zeros(WORKERS, np.int64)
    assert on_threads(WORKERS, team, _rounds.on((team, places))) == 0


def test_a_worker_that_never_comes_does_not_keep_the_others_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    team = _threads.new_team(0)
    work = _wait.on(team)

    def interrupted(worker: int) -> bool:
        if worker == 0:
            raise KeyboardInterrupt
        return bool(work(worker))

    if JIT:
        monkeypatch.setattr(Work, "__call__", lambda _, worker: interrupted(worker))
    with pytest.raises(KeyboardInterrupt):
        on_threads(WORKERS, team, work if JIT else interrupted)  # type: ignore[arg-type]


@pytest.mark.parametrize("function", [_exchange, _threads.exchange])
@pytest.mark.parametrize(("expected", "after"), [(5, 9), (4, 5)])
def test_a_counter_is_exchanged_only_where_it_is_what_is_expected(
    function: Callable[..., bool], expected: int, after: int
) -> None:
    counters = np.array([5, 5, 5])
    place = () if function is _exchange else (1,)
    assert function(counters, *place, expected, 9) == (after == 9)
    assert counters.tolist() == [5, after, 5]


@compiled_only
@pytest.mark.parametrize("function", [_enter, _threads.enter])
def test_machine_code_is_entered_by_its_address(function: Callable[..., int]) -> None:
    packed, result = np.zeros(2, np.int64), np.zeros(1, np.int64)
    work = _add.on(np.array([30]))
    entry = work.put(packed.data.cast("B"), 7)
    assert function(entry, packed.ctypes.data, result.ctypes.data) == 0
    assert result[0] == 37


@pytest.mark.parametrize("pause", [0.0, 0.0005, 0.001, 0.01])
def test_threads_do_their_work_after_whatever_pause(pause: float) -> None:
    team, taken = _threads.new_team(1), np.zeros((WORKERS, 300), np.int64)
    work = _numbers.on((team, taken))
    for _ in range(30):
        taken[:] = 0
        on_threads(WORKERS, team, work)
        assert (taken.sum(0) == 1).all()
        time.sleep(pause)


@compiled_only
def test_the_threads_of_a_crew_end_when_it_is_dismissed() -> None:
    mates = [crew.Mate() for _ in range(3)]
    team, taken = _threads.new_team(1), np.zeros((1, 100), np.int64)
    mates[1].start(_numbers.on((team, taken)), 0)
    for mate in mates:
        mate.dismiss()
    assert (taken == 1).all()
    assert not any(mate.thread.is_alive() for mate in mates)


@pytest.mark.parametrize("pause", [0.0, 0.1])
def test_threads_without_work_keep_no_process_from_ending(pause: float) -> None:
    code = f"""
import time
import numpy as np
from tests.test_threads import WORKERS, _numbers, _threads, on_threads
team = _threads.new_team(1)
on_threads(WORKERS, team, _numbers.on((team, np.zeros((WORKERS, 50), np.int64))))
time.sleep({pause})
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, b"")


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
