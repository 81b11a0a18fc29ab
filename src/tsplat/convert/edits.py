"""What the options of `tsplat convert` do to a scene, one edit each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from tsplat import edit
from tsplat.progress import wait_for_kernels
from tsplat.scene import Gaussians
from tsplat.warmup import WarmUp


class Edit(NamedTuple):
    """An option as it was given: its name without dashes, and its value."""

    option: str
    value: Any

    def __str__(self) -> str:
        values = self.value if isinstance(self.value, tuple) else (self.value,)
        words = (f"{value:.9g}" if isinstance(value, float) else str(value) for value in values)
        return f"--{self.option} {','.join(words)}"


def in_order(given: Sequence[str], values: dict[str, tuple[Any, ...]]) -> list[Edit]:
    """Return the edits in the order of the command line.

    Parameters
    ----------
    given : sequence of str
        Names of all parameters, as often and in the order as they were given.
    values : dict of str to tuple
        What was given to those that are edits, each in its own order.
    """
    left = {name: iter(each) for name, each in values.items()}
    return [Edit(name.replace("_", "-"), next(left[name])) for name in given if name in left]


def apply(wanted: Edit, gaussians: Gaussians, progress: Callable[[float], None]) -> Gaussians:
    """Return the scene after one edit."""
    value = wanted.value
    match wanted.option:
        case "crop-box":
            return edit.crop_box(gaussians, value[:3], value[3:])
        case "crop-sphere":
            return edit.crop_sphere(gaussians, value[:3], value[3])
        case "max-splats":
            return edit.keep_most_important(gaussians, value)
        case "min-opacity":
            return edit.drop_faint(gaussians, value)
        case "max-scale":
            return edit.drop_large(gaussians, value)
        case "remove-floaters":
            wait_for_kernels(WarmUp(_compile_search))
            return edit.remove_floaters(gaussians, value[0], progress)
        case "decimate":
            return _decimated(gaussians, splats_left(value, len(gaussians)), progress)
        case "sh-degree":
            return edit.lower_sh_degree(gaussians, value)
        case "rotate":
            return edit.rotate(gaussians, value)
        case "translate":
            return edit.translate(gaussians, value)
        case "scale":
            return edit.scale(gaussians, value)
    raise AssertionError(f"--{wanted.option} is no edit")


def splats_left(amount: str, splats: int) -> int:
    """Return how many splats a number of them, or a percentage of ``splats``, is: 1 or more."""
    return max(1, round(splats * float(amount[:-1]) / 100.0)) if amount.endswith("%") else int(amount)


def _decimated(gaussians: Gaussians, count: int, progress: Callable[[float], None]) -> Gaussians:
    from tsplat.lod import decimate  # kernels, which other edits do without

    def compile_merging() -> None:
        decimate(gaussians.take(range(min(2, len(gaussians)))), 1, threads=1)

    wait_for_kernels(WarmUp(compile_merging))
    return decimate(gaussians, count, progress=progress)


def _compile_search() -> None:
    """Look for a neighbour once, for the sake of the kernels."""
    from tsplat.neighbours import mean_gaps

    mean_gaps(np.zeros((2, 3), np.float32), np.zeros(2, np.float32), 1)
