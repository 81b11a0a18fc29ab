"""Scenes on disk in the viewer, and levels of detail that an earlier run built."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from tests.scenes import random_gaussians
from tests.viewer.states import a_state
from tsplat import kept
from tsplat._jit import JIT
from tsplat.files import replacing
from tsplat.io import load
from tsplat.lod import Stored, hierarchy, open_stored, remembered, store
from tsplat.scene import Gaussians
from tsplat.viewer.detail import Detail
from tsplat.viewer.picture import Painter, view_camera
from tsplat.viewer.scenes import scenes_of
from tsplat.viewer.state import ViewerState

pytestmark = pytest.mark.skipif(not JIT, reason="merging takes long without a compiler")

N, BUDGET = 4000, 600
STATE = a_state(on_disk=True, total=N, kept=N, output="half")


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "folder", lambda: tmp_path / "tsplat" / "hierarchies")
    monkeypatch.setattr(remembered, "KEPT_FROM", N)


@pytest.fixture
def scene() -> Gaussians:
    return random_gaussians(np.random.default_rng(6), N, 1)


@pytest.fixture
def stored(tmp_path: Path, scene: Gaussians) -> Stored:
    with replacing(tmp_path / "x.tsplat") as file:
        store(file, scene, 1, lambda _: None)
    return open_stored(str(tmp_path / "x.tsplat"))


def painter(scene: Gaussians | Stored) -> Painter:
    made = Painter(scenes_of(scene))
    made.detail = Detail(scene, BUDGET)
    return made


def drawn_merged(made: Painter, state: ViewerState) -> bool:
    return not made.draw(state, exact=False).exact


def until(met: Callable[[], bool], made: Painter) -> None:
    made.detail._thread.join(60.0)
    assert met()


def test_a_scene_on_disk_is_merged_from_the_first_frame_on(stored: Stored) -> None:
    made = painter(stored)
    made.warm_up(STATE)
    assert drawn_merged(made, STATE)
    assert made.draw(STATE, exact=False).visible <= BUDGET
    assert made.detail._thread.ident is None


def test_at_rest_a_scene_on_disk_is_the_scene_that_is_loaded(stored: Stored, tmp_path: Path) -> None:
    ours, theirs = painter(stored), painter(load(tmp_path / "x.tsplat"))
    np.testing.assert_array_equal(ours.draw(STATE).frame, theirs.draw(STATE).frame)
    assert ours.draw(STATE).exact


def test_no_setting_changes_which_splats_of_a_scene_on_disk_are_drawn(stored: Stored) -> None:
    made = painter(stored)
    seen = made.draw(STATE).visible
    assert made.draw(a_state(on_disk=True, total=N, kept=10, raw_opacity=True, output="half")).visible == seen


def test_a_scene_on_disk_within_the_budget_is_not_merged(stored: Stored) -> None:
    made = painter(stored)
    made.detail = Detail(stored, N)
    assert not drawn_merged(made, STATE)


def test_a_picture_of_a_scene_on_disk_is_saved(stored: Stored, tmp_path: Path) -> None:
    assert painter(stored).save(STATE, tmp_path / "x.png").stat().st_size > 1000


def test_what_was_built_is_kept_for_the_next_time(scene: Gaussians, monkeypatch: pytest.MonkeyPatch) -> None:
    first = painter(scene)
    assert not drawn_merged(first, STATE)
    until(lambda: drawn_merged(first, STATE), first)
    assert len(kept.entries()) == 1
    again = random_gaussians(np.random.default_rng(6), N, 1)
    monkeypatch.setattr(
        import_module("tsplat.lod.hierarchy"), "build", lambda *_: pytest.fail("it was built again")
    )
    second = painter(again)
    second.draw(STATE, exact=False)
    until(lambda: drawn_merged(second, STATE), second)
    camera = view_camera(STATE, 64, 48)
    ours, theirs = (made.detail.draw(camera, STATE.options) for made in (second, first))
    np.testing.assert_array_equal(ours.colors, theirs.colors)
    assert len(kept.entries()) == 1


def test_a_cache_that_cannot_be_written_keeps_nobody_from_merging(scene: Gaussians, tmp_path: Path) -> None:
    (tmp_path / "tsplat").write_text("in the way")
    made = painter(scene)
    made.draw(STATE, exact=False)
    until(lambda: drawn_merged(made, STATE), made)
    assert len(hierarchy(scene, 1).blocks) > 1
