"""A scene read, and written with its levels of detail."""

from __future__ import annotations

import io
import time
from pathlib import Path
from typing import Any

import numpy as np

from tsplat.errors import OptionError, SaveError
from tsplat.files import replacing
from tsplat.io.losses import lacks, refuse_lost, warn_lost
from tsplat.io.sources import called
from tsplat.io.tsplat_header import BLOCK
from tsplat.options import load_scene
from tsplat.processors import worker_count
from tsplat.progress import loading, wait_for_kernels
from tsplat.scene import Gaussians
from tsplat.warmup import WarmUp

SUFFIX = ".tsplat"
SH_DEGREE = 4


def optimize(scene: str, out: Path, how: dict[str, Any], threads: int, *, strict: bool = False) -> str:
    """Read a scene and write it as a .tsplat; it may be the file that was read.

    Parameters
    ----------
    scene : str
        What to read.
    out : Path
        What to write.
    how : dict
        How to read; see `tsplat.options.reading`.
    threads : int
        How many work at it; 0 means one per available processor.
    strict : bool
        Write nothing where something would be lost.

    Returns
    -------
    str
        What was done, for people.

    Raises
    ------
    LoadError
        The scene cannot be read.
    SaveError
        The file cannot be written, which is tried before anything is read; or not without a loss, and is not to.
    OptionError
        There are no splats.

    Warns
    -----
    SaveWarning
        The file lacks something of the scene.
    """
    if out.suffix.lower() != SUFFIX:
        raise SaveError(f"{out}: suffix {out.suffix!r} is not {SUFFIX}; tsplat convert writes other formats")
    warm_up = WarmUp(_compile_merging)
    with replacing(out) as file:
        gaussians = load_scene(scene, how | {"extra": True}, warm_up)
        if not len(gaussians):
            raise OptionError(f"there are no splats in {called(scene)}; nothing is written")
        losses = lacks(gaussians, SH_DEGREE, {"origin", "up", "antialiased"})
        if strict:
            refuse_lost(out, losses)
        wait_for_kernels(warm_up)
        from tsplat.lod import store

        start = time.perf_counter()
        with loading(out.name, doing="optimizing") as progress:
            store(file, gaussians, worker_count(threads), progress)
    warn_lost(out, losses, stacklevel=2)
    size, seconds = out.stat().st_size / 1e6, time.perf_counter() - start
    return f"{out}: {len(gaussians):,} splats, {size:,.2f} MB, optimized in {seconds:.1f} s"


def _compile_merging() -> None:
    """Store a few splats, for the sake of the kernels."""
    from tsplat.lod import store

    n = BLOCK + 1  # one more than need no other level
    ones, quats = np.ones((n, 3), np.float32), np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1))
    few = Gaussians(ones, quats, ones, ones[:, 0], ones[:, None])
    store(io.BytesIO(), few, 1, lambda _: None)
