"""The contract of a backend: options that can be drawn with, and pictures that can be kept."""

from __future__ import annotations

import os
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import tsplat
from tests.raster.compare import front_camera
from tests.scenes import random_gaussians
from tsplat import images
from tsplat.errors import OptionError, SaveError, TsplatError
from tsplat.processors import FEW, available_processors
from tsplat.rendering import BOX_VARIANCE, EPS2D, SOFTENING, Rendering, RenderOptions
from tsplat.train_views import TrainViews


@pytest.mark.parametrize(
    "wrong",
    [
        {"sh_degree": 5},
        {"sh_degree": -1},
        {"antialias": "best"},
        {"background": (0, 0)},
        {"background": (0, 0, float("nan"))},
        {"background": "black"},
        {"sh_degree": 2.5},
        {"threads": -1},
        {"threads": "2"},
        {"memory": -1},
        {"memory": 1e9},
        {"train_views": (1, 2)},
        {"eps2d": None},
        {"near_plane": "near"},
        {"antialias": ["mip"]},
        {"train_focal": 0.0},
        {"train_focal": 1e-200},
        {"near_plane": 0.0},
        {"near_plane": 2.0, "far_plane": 1.0},
        {"eps2d": -0.1},
        {"alpha_min": 0.0},
        {"sigma_extent": 0.0},
    ],
)
def test_an_impossible_option_is_refused_by_name(wrong: dict[str, object]) -> None:
    with pytest.raises(OptionError, match=next(iter(wrong))):
        RenderOptions(**wrong)


def test_options_of_numpys_types_are_those_of_pythons() -> None:
    options = RenderOptions(
        sh_degree=np.int64(2), threads=np.uint8(3), eps2d=np.float32(0.5), background=np.ones(3)
    )
    assert options == RenderOptions(sh_degree=2, threads=3, eps2d=0.5, background=(1.0, 1.0, 1.0))
    assert [type(value) for value in (options.sh_degree, options.threads, options.eps2d)] == [int, int, float]


def test_what_is_no_scene_no_camera_or_no_option_is_refused_in_one_line() -> None:
    scene, camera = random_gaussians(np.random.default_rng(0), 3), front_camera()
    for args, options, expected in (
        (("garden.ply", camera), {}, "garden.ply"),
        ((None, camera), {}, "None"),
        ((scene, np.eye(4)), {}, "camera must be a tsplat.Camera, got"),
        ((scene, camera), {"sh_degre": 2}, "there is no option 'sh_degre'"),
        ((scene, camera), {"lod": "all"}, "lod must be a whole number, 1 or more, got 'all'"),
    ):
        with pytest.raises(TsplatError, match=expected):
            tsplat.render(*args, **options)


def test_relative_dilates_with_the_image_and_adds_the_box_it_grew_by() -> None:
    half = RenderOptions(antialias="relative", train_focal=200.0).filter2d(100.0)
    assert half == pytest.approx((EPS2D / 4 + 0.75 * BOX_VARIANCE, EPS2D / 4))
    assert RenderOptions(antialias="relative", train_focal=200.0).filter2d(200.0) == (EPS2D, EPS2D)
    double = RenderOptions(antialias="relative", train_focal=200.0).filter2d(400.0)
    assert double == pytest.approx((4 * EPS2D, 4 * EPS2D))


def test_near_splats_gain_of_the_dilation_alone_and_where_cameras_are_known() -> None:
    views = TrainViews.of([front_camera()])
    relative = RenderOptions(antialias="relative", train_focal=200.0, train_views=views)
    assert relative.near_blur(100.0) == pytest.approx(EPS2D / 4)
    assert replace(relative, train_views=None).near_blur(100.0) == 0.0
    assert {replace(relative, antialias=mode).near_blur(100.0) for mode in ("classic", "mip")} == {0.0}


def test_relative_softens_images_as_far_as_they_are_smaller_and_no_other_mode_does() -> None:
    relative = RenderOptions(antialias="relative", train_focal=200.0)
    assert [relative.softening(focal) for focal in (100.0, 200.0, 400.0)] == [0.75**0.5 * SOFTENING, 0.0, 0.0]
    assert {RenderOptions(antialias=mode).softening(1.0) for mode in ("classic", "mip")} == {0.0}


