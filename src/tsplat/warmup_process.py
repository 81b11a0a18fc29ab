"""A second process for the first run ever: while this one compiles `draw`, it compiles every other kernel.

`draw` takes two thirds of the time, and threads of one process cannot compile at once. What the second one has
kept by then is loaded, what it has not is compiled here.
"""

from __future__ import annotations

import atexit
import os
import sys
import threading
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from tsplat._kernel_cache import cache_folder
from tsplat._search_path import safe_path
from tsplat.processors import available_processors
from tsplat.scene import Gaussians

if TYPE_CHECKING:
    import subprocess

    from tsplat.encode import Encoder

SPLATS = 4
SIDE = 32
"""Pixels of a picture that is made for the sake of its kernels."""

FIDELITIES = 1.0, 0.3
"""What an encoder leaves out below 1 takes kernels of its own."""


CODE = """
import sys
sys.path[:] = sys.argv[1:]
from tsplat._search_path import ignore_current_folder
ignore_current_folder()
from tsplat.warmup_process import compile_others
compile_others()
"""


def start() -> None:
    """Start it, where it can be of use; it ends with this process, if not before."""
    is_python = sys.executable and not getattr(sys, "frozen", False)
    if available_processors() < 2 or cache_folder() is None or not is_python:
        return
    import subprocess  # later runs do without

    nothing = subprocess.DEVNULL
    with suppress(OSError):
        process = subprocess.Popen(
            [sys.executable, *command()], stdin=nothing, stdout=nothing, stderr=nothing,
            start_new_session=True,  # Ctrl-C is not meant for it
        )  # fmt: skip
        atexit.register(_end, process, os.getpid())
        threading.Thread(target=process.wait, daemon=True).start()


def command() -> list[str]:
    """Return what Python is given: it finds what this process finds, but nothing in the current folder."""
    as_here = ["-B"] if sys.dont_write_bytecode else []  # -I looks at no variable of Python's
    return ["-I", *as_here, "-c", CODE, *safe_path()]


def _end(process: subprocess.Popen[bytes], starter: int) -> None:
    if os.getpid() == starter:  # no child that was forked meanwhile
        process.kill()


def tiny_scene() -> Gaussians:
    """Return a few splats in arrays of the types that every scene has."""
    return Gaussians(
        means=np.zeros((SPLATS, 3), np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (SPLATS, 1)),
        scales=np.full((SPLATS, 3), 0.1, np.float32),
        opacities=np.full(SPLATS, 0.5, np.float32),
        sh=np.full((SPLATS, 16, 3), 0.1, np.float32),
    )


def encode_tiny(chosen: Encoder) -> None:
    """Encode a picture as it is, and one of which something is left out."""
    from tsplat.encode import FALLBACK_CELL

    for chosen.fidelity in FIDELITIES:
        chosen.encode(np.zeros((SIDE, SIDE, 3), np.uint8), 4, 2, FALLBACK_CELL)
    chosen.clear()


def compile_others() -> None:
    """Compile what drawing needs besides `draw`, then what encoding does, the most usual first, then decoding."""
    from tsplat._threads import new_team
    from tsplat.decode import make_ready
    from tsplat.encode import ENCODERS, encoder
    from tsplat.raster import crew
    from tsplat.raster.buffers import Buffers
    from tsplat.raster.frame import COUNTERS, NONE, Image
    from tsplat.raster.prepare import prepared
    from tsplat.raster.soften import soften

    prepared(tiny_scene(), 1)
    crew.make_ready()
    buffers = Buffers()
    image = Image(SIDE, SIDE, NONE, buffers.image(SIDE * SIDE * 3), buffers.image(SIDE * SIDE), None)
    soften(image, 0.5, 1, new_team(COUNTERS), buffers)
    for name in ("half", *ENCODERS):
        encode_tiny(encoder(name))
    make_ready()
