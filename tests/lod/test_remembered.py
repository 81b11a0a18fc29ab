"""Hierarchies are built once for a content, not for a run; whatever is wrong with the cache, they are built."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.raster.compare import front_camera
from tests.scenes import random_gaussians
from tsplat import kept
from tsplat._jit import JIT
from tsplat.lod import hierarchy, rasterize_within, remembered
from tsplat.lod.remembered import keep, name_of, recall
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

pytestmark = pytest.mark.skipif(not JIT, reason="thousands of splats take minutes without a compiler")

N = 3000


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "folder", lambda: tmp_path / "tsplat" / "hierarchies")
    monkeypatch.setattr(remembered, "KEPT_FROM", N)


def a_scene(seed: int = 0, n: int = N) -> Gaussians:
    return random_gaussians(np.random.default_rng(seed), n, 1)


def test_another_run_draws_with_what_was_kept_as_with_what_was_built() -> None:
    scene, again = a_scene(), a_scene()
    keep(scene, hierarchy(scene, 1))
    earlier = recall(again)
    assert earlier is not None
    assert hierarchy(again, 1, earlier=earlier) is earlier
    options, camera = RenderOptions(depths=False), front_camera()
    ours, theirs = (rasterize_within(each, camera, options, 700) for each in (again, scene))
    np.testing.assert_array_equal(ours.colors, theirs.colors)


def test_a_scene_with_any_other_value_is_another() -> None:
    scene = a_scene()
    seen = {name_of(scene), name_of(replace(scene, antialiased=True))}
    for name in ("means", "quats", "scales", "opacities", "sh"):
        array = getattr(scene, name).copy()
        array.flat[-1] *= np.float32(0.999)
        seen.add(name_of(replace(scene, **{name: array})))
    assert len(seen) == 7
    assert name_of(a_scene()) in seen


def test_another_way_to_merge_makes_another_name(monkeypatch: pytest.MonkeyPatch) -> None:
    before = name_of(a_scene())
    monkeypatch.setattr(remembered, "source_digest", lambda _: "other")
    assert name_of(a_scene()) != before


def test_small_scenes_are_not_kept() -> None:
    small = a_scene(n=N - 1)
    keep(small, hierarchy(small, 1))
    assert kept.entries() == []
    assert recall(small) is None


@pytest.mark.parametrize("damage", [b"", b"x", b"TSPLAT\r\n" + bytes(100)])
def test_a_broken_file_is_as_good_as_none(damage: bytes) -> None:
    scene = a_scene()
    keep(scene, hierarchy(scene, 1))
    kept.entries()[0].path.write_bytes(damage)
    assert recall(scene) is None


def test_the_file_of_another_scene_is_as_good_as_none() -> None:
    scene, other = a_scene(), a_scene(1, N + 300)
    keep(other, hierarchy(other, 1))
    kept.entries()[0].path.rename(kept.folder() / f"{name_of(scene)}.tsplat")
    assert recall(scene) is None


def test_the_room_that_is_made_is_what_the_file_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = a_scene()
    keep(scene, hierarchy(scene, 1))
    size = kept.entries()[0].nbytes
    asked: list[int] = []
    monkeypatch.setattr(kept, "keep", lambda name, nbytes, write: asked.append(nbytes))  # noqa: ARG005
    keep(scene, hierarchy(scene, 1))
    assert 0 <= size - asked[0] < 4096 * 18
