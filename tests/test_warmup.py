"""Kernels made ready beside the loading, and what is said meanwhile."""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path

import pytest

from tsplat import _kernel_cache, progress, warmup, warmup_process
from tsplat._jit import JIT, Progress
from tsplat.raster.draw import draw
from tsplat.warmup import WarmUp

DEADLINE = 60.0


class Compiling(WarmUp):
    """Says that it compiles, until it was asked a few times."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, seconds: float) -> None:
        super().__init__(lambda: None)
        self.asked = 0
        monkeypatch.setattr(warmup, "progress", lambda: Progress(4, 9, seconds))

    def start(self) -> WarmUp:
        return self

    def done(self, timeout: float) -> bool:  # noqa: ARG002
        self.asked += 1
        return self.asked > 3


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def said(monkeypatch: pytest.MonkeyPatch, stderr: io.StringIO, seconds: float) -> str:
    """Return what is said while kernels compile for this long."""
    monkeypatch.setattr(sys, "stderr", stderr)
    progress.wait_for_kernels(Compiling(monkeypatch, seconds))
    return stderr.getvalue()


def test_a_terminal_is_told_how_far_it_is_and_the_line_goes_away(monkeypatch: pytest.MonkeyPatch) -> None:
    line = "\r\x1b[Kcompiling kernels, first run only: 4 of 9, 2 s"
    assert said(monkeypatch, Terminal(), 2.2) == 3 * line + "\r\x1b[K"


def test_a_log_gets_one_plain_line(monkeypatch: pytest.MonkeyPatch) -> None:
    assert said(monkeypatch, io.StringIO(), 2.2) == "tsplat: compiling kernels, first run only\n"


def test_a_quick_compilation_is_not_mentioned(monkeypatch: pytest.MonkeyPatch) -> None:
    assert said(monkeypatch, Terminal(), 0.5) == said(monkeypatch, io.StringIO(), 0.5) == ""


def test_the_line_goes_away_when_the_person_gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    class GivenUp(Compiling):
        def done(self, timeout: float) -> bool:
            if super().done(timeout) or self.asked > 2:
                raise KeyboardInterrupt
            return False

    stderr = Terminal()
    monkeypatch.setattr(sys, "stderr", stderr)
    with pytest.raises(KeyboardInterrupt):
        progress.wait_for_kernels(GivenUp(monkeypatch, 3.0))
    assert stderr.getvalue().endswith("3 s\r\x1b[K")


def test_the_job_runs_once_on_a_thread_that_no_one_has_to_wait_for() -> None:
    go, ran = threading.Event(), []

    def job() -> None:
        assert go.wait(DEADLINE)
        ran.append(threading.current_thread())

    warm_up = WarmUp(job).start().start()
    assert not warm_up.done(0.0)
    go.set()
    assert warm_up.done(DEADLINE)
    (thread,) = ran
    assert thread is not threading.current_thread()
    assert thread.daemon


@pytest.mark.parametrize(("after", "started"), [(0.0, True), (1e9, False)])
def test_only_a_long_loading_starts_the_kernels(
    monkeypatch: pytest.MonkeyPatch, after: float, started: bool
) -> None:
    monkeypatch.setattr(progress, "WARM_UP_AFTER", after)
    ran = threading.Event()
    warm_up = WarmUp(ran.set)
    with progress.loading("x.ply", warm_up) as show:
        show(0.5)
        show(1.0)
    assert (warm_up._thread.ident is not None) == started
    assert warm_up.start().done(DEADLINE)
    assert ran.is_set()


@pytest.mark.skipif(not JIT, reason="nothing is compiled or loaded")
def test_after_the_tiny_picture_a_real_one_needs_no_other_kernel() -> None:
    code = """
from tsplat import _kernel_cache, warmup
warmup.draw_tiny()
asked = []
place = _kernel_cache.place
_kernel_cache.place = lambda function, types: asked.append(function) or place(function, types)
import numpy as np, tsplat
from tests.scenes import random_gaussians
camera = tsplat.Camera.look_at((0, 0, -3), (0, 0, 0), (0, -1, 0), width=200, height=150, fov_y=55.0)
for degree in range(4):
    scene = random_gaussians(np.random.default_rng(0), 5000, sh_degree=degree)
    for antialias in ("classic", "relative"):
        tsplat.render(scene, camera, depths=False, antialias=antialias, sh_degree=min(degree, 2))
