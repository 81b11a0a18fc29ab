"""Options that several commands share, and what they make: a scene, and how to draw it."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rich_click as click
from click.core import ParameterSource

from tsplat.arguments import BACKGROUND, LEVEL, UP, Gigabytes, Number, Whole, scene_source
from tsplat.errors import LoadError, LoadWarning
from tsplat.first_view import framed_by
from tsplat.framing import bulk
from tsplat.progress import loading
from tsplat.rendering import ANTIALIAS, NEAR_PLANE, TRAIN_FOCAL_GUESS, Antialias, RenderOptions
from tsplat.warmup import WarmUp

if TYPE_CHECKING:
    from tsplat.lod import Stored
    from tsplat.scene import Gaussians

ANTIALIAS_HELP = (
    "How splats meet pixels: classic as in training, mip with opacities compensated, "
    "relative to the size of the training pictures and how near they were taken. "
    "[the scene's own, else relative; render: classic where no focal length is known]"
)
FOV_Y = 55.0

SPZ_FRAMES = (
    "ldb", "rdb", "lub", "rub", "ldf", "rdf", "luf", "ruf", "lbd", "rbd", "lbu", "rbu", "lfd", "rfd", "lfu", "rfu",
)  # fmt: skip
FORMAT_NAMES = ("ply", "splat", "ksplat", "spz", "sog", "glb", "gltf", "npz", "tsplat")
"""As in `tsplat.io.options`, which takes long to import."""

READING = ("max-splats", "raw-opacity", "raw-scales", "spz-frame", "lod", "format")
"""The options that say how a scene is read."""


def shared(*names: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return a decorator that adds the options of these names, in this order, to a command."""
    known = {
        "up": click.option("--up", type=UP, help="What is up: x, y, z, -x, -y, -z or three numbers. "
                           "[what the file says, else guessed]"),
        "antialias": click.option("--antialias", type=click.Choice(ANTIALIAS), help=ANTIALIAS_HELP),
        "sh-degree": click.option("--sh-degree", type=Whole(0, 4), default=4, show_default=True,
                                  help="Highest degree of spherical harmonics."),
        "threads": click.option("--threads", type=Whole(0, 1024), default=0, help="0 means all. [0]"),
        "memory": click.option("--memory", type=Gigabytes(0, 1000), default=0, metavar="GB",
                               help="What the work on one picture may take beside it; what needs more is drawn in "
                               "parts, to the same bits. [half of what is free]"),
        "max-splats": click.option("--max-splats", type=Whole(1), metavar="N",
                                   help="Keep the N splats with the largest opacity times area. [all]"),
        "raw-opacity": click.option("--raw-opacity", is_flag=True,
                                    help="The file holds opacities from 0 to 1, not their logits."),
        "raw-scales": click.option("--raw-scales", is_flag=True,
                                   help="The file holds scales in world units, not their logarithms."),
        "spz-frame": click.option("--spz-frame", type=click.Choice(SPZ_FRAMES), metavar="rub|rdf|...",
                                  help="Axes of an SPZ: rub is right, up, back, as specified; rdf where its "
                                  "writer kept those of a PLY, and the scene is upside down. "
                                  "[what it says, else rub]"),
        "lod": click.option("--lod", type=LEVEL, default="0", metavar="N|all",
                            help="Level of detail of a streamed scene, 0 the finest, or all of them. "
                            "[view: all, one at a time; else 0]"),
        "format": click.option("--format", type=click.Choice(FORMAT_NAMES), metavar="NAME",
                               help=f"Read the file as one of {', '.join(FORMAT_NAMES)}. [what its first bytes "
                               "say, else its name]"),
        "strict": click.option("--strict", is_flag=True,
                               help="Write nothing where something would be lost that is beyond the format."),
        "fov-y": click.option("--fov-y", type=Number(0.001, 179.999), default=FOV_Y,
                              show_default=True, metavar="DEGREES", help="Vertical field of view."),
        "train-focal": click.option("--train-focal", type=Number(0.001, 1_000_000), metavar="PIXELS",
                                    help="Focal length of the training pictures, for --antialias relative. "
                                    "[cameras.json or transforms.json beside the scene, else 1100]"),
        "background": click.option("--background", type=BACKGROUND, default="black", show_default=True,
                                   help="black, white, #rrggbb, or three numbers from 0 to 1."),
    }  # fmt: skip

    def add(function: Callable[..., Any]) -> Callable[..., Any]:
        for name in reversed(names):
            function = known[name](function)
        return function

    return add


def reading(options: dict[str, Any]) -> dict[str, Any]:
    """Take those options out that say how a scene is read."""
    return {name: options.pop(name) for name in (option.replace("-", "_") for option in READING)}


