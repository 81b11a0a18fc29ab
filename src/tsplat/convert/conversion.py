"""Scenes read, joined, edited and written; what happened comes back as a plain document."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tsplat.convert.edits import Edit, apply
from tsplat.edit import join
from tsplat.errors import OptionError
from tsplat.io import saving
from tsplat.io.losses import warn_lost
from tsplat.io.on_disk import look
from tsplat.io.sources import called
from tsplat.options import loaded_scene
from tsplat.progress import loading
from tsplat.scene import Gaussians

Document = dict[str, Any]


def convert(
    scenes: Sequence[str], out: Path, edits: Sequence[Edit], how: dict[str, Any], *, strict: bool = False
) -> Document:
    """Read scenes, make one of them, edit it, and write it; ``out`` may be one of those that were read.

    Parameters
    ----------
    scenes : sequence of str
        What to read.
    out : Path
        What to write, in the format that its suffix names.
    edits : sequence of Edit
        In this order.
    how : dict
        How to read; see `tsplat.options.reading`.
    strict : bool
        Write nothing where something would be lost.

    Returns
    -------
    dict
        ``inputs``, ``edits`` and ``output``, fit for JSON.

    Raises
    ------
    LoadError
        A scene cannot be read.
    SaveError
        The scene cannot be written, which is tried before anything is read; or not without a loss, and is not to.
    OptionError
        No splat is left to be written.

    Warns
    -----
    SaveWarning
        The file lacks something of the scene.
    """
    with saving(out, strict=strict) as write:
        inputs, loaded = [], []
        for name in scenes:
            with loaded_scene(name, how | {"extra": True}) as (scene, path):
                inputs.append(_input(called(name), path, scene))
                loaded.append(scene)
        gaussians = join(loaded)
        if not len(gaussians):
            raise OptionError(f"there are no splats in {', '.join(map(called, scenes))}; nothing is written")
        steps = []
        with loading(out.name, doing="editing") as progress:
            for edit in edits:
                gaussians, step = _edited(gaussians, edit, progress)
                steps.append(step)
        losses = write(gaussians)
    warn_lost(out, losses, stacklevel=2)
    return {"inputs": inputs, "edits": steps, "output": _output(out, gaussians, inputs) | {"losses": losses}}


def _edited(gaussians: Gaussians, edit: Edit, progress: Callable[[float], None]) -> tuple[Gaussians, Document]:
    # What grows too large for float32 is refused by `Gaussians`, in words.
    with np.errstate(over="ignore", invalid="ignore"):
        edited = apply(edit, gaussians, progress)
    removed = len(gaussians) - len(edited)
    if not len(edited):
        raise OptionError(f"{edit} removes the last {removed:,} splats; nothing is written")
    return edited, {
        "edit": str(edit), "removed": removed, "splats": len(edited), "sh_degree": edited.sh_degree
    }  # fmt: skip


def _input(name: str, path: Path, gaussians: Gaussians) -> Document:
    about = {"splats": len(gaussians), "sh_degree": gaussians.sh_degree, "antialiased": gaussians.antialiased}
    return {"name": name, **_file(path), **about}


def _output(path: Path, gaussians: Gaussians, inputs: Sequence[Document]) -> Document:
    about = _file(path)
    before, after = [each["bytes"] for each in inputs], about["bytes"]
    ratio = None if None in (*before, after) else after / sum(before)
    return {"name": str(path), **about, "splats": len(gaussians), "origin": gaussians.origin, "ratio": ratio}


def _file(path: Path) -> Document:
    """Return format and size of a file and of those it names; None where these hold levels that are not read."""
    on_disk = look(path)
    return {"format": on_disk.format, "bytes": on_disk.nbytes if on_disk.scenes == 1 else None}
