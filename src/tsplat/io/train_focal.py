"""How a scene was trained, as far as the files beside it tell: the focal length in pixels, what was in view.

A ``cameras.json`` has the sizes that its photographs came in, not those that were trained on. The training code
of Kerbl et al. 2023 takes a folder of smaller copies (``--images images_4``) and scales what is wider than 1600
pixels (``--resolution``); it notes both in ``cfg_args``. nerfstudio halves photographs until no side exceeds 1600.
It also turns, moves and scales the world before it trains: its list does not say where cameras are in a scene.
"""

from __future__ import annotations

import math
import re
import statistics
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from tsplat import given
from tsplat.errors import CorruptFileError, LoadError, LoadWarning
from tsplat.io.cameras import load_cameras
from tsplat.io.sources import is_elsewhere, settled
from tsplat.io.transforms import load_lenses
from tsplat.scene import Vector
from tsplat.train_views import TrainViews

LEVELS_UP = 3
"""Folders searched above the scene's: training writes ``point_cloud/iteration_30000/point_cloud.ply``."""

WIDEST = 1600.0
"""Pixels; photographs that are wider are scaled down by default."""

DIVISORS = 1, 2, 4, 8
"""What ``--resolution`` divides by; other numbers are widths in pixels, those below 0 mean `WIDEST`."""

CAMERAS = 2000
"""Looked at of a ``cameras.json``: enough for a median and for what was in view, in tenths of a second."""

FOCALS = 0.1, 1e7
"""Pixels; no lens has a focal length outside of these, whatever a list says."""

ARGUMENTS_BYTES = 1 << 16
"""More of a ``cfg_args`` is not looked at."""


class Training(NamedTuple):
    """What is known of how a scene was trained.

    Attributes
    ----------
    focal : float, optional
        Median focal length fx of the training images, in pixels at the size that was trained at.
    views : TrainViews, optional
        What the cameras had in view, where the list says it in the axes of the scene.
    """

    focal: float | None = None
    views: TrainViews | None = None


def train_focal_beside(scene_path: str | Path) -> float | None:
    """Return the training focal length alone, see `training_beside`."""
    return training_beside(scene_path).focal


def training_beside(scene_path: str | Path, origin: Vector | None = None) -> Training:
    """Return what the list of training images tells that lies beside a scene or up to three folders above.

    Parameters
    ----------
    scene_path : str or Path
        The scene, or the folder that it is in. The nearest folder counts that has a ``cameras.json``,
        ``transforms.json`` or ``transforms_train.json``, in this order.
    origin : tuple of 3 floats, optional
        Of the scene, as in `Gaussians`: cameras are listed where they are in the world.

    Returns
    -------
    Training
        Nothing where there is no such list, or an empty one, or the scene is no file.

    Warns
    -----
    LoadWarning
        The list is broken: the scene can be shown all the same.
    """
    if is_elsewhere(scene_path):
        return Training()
    path = _nearest_list(Path(settled(given.path(scene_path))[0]))
    if path is None:
        return Training()
    try:
        return _training(path, origin)
    except MemoryError:
        error = LoadError(path, "needs more memory than there is")
    except LoadError as broken:
        error = broken
    warnings.warn(f"{error}; no training focal length is taken from it", LoadWarning, stacklevel=2)
    return Training()


def _nearest_list(scene_path: Path) -> Path | None:
    with suppress(OSError, ValueError):  # folders that may not be looked into, names that are none
        folder = scene_path.absolute().parent
        for each in (folder, *folder.parents[:LEVELS_UP]):
            for name in SOURCES:
                if (each / name).is_file():
                    return each / name
    return None


def _training(path: Path, origin: Vector | None) -> Training:
    focals, views = SOURCES[path.name](path, origin or (0.0, 0.0, 0.0))
    if not focals:
        return Training()
    focal, (least, most) = statistics.median(focals), FOCALS
    if not least <= focal <= most:
        problem = f"gives a focal length of {focal:g} pixels, expected {least:g} to {most:g}; export it again"
        raise CorruptFileError(path, problem)
    return Training(focal, views)


Listed = tuple[list[float], TrainViews | None]
"""Focal lengths and what was in view."""


def _of_cameras(path: Path, origin: Vector) -> Listed:
    arguments = _arguments(path.parent)
    folder = re.search(r"\bimages='([^']*)'", arguments)
    resolution = re.search(r"\bresolution=(-?\d{1,6})\b", arguments)
    divisor = _divisor(folder[1] if folder else _only_images(path.parent))
    cameras = [each.camera for each in load_cameras(path, CAMERAS)]
    sizes = [(each.K[0, 0].item(), each.width / divisor) for each in cameras]
    asked = int(resolution[1]) if resolution else -1
    focals = [focal / divisor * _trained_width(width, asked) / width for focal, width in sizes]
    return focals, TrainViews.of([camera.shifted(origin) for camera in cameras])


def _arguments(folder: Path) -> str:
    """Return what the training code was called with."""
    path = folder / "cfg_args"
    # Pipes and devices would keep a reader waiting.
    with suppress(OSError):
        if path.is_file():
            with path.open("rb") as file:
                return file.read(ARGUMENTS_BYTES).decode("utf-8", "replace")
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


def _of_nerf(path: Path, _: Vector) -> Listed:
    return [lens.focal * _trained_width(lens.width, -1) / lens.width for lens in load_lenses(path)], None


def _of_nerfstudio(path: Path, _: Vector) -> Listed:
    def halvings(side: float) -> int:
        return max(0, math.ceil(math.log2(side / WIDEST)))

    return [lens.focal / 2 ** halvings(max(lens.width, lens.height)) for lens in load_lenses(path)], None


SOURCES: dict[str, Callable[[Path, Vector], Listed]] = {
    "cameras.json": _of_cameras,
    "transforms.json": _of_nerfstudio,
    "transforms_train.json": _of_nerf,
}
"""Files that list cameras, the nearer relative of the scene first."""
