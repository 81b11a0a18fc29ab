"""Scenes trained with antialiasing say so, and stay so."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tsplat
from tests.io.plys import one_splat, ply_bytes, splats
from tests.io.sogs import made_up
from tests.raster.compare import front_camera
from tests.scenes import random_gaussians
from tsplat import io
from tsplat.rendering import RenderOptions


@pytest.mark.parametrize(
    ("comments", "antialiased"),
    [
        ([], False),
        (["SplatRenderMode: mip"], True),
        (["SplatRenderMode: default"], False),
        (["antialiased 1"], True),
        (["antialiased 0"], False),
        (["antialiased 0", "SplatRenderMode: mip"], True),
        (["SplatRenderMode: mip", "antialiased 0"], False),
        (["made by someone who likes antialiased 1", "SplatRenderMode:"], False),
    ],
)
def test_the_last_comment_of_a_ply_that_speaks_of_it_decides(
    tmp_path: Path, comments: list[str], antialiased: bool
) -> None:
    lines = "".join(f"comment {comment}\n" for comment in comments).encode()
    path = tmp_path / "scene.ply"
    path.write_bytes(ply_bytes([splats([one_splat()])]).replace(b"element", lines + b"element", 1))
    assert io.load(path).antialiased is antialiased


@pytest.mark.parametrize("suffix", [".ply", ".compressed.ply", ".spz"])
@pytest.mark.parametrize("antialiased", [False, True])
def test_saving_keeps_it(tmp_path: Path, rng: np.random.Generator, suffix: str, antialiased: bool) -> None:
    scene = replace(random_gaussians(rng, 20), antialiased=antialiased)
    assert io.load(io.save(tmp_path / f"scene{suffix}", scene)).antialiased is antialiased


@pytest.mark.parametrize(("model", "antialiased"), [("antialiased", True), ("default", False)])
def test_the_model_of_a_sog_says_it(
    tmp_path: Path, rng: np.random.Generator, model: str, antialiased: bool
) -> None:
    scene = made_up(rng)
    scene.meta["model"] = model
    path = tmp_path / "scene.sog"
    path.write_bytes(scene.zipped())
    assert io.load(path).antialiased is antialiased


def test_some_of_its_splats_are_as_antialiased_as_all(rng: np.random.Generator) -> None:
    scene = replace(random_gaussians(rng, 20), antialiased=True)
    assert scene.take([3, 4]).antialiased


def test_it_is_drawn_compensated_where_nobody_asks_for_something_else(rng: np.random.Generator) -> None:
    scene, camera = replace(random_gaussians(rng, 20), antialiased=True), front_camera(40, 30)
    default, mip, classic = (
        tsplat.render(scene, camera, **how).colors for how in ({}, {"antialias": "mip"}, {"antialias": "classic"})
    )
    np.testing.assert_array_equal(default, mip)
    assert not np.array_equal(default, classic)
    assert RenderOptions().antialias == "classic"