print(asked)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=120, check=False)
    assert done.stdout == b"[]\n", done.stderr.decode()


@pytest.mark.skipif(not JIT, reason="nothing is compiled or loaded")
@pytest.mark.usefixtures("compiled")
def test_beside_draw_nothing_is_left_to_compile_after_the_second_process(tmp_path: Path) -> None:
    other = dict(os.environ, NUMBA_CACHE_DIR=str(tmp_path))
    subprocess.run([sys.executable, *warmup_process.command()], env=other, timeout=DEADLINE, check=True)
    (folder,) = tmp_path.iterdir()
    ours = _kernel_cache.cache_folder()
    assert ours
    assert not list(folder.glob("draw-*"))
    for kernel in ours.glob("draw-*"):
        shutil.copy(kernel, folder)
    code = """
from tsplat import _jit, decode, warmup, warmup_process
def refuse(self, *_):
    raise AssertionError(f"compiled {self.__name__}")
_jit.Kernel._compiled = warmup_process.start = refuse
warmup.draw_tiny()
decode.make_ready()
import numpy as np
from tsplat.encode import ENCODERS, FALLBACK_CELL, encoder
for name in ENCODERS:
    for fidelity in (0.5, 1.0):
        chosen = encoder(name)
        chosen.fidelity = fidelity
        for shade in range(2):
            chosen.encode(np.full((40, 50, 3), shade, np.uint8), 5, 2, FALLBACK_CELL)
        chosen.clear()
"""
    done = subprocess.run(
        [sys.executable, "-c", code], env=other, capture_output=True, timeout=DEADLINE, check=False
    )
    assert done.returncode == 0, done.stderr.decode()


@pytest.mark.skipif(not JIT, reason="nothing is compiled or loaded")
@pytest.mark.parametrize("kept", [True, False])
@pytest.mark.usefixtures("compiled")
def test_a_second_process_compiles_only_where_draw_is_not_kept(
    kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    monkeypatch.setattr(draw, "ready", lambda *_: kept)
    monkeypatch.setattr("tsplat.warmup_process.start", lambda: done.append("start"))
    monkeypatch.setattr(draw, "on", lambda *_: done.append("draw"))
    monkeypatch.setattr("tsplat.raster.rasterize", lambda *_: None)
    warmup.draw_tiny()
    assert done == ([] if kept else ["start", "draw"])


@pytest.mark.skipif(os.name != "posix", reason="a script stands in for Python")
def test_the_second_process_ends_with_the_first(tmp_path: Path) -> None:
    script, told = tmp_path / "python", tmp_path / "told"
    script.write_text(f"#!/bin/sh\necho $$ $* > {told}-\nmv {told}- {told}\nexec sleep 600\n")
    script.chmod(0o755)
    code = f"""
import pathlib, sys, time
from tsplat import warmup_process
sys.executable = {str(script)!r}
warmup_process.available_processors = lambda: {{processors}}
warmup_process.start()
end = time.monotonic() + {{seconds}}
while not pathlib.Path({str(told)!r}).exists() and time.monotonic() < end:
    time.sleep(0.01)
"""
    run = partial(subprocess.run, timeout=DEADLINE, check=True)
    run([sys.executable, "-c", code.format(processors=1, seconds=0.5)])
    assert not told.exists()
    run([sys.executable, "-c", code.format(processors=2, seconds=DEADLINE)])
    process, *command = told.read_text().split()
    assert command[:2] == (["-I", "-B"] if sys.dont_write_bytecode else ["-I", "-c"])
    end = time.monotonic() + DEADLINE
    while is_running(int(process)) and time.monotonic() < end:
        time.sleep(0.01)
    assert not is_running(int(process))


def is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def test_warming_up_draws_nothing_where_nothing_is_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("drawn")

    monkeypatch.setattr("tsplat.raster.rasterize", refuse)  # first: importing it asks for JIT too
    monkeypatch.setattr("tsplat.warmup.JIT", False)
    warmup.draw_tiny()
