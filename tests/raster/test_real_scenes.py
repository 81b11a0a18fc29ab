"""Every real scene, from outside, inside and behind, against the reference."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.raster.compare import assert_like_reference
from tests.scenes import shared_scenes
from tsplat.camera import Camera
from tsplat.framing import bulk
from tsplat.io import demo_path, load
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

FOLDER = shared_scenes()
SHARED = [
    "ply/playbot_500k_sh2.ply",
    "ply/plant.ply",
    "ply/academic_tarot_cards.ply",
    "snowmiku/trained/snow_sh3_3000.ply",
    "format_matrix/yashica.ply",
]
SCENES = [demo_path(), *(FOLDER / name for name in SHARED if FOLDER)]


@pytest.fixture(scope="module")
def scene(request: pytest.FixtureRequest) -> Gaussians:
    return load(request.param)


@pytest.mark.parametrize("view", ["outside", "inside", "behind"])
@pytest.mark.parametrize("scene", SCENES, indirect=True, ids=lambda path: Path(path).stem)
def test_a_real_scene_matches_the_reference(scene: Gaussians, view: str) -> None:
    middle = bulk(scene)
    side = {"outside": -2.0, "inside": -0.2, "behind": 2.0}[view]
    eye = np.asarray(middle.center) + middle.radius * np.array([0.4, -0.3, side])
    # The reference blends every splat into every pixel: a small image is all that a test can wait for.
    width, height = (28, 20) if len(scene) > 60_000 else (60, 44)
    camera = Camera.look_at(eye, middle.center, (0, -1, 0), width=width, height=height, fov_y=55.0)
    assert_like_reference(scene, camera, RenderOptions())
