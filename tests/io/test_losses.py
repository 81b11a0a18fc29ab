"""What goes beyond a format is kept to 40 dB where it can be, else said with numbers, and refused if asked."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.raster.compare import psnr
from tests.scenes import random_gaussians
from tsplat import edit, io
from tsplat.errors import SaveError, SaveWarning
from tsplat.framing import bulk, start_pose
from tsplat.io.losses import brought_nearer
from tsplat.options import near_plane
from tsplat.raster import rasterize
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

CLOUD = random_gaussians(np.random.default_rng(8), 3000, 0)
CLOUD = replace(CLOUD, sh=np.clip(CLOUD.sh, -1.7, 1.7))


def with_floaters(*places: tuple[float, float, float]) -> Callable[[Gaussians], Gaussians]:
    """Return what puts faint splats far away: a tenth of their distance large, as those of a sky are."""

    def add(scene: Gaussians) -> Gaussians:
        floaters = scene.take(range(len(places)))
        means = np.array(places, np.float32)
        scales = np.repeat(0.1 * np.linalg.norm(means, axis=1, keepdims=True), 3, axis=1)
        opacities = np.full(len(places), 0.3, np.float32)
        return edit.join([replace(floaters, means=means, scales=scales, opacities=opacities), scene])

    return add


def with_sigma(value: float) -> Callable[[Gaussians], Gaussians]:
    """Return what gives one splat, behind the others, such a sigma."""

    def change(scene: Gaussians) -> Gaussians:
        scales, means, opacities = scene.scales.copy(), scene.means.copy(), scene.opacities.copy()
        scales[0], means[0], opacities[0] = value, (0, 0, 3), 0.5
        return replace(scene, scales=scales, means=means, opacities=opacities)

    return change


def with_color(value: float) -> Callable[[Gaussians], Gaussians]:
    """Return what gives one splat, a small one, such a colour."""

    def change(scene: Gaussians) -> Gaussians:
        sh, scales, opacities = scene.sh.copy(), scene.scales.copy(), scene.opacities.copy()
        sh[7], scales[7], opacities[7] = value, 0.005, 0.9
        return replace(scene, sh=sh, scales=scales, opacities=opacities)

    return change


def with_colors(scene: Gaussians) -> Gaussians:
    return replace(scene, sh=4.0 * scene.sh)


CASES: dict[str, Callable[[Gaussians], Gaussians]] = {
    "as it is": lambda scene: scene,
    "millimetres": lambda scene: edit.scale(scene, 1e-3),
    "micrometres": lambda scene: edit.scale(scene, 1e-6),
    "a country": lambda scene: edit.scale(scene, 1e5),
    "a floater at 60": with_floaters((0, 60, 0)),
    "a floater at 1e5": with_floaters((0, 1e5, 0)),
    "two at 1e6": with_floaters((1e6, 0, 0), (0, -1e6, 3e5)),
    "many of many distances": with_floaters(*((0, 3.0**i, 2.0**i) for i in range(3, 14))),
    "a floater at 1e9": with_floaters((0, 0, 1e9)),
    "millimetres and a floater": lambda scene: with_floaters((0, 1e5, 0))(edit.scale(scene, 1e-3)),
    "a sigma of 1e20": with_sigma(1e20),
    "a sigma of 500": with_sigma(500.0),
    "a colour of 1e4": with_color(1e4),
}

SAID = {
    (".spz", "millimetres"): r"2,795 of 3,000 splats have a sigma outside of 4\.54e-05 to 379",
    (".spz", "micrometres"): r"have a sigma outside of .* --scale 100000 keeps them",
    (".spz", "a country"): r"have a sigma outside of .* --scale 0\.01 keeps them",
    (".spz", "millimetres and a floater"): "have a sigma outside of",
    (".spz", "a sigma of 1e20"): r"1 of 3,000 splats have a sigma outside of .* --max-scale 378\.\d+ removes them",
    (".spz", "a sigma of 500"): "1 of 3,000 splats have a sigma outside of",
    (".compressed.ply", "a sigma of 1e20"): r"1 of 3,000 splats have a sigma outside of 2\.06e-09 to 4\.85e\+08",
}
"""What keeps less than 40 dB, and is said; all else must be kept."""

NEARER = "brought nearer"


def picture(gaussians: Gaussians, view: Gaussians) -> np.ndarray:
    camera = start_pose(view, aspect=4 / 3, fov_y=50.0, up=(0, -1, 0)).camera(320, 240, 50.0)
    return np.clip(rasterize(gaussians, camera, RenderOptions(near_plane=near_plane(view))).colors, 0.0, 1.0)


@pytest.mark.filterwarnings("ignore::tsplat.errors.SaveWarning")
@pytest.mark.parametrize("suffix", [".spz", ".sog", ".compressed.ply", ".splat", ".glb", ".ply"])
@pytest.mark.parametrize("case", CASES)
def test_a_picture_is_kept_to_40_db_or_it_is_said_what_is_lost(tmp_path: Path, suffix: str, case: str) -> None:
    scene = CASES[case](CLOUD)
    path = tmp_path / f"scene{suffix}"
    with io.saving(path) as write:
        losses = write(scene)
    if said := SAID.get((suffix, case)):
        with pytest.raises(SaveError, match=f"{said}.*nothing is written"):
            io.save(tmp_path / f"strict{suffix}", scene, strict=True)
        assert not (tmp_path / f"strict{suffix}").exists()
        return
    assert all(NEARER in loss for loss in losses)
    truth = picture(scene, scene)
    assert np.ptp(truth) > 0.5
    assert psnr(picture(io.load(path), scene), truth) >= 40.0


@pytest.mark.parametrize(
    ("suffix", "change", "said"),
    [
        (".splat", with_colors, "splats have colours outside of 0 to 1, and were cut to that"),
        (
            ".spz",
            lambda _: random_gaussians(np.random.default_rng(1), 9, 4),
            "harmonics above degree 3 are left out",
        ),
        (".glb", lambda s: replace(s, antialiased=True), "that it was trained with antialiasing is left out"),
        (".sog", lambda s: replace(s, up=(0.0, 0.0, 1.0)), r"that \(0, 0, 1\) is up is left out"),
        (".compressed.ply", lambda s: replace(s, sh=np.full((3000, 4, 3), 9.0)), "have harmonics beyond 4"),
    ],
)
def test_what_a_format_has_no_place_for_is_said(
    tmp_path: Path, suffix: str, change: Callable[[Gaussians], Gaussians], said: str
) -> None:
    with pytest.warns(SaveWarning, match=said):
        io.save(tmp_path / f"scene{suffix}", change(CLOUD))


def test_what_is_brought_nearer_looks_the_same_from_the_bulk() -> None:
    scene = with_floaters((3e3, 4e3, 0), (0, 0, 7e3))(CLOUD)
    limit = np.full(3, 100.0)
    box = bulk(scene)
    after = brought_nearer(scene, box, -limit, limit)
    assert np.abs(after.means).max() <= 100.0
    offsets, before = (each.means[:2] - box.center for each in (after, scene))
    shares = np.linalg.norm(offsets, axis=1) / np.linalg.norm(before, axis=1)
    np.testing.assert_allclose(offsets, shares[:, None] * before, atol=1e-3)
    np.testing.assert_allclose(after.scales[:2], shares[:, None] * scene.scales[:2], rtol=1e-5)
    np.testing.assert_array_equal(after.means[2:], scene.means[2:])


def test_an_spz_saved_again_has_the_same_bits_of_means(tmp_path: Path) -> None:
    scene = with_floaters((0, 1e5, 0))(CLOUD)
    with pytest.warns(
        SaveWarning, match="1 of 3,001 splats are brought nearer.* farther than 2048 from the origin"
    ):
        first = io.save(tmp_path / "first.spz", scene)
    second = io.save(tmp_path / "second.spz", io.load(first))
    header_and_means = slice(16 + 9 * len(scene))
    one, other = (gzip.decompress(path.read_bytes())[header_and_means] for path in (first, second))
    assert one == other


def test_splats_that_fill_up_a_chunk_are_never_drawn(tmp_path: Path) -> None:
    scene = with_floaters((0, 1e5, 0), (0, 1e3, 0))(CLOUD)
    after = io.load(io.save(tmp_path / "scene.compressed.ply", scene))
    shown = after.opacities > 0.0
    assert len(after) == 256 * 13 + 1
    assert np.count_nonzero(~shown) - np.count_nonzero(scene.opacities < 0.5 / 255) == len(after) - len(scene)
