"""A process that is forked while its threads hold locks: the child goes on as if it had been alone."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import tsplat

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="nothing forks on this system")

KINDS = r"(R?Lock|Condition|(Bounded)?Semaphore|Barrier|(Simple|Lifo|Priority)?Queue|allocate_lock)"
LOCK = re.compile(rf"threading\.{KINDS}\b|\b{KINDS}\(|factory={KINDS}")

PACKAGE = Path(tsplat.__file__).parent


def test_every_lock_of_the_package_is_one_that_forks_know() -> None:
    """What `threading` and the like have for locking is used in `locks.py` alone."""
    used = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        for line in path.read_text().splitlines()
        if LOCK.search(line.partition("#")[0])
    }
    assert used == {"locks.py"}


BEGIN = """
import os, signal, sys, threading, time, warnings
import numpy as np
import tsplat
from tsplat import locks
warnings.simplefilter("ignore", DeprecationWarning)  # forking beside threads is what is tried here

def fork_and(work, times=1):
    for _ in range(times):
        child = os.fork()
        if child == 0:
            signal.alarm(30)
            work()
            os._exit(0)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
"""


def run(code: str, **environment: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", BEGIN + code],
        env={**os.environ, **environment},
        capture_output=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr.decode()


def test_a_lock_that_another_thread_holds_is_free_in_the_child_and_stays_held_in_the_parent() -> None:
    run("""
ours, theirs = locks.lock(), locks.lock()
held = threading.Event()
def hold():
    with theirs:
        held.set()
        time.sleep(60)
threading.Thread(target=hold, daemon=True).start()
held.wait()
def work():
    with theirs:
        assert not theirs.acquire(blocking=False) or theirs.release() is None
with ours:
    fork_and(work)
    with ours:
        pass
assert not theirs.acquire(blocking=False)
""")


def test_a_lock_that_the_forking_thread_holds_stays_its_own_in_the_child() -> None:
    run("""
ours = locks.lock()
def work():
    tried = []
    thread = threading.Thread(target=lambda: tried.append(ours.acquire(blocking=False)))
    thread.start()
    thread.join()
    assert tried == [False]
with ours:
    fork_and(work)
fork_and(lambda: ours.acquire())
""")


def test_a_fork_waits_for_what_may_not_be_left_half_done() -> None:
    run("""
outer, inner = locks.lock(), locks.lock()
for each in (inner, outer):
    locks.let_forks_wait(each)
held, done = threading.Event(), []
def hold():
    with outer:
        held.set()
        time.sleep(0.2)
        with inner:
            done.append(True)
threading.Thread(target=hold).start()
held.wait()
def work():
    assert done
    with outer, inner:
        pass
fork_and(work)
with outer, inner:
    pass
""")


SCENE = """
scene = tsplat.load(tsplat.io.demo_path(), max_splats=3_000)
camera = tsplat.Camera.look_at((0, -1, -4), (0, 0, 0), (0, -1, 0), width=64, height=48, fov_y=55.0)
expected = tsplat.render(scene, camera, threads=2).colors.copy()
def right():
    assert np.array_equal(tsplat.render(scene, camera, threads=2).colors, expected)
def beside(work):
    def forever():
        while True:
            work()
    threading.Thread(target=forever, daemon=True).start()
    time.sleep(0.05)
"""


@pytest.mark.usefixtures("compiled")
@pytest.mark.parametrize(
    "work",
    [
        "lambda: tsplat.render(scene, camera)",
        "lambda: [tsplat.render(scene, camera.resized(width, width)) for width in (32, 90)]",
        "lambda: tsplat.render(tsplat.load(tsplat.io.demo_path(), max_splats=3_000), camera)",
        "lambda: tsplat.render(tsplat.load(tsplat.io.demo_path(), max_splats=3_000), camera, lod=500)",
    ],
    ids=["drawing", "drawing other sizes", "preparing", "building levels"],
)
def test_a_child_that_is_forked_meanwhile_draws_the_same_picture(work: str) -> None:
    run(SCENE + f"beside({work})\nfork_and(right, times=4)\nright()\n")


@pytest.mark.skipif("NUMBA_DISABLE_JIT" in os.environ, reason="nothing is compiled")
def test_a_child_that_is_forked_during_the_first_compilation_calls_kernels(tmp_path: Path) -> None:
    run(
        """
from tsplat._jit import kernel, progress
@kernel
def thrice(x):
    return x + x + x
threading.Thread(target=lambda: thrice(1)).start()
while progress() is None:
    time.sleep(0.001)
def work():
    assert thrice(14) == 42
    assert thrice(0.5) == 1.5
fork_and(work, times=3)
""",
        NUMBA_CACHE_DIR=str(tmp_path),
    )
