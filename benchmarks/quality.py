"""How near pictures are to photographs, and what a walk towards a surface shows: ``quality.py``.

The photographs are snowmiku's 13 that were not trained on, scaled down by the mean of each square of pixels. The
walk goes from their cameras towards what is in the middle. No photograph is so near; the truth is the picture from
where the walk began through a lens as much longer, which has the dilation of training, magnified. It differs by
parallax, so that only high frequencies are compared, and gaps counted: pixels that are less than 90 % covered.
With ``--pictures``, writes those of docs/quality.md as well: classic, mip, relative and the truth, side by side.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image
from rich.console import Console
from rich.table import Table

from training import Baked, Unsoftened, baked, photographs, trained_on, training_depths
from tsplat import images
from tsplat.camera import Camera
from tsplat.io import load
from tsplat.raster import rasterize
from tsplat.rendering import ANTIALIAS, RenderOptions
from tsplat.scene import Gaussians
from tsplat.train_views import TrainViews
from views import F64, SNOWMIKU, SNOWMIKU_FOCAL, colors, high_frequencies, psnr, rms, scenes

DIVISORS = 8, 4, 2, 1
STEPS = 2, 4, 16
COVERED = 0.9

CROP = 96, 64
ENLARGED = 3
GAP = 6


class Way(NamedTuple):
    """A way to draw a scene."""

    name: str
    gaussians: Gaussians
    options: RenderOptions


def main() -> int:
    """Print the tables, and write the pictures where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", type=Path, metavar="FOLDER")
    folder = parser.parse_args().pictures
    ways = _ways(load(SNOWMIKU / "trained" / "snow_sh3_3000.ply"))
    console = Console(width=110)
    console.print(_against_photographs(ways))
    console.print(_on_a_walk(ways))
    if folder:
        _write_pictures(folder)
    return 0


def _ways(gaussians: Gaussians) -> list[Way]:
    focal = SNOWMIKU_FOCAL
    depths = training_depths(gaussians)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # splats that no camera saw
        nearest, mean = np.nanmin(depths, axis=0), np.nanmean(depths, axis=0)
    views = TrainViews.of(trained_on())
    relative = {"antialias": "relative", "train_focal": focal}
    return [
        *(Way(mode, gaussians, RenderOptions(antialias=mode, train_focal=focal)) for mode in ANTIALIAS),
        Way("relative, cameras known", gaussians, RenderOptions(**relative, train_views=views)),  # type: ignore[arg-type]
        Way("relative, not softened", gaussians, Unsoftened(**relative)),  # type: ignore[arg-type]
        Way("baked, nearest depth", baked(gaussians, nearest), Baked(**relative)),  # type: ignore[arg-type]
        Way("baked, mean depth", baked(gaussians, mean), Baked(**relative)),  # type: ignore[arg-type]
    ]


def _against_photographs(ways: list[Way]) -> Table:
    table = Table("dB against photographs", *(f"1/{divisor}" for divisor in DIVISORS))
    views = [photographs(divisor) for divisor in DIVISORS]
    for way in ways:
        found = [
            np.mean([psnr(colors(way.gaussians, camera, way.options), photo) for camera, photo in size])
            for size in views
        ]
        table.add_row(way.name, *(f"{decibels:.2f}" for decibels in found))
    return table


def _on_a_walk(ways: list[Way]) -> Table:
    table = Table("high frequencies, share of gaps", *(f"at 1/{step} of the distance" for step in STEPS))
    cameras = [camera for camera, _ in photographs(1)]
    longest = [[_through_a_longer_lens(ways[2], camera, step) for camera in cameras] for step in STEPS]
    for way in ways:
        cells = []
        for step, truths in zip(STEPS, longest, strict=True):
            drawn = [rasterize(way.gaussians, _nearer(ways[2], camera, step), way.options) for camera in cameras]
            high = np.mean([_sharpness(image.colors) for image in drawn]) / np.mean(truths)
            gaps = np.mean([image.alphas < COVERED for image in drawn])
            cells.append(f"{high:.2f}, {gaps:.2%}")
        table.add_row(way.name, *cells)
    return table


def _through_a_longer_lens(way: Way, camera: Camera, times: float) -> float:
    K = camera.K * times
    K[:, 2] = camera.K[:, 2]
    longer = Camera(camera.viewmat, K, camera.width, camera.height)
    return _sharpness(rasterize(way.gaussians, longer, way.options).colors)


def _nearer(way: Way, camera: Camera, step: float) -> Camera:
    """Return the camera moved ahead, so far that what is in its middle has only this share of its distance."""
    depths = rasterize(way.gaussians, camera, way.options).depths
    assert depths is not None
    y, x = camera.height // 2, camera.width // 2
    viewmat = camera.viewmat.copy()
    viewmat[2, 3] -= np.median(depths[y - 10 : y + 10, x - 15 : x + 15]) * (1.0 - 1.0 / step)
    return Camera(viewmat, camera.K, camera.width, camera.height)


def _sharpness(image: images.F32) -> float:
    return rms(high_frequencies(np.clip(image.astype(np.float64), 0.0, 1.0)))


def _write_pictures(folder: Path) -> None:
    for scene in scenes():
        drawn = [*(scene.draw(scene.pose, mode) for mode in ANTIALIAS), scene.truth(scene.pose)]
        path = folder / f"quality-{scene.name.partition(',')[0].replace(' ', '-')}.webp"
        Image.fromarray(_strip(drawn)).save(path, quality=82, method=6)
        print(
            f"{path}: {path.stat().st_size / 1e3:.0f} kB,",
            *(f"{psnr(each, drawn[-1]):.1f}" for each in drawn[:-1]),
        )


def _strip(pictures: list[F64]) -> images.U8:
    """Return the middles of pictures side by side, every pixel enlarged to a square."""
    width, height = CROP
    tiles = []
    for picture in pictures:
        y, x = (picture.shape[0] - height) // 2, (picture.shape[1] - width) // 2
        tile = images.quantize(picture[y : y + height, x : x + width].astype(np.float32))
        tiles.append(
            np.pad(tile.repeat(ENLARGED, 0).repeat(ENLARGED, 1), ((0, 0), (0, GAP), (0, 0)), constant_values=255)
        )
    return np.concatenate(tiles, axis=1)[:, :-GAP]


if __name__ == "__main__":
    sys.exit(main())
