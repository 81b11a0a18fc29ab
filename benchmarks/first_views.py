"""First views of scenes on one sheet, to be looked at: is up up, and is this the side that one wants to see?

    python benchmarks/first_views.py SHEET.png SCENE_OR_FOLDER ... [--turned]

Prints for each scene what is up and by what cue, and draws its first view at 240x160. With ``--turned`` every
scene is also turned so that its up becomes each of the other five, harmonics and all: a row of six.
"""

from __future__ import annotations

import argparse
import os
import time
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from tsplat import edit
from tsplat.errors import LoadError, LoadWarning
from tsplat.first_view import first_view
from tsplat.framing import axis_name
from tsplat.io import load, training_beside
from tsplat.io.formats import FORMATS
from tsplat.raster import rasterize
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians
from tsplat.train_views import TrainViews

SIZE = 240, 160
FOV_Y = 55.0
COLUMNS = 6
LINE = 12

TURNS = {"-y": (0, 0, 0), "y": (180, 0, 0), "z": (-90, 0, 0), "-z": (90, 0, 0), "x": (0, 0, 90), "-x": (0, 0, -90)}
"""Degrees about x, y and z that a scene whose up is -y is turned by, by what becomes of its up."""

MOST = 600_000
"""Splats drawn; of more, so many evenly spread over the file: a sheet of large scenes should not take hours."""

Picture = tuple[str, npt.NDArray[np.uint8]]


def scenes(places: list[str]) -> Iterator[Path]:
    """Give the files that are named, and all in the folders that are, whose names are those of scenes."""
    suffixes = tuple(each for known in FORMATS for each in known.suffixes if each != ".json")
    for place in map(Path, places):
        if place.is_dir():
            names = sorted(os.listdir(place))
            yield from (place / name for name in names if name.lower().endswith(suffixes))
        else:
            yield place


def picture(gaussians: Gaussians, label: str, views: TrainViews | None, *, spz: bool) -> Picture:
    """Return the first view of a scene with what is up in it, which is printed too."""
    options = RenderOptions(antialias="relative", depths=False, train_views=views)
    start = time.perf_counter()
    view = first_view(gaussians, options, aspect=SIZE[0] / SIZE[1], fov_y=FOV_Y, spz=spz)
    seconds = time.perf_counter() - start
    print(f"{label:40} {view.up.text}{', at a training camera' if view.cameras else ''} ({1e3 * seconds:.0f} ms)")
    frame = rasterize(gaussians, view.pose.camera(*SIZE, FOV_Y), replace(options, train_views=None)).frame()
    return f"{label}: {axis_name(view.up.direction)}, {view.up.cue}", frame


def pictures(path: Path, *, turned: bool) -> list[Picture]:
    """Return the first view of a scene, or those of it turned six ways."""
    scene, spz = load(path), path.suffix.lower() == ".spz"
    scene = scene.take(np.arange(0, len(scene), -(-len(scene) // MOST)))
    name = path.parent.name if path.name in ("meta.json", "lod-meta.json") else path.name
    if not turned:
        return [picture(scene, name, training_beside(path).views, spz=spz)]
    return [picture(edit.rotate(scene, turn), f"{name}, {up}", None, spz=spz) for up, turn in TURNS.items()]


def sheet(shown: list[Picture]) -> Image.Image:
    """Return all pictures, six in a row, each below its label."""
    width, height = SIZE[0], SIZE[1] + LINE
    image = Image.new("RGB", (COLUMNS * width, -(-len(shown) // COLUMNS) * height))
    draw = ImageDraw.Draw(image)
    for place, (label, frame) in enumerate(shown):
        left, top = place % COLUMNS * width, place // COLUMNS * height
        draw.text((left + 2, top), label[:40], fill=(255, 255, 0))
        image.paste(Image.fromarray(frame), (left, top + LINE))
    return image


def main() -> None:
    """Read the arguments, write the sheet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sheet", type=Path)
    parser.add_argument("places", nargs="+")
    parser.add_argument("--turned", action="store_true")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", LoadWarning)
    shown = []
    for path in scenes(arguments.places):
        try:
            shown += pictures(path, turned=arguments.turned)
        except LoadError as error:
            print(error)
    sheet(shown).save(arguments.sheet)


if __name__ == "__main__":
    main()