def load_scene(scene: str, how: dict[str, Any], warm_up: WarmUp | None = None) -> Gaussians:
    """Return the scene a person named, with a bar on stderr when that takes long; see `reading`."""
    with loaded_scene(scene, how, warm_up) as (gaussians, path):
        if not len(gaussians):
            warnings.warn(f"{path}: holds no splats; choose another file", LoadWarning, stacklevel=2)
        return gaussians


def open_scene(
    scene: str, how: dict[str, Any], warm_up: WarmUp | None = None, *, levels: bool = False
) -> Gaussians | Stored:
    """Return the scene a person named, to be drawn: a .tsplat stays on disk where nothing asks for all of it.

    Where all its ``levels`` are of use, a streamed one comes with them, the coarsest first.
    """
    from tsplat.io.sources import is_elsewhere, settled
    from tsplat.io.tsplat_map import is_tsplat

    source, _ = settled(scene_source(scene))
    if how["max_splats"] is None and not how["lod"] and how.get("format") in (None, "sog", "tsplat"):
        if not is_elsewhere(source) and is_tsplat(Path(source)):
            from tsplat.lod import open_stored

            return open_stored(Path(source))
        if levels and how["lod"] == 0 and (streamed := _open_levels(source, warm_up)):
            return streamed
    return load_scene(scene, how, warm_up)


def _open_levels(source: str | Path, warm_up: WarmUp | None) -> Stored | None:
    """Return a streamed scene with its coarsest levels read, unless it is something else."""
    from tsplat.io.sog_levels import find_levels
    from tsplat.io.sources import file_name

    with loading(file_name(source), warm_up) as bar:
        found = find_levels(source, bar.fetched)
        if found is None:
            return None
        from tsplat.lod import is_scattered, read_levels

        return None if is_scattered(found) else read_levels(found, whole=False, progress=bar)


def is_spz(scene: str, how: dict[str, Any]) -> bool:
    """Tell whether a scene is an SPZ that is read as specified, which many are not written as; see `reading`."""
    from tsplat.io.options import LoadOptions
    from tsplat.io.sources import file_name, is_elsewhere
    from tsplat.io.spz import find_frame

    if not file_name(scene).lower().endswith(".spz") or how["spz_frame"] is not None:
        return False
    source = scene_source(scene)
    with suppress(LoadError):  # it is only called so: packed, or of another format
        return is_elsewhere(source) or find_frame(Path(source), LoadOptions()).source == "format"
    return False


def was_said(option: str, context: click.Context) -> bool:
    """Tell whether the person gave an option, if only its default."""
    return context.get_parameter_source(option) is not ParameterSource.DEFAULT


@contextmanager
def loaded_scene(
    scene: str, how: dict[str, Any], warm_up: WarmUp | None = None
) -> Iterator[tuple[Gaussians, Path]]:
    """Give the scene a person named, and while it lasts the file that it is read from; see `load_scene`."""
    from tsplat.io import load
    from tsplat.io.sources import file_name, local_file

    with (
        loading(file_name(scene), warm_up) as bar,
        local_file(scene_source(scene), how["lod"], bar, bar.fetched, how.get("format")) as (path, progress),
    ):
        yield load(path, **how, progress=progress), path


def near_plane(gaussians: Gaussians) -> float:
    """Return where drawing starts in front of the eye, in world units: nearer than usual in a scene that is small.

    The eye may come as near to a scene of millimetres, for its size, as to any other.
    """
    return NEAR_PLANE * min(1.0, bulk(gaussians).radius)


def render_options(
    scene: str, gaussians: Gaussians | Stored, options: dict[str, Any], otherwise: Antialias = "relative"
) -> RenderOptions:
    """Return the options; where nobody said how to antialias, a scene's own way comes first.

    Then comes `relative` wherever a focal length of the training images is given, or known by the files beside the
    scene; ``otherwise`` where it is neither, with `TRAIN_FOCAL_GUESS` for one. Those files may also say how
    near the cameras came to the scene.
    """
    from tsplat.io import training_beside

    antialias, focal = options["antialias"], options["train_focal"]
    if antialias is None and gaussians.antialiased:
        antialias = "mip"
    frame = framed_by(gaussians)
    known, views = training_beside(scene_source(scene), frame.origin)
    if antialias in (None, "relative"):
        focal = focal or known
    options["near_plane"] = near_plane(frame)
    options["antialias"] = antialias or ("relative" if focal else otherwise)
    options["train_focal"] = focal or TRAIN_FOCAL_GUESS
    return RenderOptions(depths=False, train_views=views, **options)
