from __future__ import annotations

import numpy as np
import pytest

from tests.scenes import random_gaussians
from tsplat.bench.views import VIEWS, View, camera_path
from tsplat.framing import bulk
from tsplat.scene import Gaussians

SIZE = 120, 80


@pytest.fixture(scope="module")
def cloud() -> Gaussians:
    return random_gaussians(np.random.default_rng(5), 2000)


def share_in_frame(gaussians: Gaussians, view: View) -> float:
    camera = view.camera
    x, y, z = (gaussians.means @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]).T
    u, v = camera.K[0, 0] * x / z + camera.K[0, 2], camera.K[1, 1] * y / z + camera.K[1, 2]
    inside = (z > 0) & (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    return float(inside.mean())


def test_the_path_is_the_same_each_time(cloud: Gaussians) -> None:
    one, other = camera_path(cloud, *SIZE), camera_path(cloud, *SIZE)
    assert [view.name for view in one] == [view.name for view in other]
    assert all(np.array_equal(a.camera.viewmat, b.camera.viewmat) for a, b in zip(one, other, strict=True))


def test_views_have_their_own_names_and_places(cloud: Gaussians) -> None:
    path = camera_path(cloud, *SIZE)
    assert len({view.name for view in path}) == len({tuple(view.camera.eye.round(3)) for view in path}) == VIEWS


def test_from_outside_the_scene_is_whole_and_fills_the_frame(cloud: Gaussians) -> None:
    middle = bulk(cloud)
    for view in camera_path(cloud, *SIZE)[: VIEWS // 2]:
        distance = np.linalg.norm(view.camera.eye - middle.center)
        assert share_in_frame(cloud, view) > 0.9
        assert middle.radius < distance < 4.0 * middle.radius


def test_from_inside_there_is_something_to_see_and_something_behind(cloud: Gaussians) -> None:
    middle = bulk(cloud)
    for view in camera_path(cloud, *SIZE)[VIEWS // 2 :]:
        assert np.linalg.norm(view.camera.eye - middle.center) < 0.5 * middle.radius
        assert 0.1 < share_in_frame(cloud, view) < 0.9


def test_an_empty_scene_has_a_path() -> None:
    assert len(camera_path(random_gaussians(np.random.default_rng(0), 0), *SIZE)) == VIEWS
