"""The focal length that a scene was trained at, in pixels, as far as the files beside it tell.

A ``cameras.json`` has the sizes that its photographs came in, not those that were trained on. The training code
of Kerbl et al. 2023 takes a folder of smaller copies (``--images images_4``) and scales what is wider than 1600
pixels (``--resolution``); it notes both in ``cfg_args``. nerfstudio halves photographs until no side exceeds 1600.
"""

from __future__ import annotations

import math
import re
import statistics
import warnings
from collections.abc import Callable
from pathlib import Path

from tsplat.errors import LoadError, LoadWarning
from tsplat.io.cameras import load_cameras
from tsplat.io.sources import is_elsewhere
from tsplat.io.transforms import load_lenses

LEVELS_UP = 3
"""Folders searched above the scene's: training writes ``point_cloud/iteration_30000/point_cloud.ply``."""

WIDEST = 1600.0
"""Pixels; photographs that are wider are scaled down by default."""

DIVISORS = 1, 2, 4, 8
"""What ``--resolution`` divides by; other numbers are widths in pixels, those below 0 mean `WIDEST`."""

ARGUMENTS_BYTES = 1 << 16
"""More of a ``cfg_args`` is not looked at."""


def train_focal_beside(scene_path: str | Path) -> float | None:
    """Return the median focal length fx of the training images listed beside a scene or up to three folders above.

    Parameters
    ----------
    scene_path : str or Path
        The scene. The nearest folder counts that has a ``cameras.json``, ``transforms.json`` or
        ``transforms_train.json``, in this order.

    Returns
    -------
    float or None
        Pixels at the size that was trained at; None where there is no such list, or an empty one, or the scene
        is no file.

    Warns
    -----
    LoadWarning
        The list is broken: the scene can be shown all the same.
    """
    if is_elsewhere(scene_path):
        return None
    folder = Path(scene_path).absolute().parent
    places = (each / name for each in (folder, *folder.parents[:LEVELS_UP]) for name in SOURCES)
    path = next((place for place in places if place.is_file()), None)
    if path is None:
        return None
    try:
        focals = SOURCES[path.name](path)
    except LoadError as error:
        warnings.warn(f"{error}; no training focal length is taken from it", LoadWarning, stacklevel=2)
        return None
    return statistics.median(focals) if focals else None


def _of_cameras(path: Path) -> list[float]:
    arguments = _arguments(path.parent)
    folder = re.search(r"\bimages='([^']*)'", arguments)
    resolution = re.search(r"\bresolution=(-?\d{1,6})\b", arguments)
    divisor = _divisor(folder[1] if folder else _only_images(path.parent))
    cameras = [(each.camera.K[0, 0].item(), each.camera.width / divisor) for each in load_cameras(path)]
    asked = int(resolution[1]) if resolution else -1
    return [focal / divisor * _trained_width(width, asked) / width for focal, width in cameras]


def _arguments(folder: Path) -> str:
    """Return what the training code was called with."""
    try:
        with (folder / "cfg_args").open("rb") as file:
            return file.read(ARGUMENTS_BYTES).decode("utf-8", "replace")
    except OSError:
        return ""


def _only_images(folder: Path) -> str:
    """Return the name of the folder with photographs, where there is just one."""
    try:
        names = [each.name for each in folder.glob("images*") if each.is_dir()]
    except OSError:
        return ""
    return names[0] if len(names) == 1 else ""


def _divisor(images: str) -> int:
    """Return how many times smaller the photographs of a folder are, by its name: 4 for ``images_4``."""
    found = re.fullmatch(r"images_([1-9]\d{0,2})", Path(images).name)
    return int(found[1]) if found else 1


def _trained_width(width: float, resolution: int) -> float:
    if resolution in DIVISORS:
        return width / resolution
    return float(resolution) if resolution > 0 else min(width, WIDEST)


def _of_nerf(path: Path) -> list[float]:
    return [lens.focal * _trained_width(lens.width, -1) / lens.width for lens in load_lenses(path)]


def _of_nerfstudio(path: Path) -> list[float]:
    def halvings(side: float) -> int:
        return max(0, math.ceil(math.log2(side / WIDEST)))

    return [lens.focal / 2 ** halvings(max(lens.width, lens.height)) for lens in load_lenses(path)]


SOURCES: dict[str, Callable[[Path], list[float]]] = {
    "cameras.json": _of_cameras,
    "transforms.json": _of_nerfstudio,
    "transforms_train.json": _of_nerf,
}
"""Files that list cameras, the nearer relative of the scene first."""