def test_classic_keeps_opacities_and_mip_compensates_for_all_it_adds() -> None:
    assert RenderOptions(antialias="classic").filter2d(7.0) == (EPS2D, EPS2D)
    assert RenderOptions(antialias="mip").filter2d(7.0) == (EPS2D, 0.0)


def test_the_library_draws_as_the_readme_says(tmp_path: Path) -> None:
    scene = random_gaussians(np.random.default_rng(0), 50)
    image = tsplat.render(scene, front_camera(), sh_degree=3, antialias="classic", background=(0, 0, 0), threads=2)
    assert image.depths is not None
    assert (image.colors.shape, image.alphas.shape, image.depths.shape) == ((48, 64, 3), (48, 64), (48, 64))
    assert image.colors.dtype == image.alphas.dtype == image.depths.dtype == np.float32
    assert list(image.stage_ms) == ["project", "sort", "bin", "composite"]
    with Image.open(image.save(tmp_path / "garden.png")) as saved:
        np.testing.assert_array_equal(np.asarray(saved), image.frame())


def test_frames_round_to_nearest_and_clamp() -> None:
    colors = np.array([[[-1.0, 0.0, 0.4999 / 255], [0.5001 / 255, 1.0, 7.0]]], np.float32)
    frame = Rendering(colors, np.ones((1, 2), np.float32)).frame()
    np.testing.assert_array_equal(frame, [[[0, 0, 0], [1, 255, 255]]])


@pytest.mark.parametrize("suffix", [".png", ".webp", ".PNG"])
def test_lossless_pictures_come_back_as_they_were(tmp_path: Path, suffix: str) -> None:
    colors = np.random.default_rng(0).random((5, 7, 3), np.float32)
    images.save(tmp_path / f"a{suffix}", colors, np.ones((5, 7), np.float32))
    with Image.open(tmp_path / f"a{suffix}") as saved:
        np.testing.assert_array_equal(np.asarray(saved.convert("RGB")), images.quantize(colors))


def test_npy_holds_colour_and_alpha_unquantised(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    colors, alphas = rng.random((5, 7, 3), np.float32), rng.random((5, 7), np.float32)
    saved = np.load(images.save(tmp_path / "a.npy", colors, alphas))
    assert saved.dtype == np.float32
    np.testing.assert_array_equal(saved, np.dstack([colors, alphas]))


def test_what_cannot_be_written_leaves_nothing_behind(tmp_path: Path) -> None:
    picture = np.zeros((2, 2, 3), np.float32), np.zeros((2, 2), np.float32)
    with pytest.raises(SaveError, match="suffix"):
        images.save(tmp_path / "a.bmp", *picture)
    with pytest.raises(SaveError, match="cannot be written"):
        images.save(tmp_path / "missing" / "a.png", *picture)
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(SaveError, match="cannot be written"):
        images.save(tmp_path / "folder.png", *picture)
    assert os.listdir(tmp_path) == ["folder.png"]


def test_a_written_picture_has_the_rights_of_any_new_file(tmp_path: Path) -> None:
    (tmp_path / "plain").touch()
    images.save(tmp_path / "a.png", np.zeros((2, 2, 3), np.float32), np.zeros((2, 2), np.float32))
    assert (tmp_path / "a.png").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_more_threads_than_are_of_use_are_not_started() -> None:
    assert RenderOptions(threads=0).worker_count == available_processors()
    assert [RenderOptions(threads=number).worker_count for number in (1, 2, FEW)] == [1, 2, FEW]
    assert RenderOptions(threads=1024).worker_count == min(1024, max(available_processors(), FEW))


@pytest.mark.usefixtures("compiled")
def test_a_thousand_threads_draw_the_same_picture() -> None:
    scene = random_gaussians(np.random.default_rng(0), 500, sh_degree=1)
    pictures = [tsplat.render(scene, front_camera(), threads=threads).colors for threads in (1, 1024)]
    np.testing.assert_array_equal(*pictures)
    assert threading.active_count() < available_processors() + FEW + 10
