"""A scene on disk whose file changes while it is shown: the picture stays, and a key loads it again."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from tests.io.tsplats import small
from tests.scenes import random_gaussians
from tests.viewer.states import a_state
from tests.viewer.test_loop import FakePainter, FakeTerminal
from tsplat import kept
from tsplat.errors import CorruptFileError
from tsplat.io.tsplat_map import Mapped, open_mapped
from tsplat.lod import hierarchy, open_stored, remembered
from tsplat.terminal.keys import Event, Key
from tsplat.viewer.detail import Detail
from tsplat.viewer.file_watch import CHANGED, LOOK_SECONDS, FileWatch
from tsplat.viewer.loop import Viewer
from tsplat.viewer.picture import Drawn, Painter
from tsplat.viewer.scenes import scenes_of
from tsplat.viewer.state import Loaded, ViewerState


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "x.tsplat"
    path.write_bytes(small())
    return path


def test_each_change_of_a_file_is_told_once(path: Path) -> None:
    watch = FileWatch(open_mapped(path))
    times = (LOOK_SECONDS * number for number in range(1, 100))
    assert not watch.changed(next(times))
    path.with_name("other").write_bytes(small(6))
    path.with_name("other").replace(path)
    assert watch.changed(next(times))
    assert not watch.changed(next(times))
    os.truncate(path, 100)
    assert watch.changed(next(times))
    path.unlink()
    assert not watch.changed(next(times)), "what is shown is all there is, and nothing can be loaded"
    path.write_bytes(small())
    assert watch.changed(next(times))


def test_nobody_looks_more_often_than_once_a_second(path: Path) -> None:
    watch = FileWatch(open_mapped(path))
    assert watch.left(5.0) == 0
    assert not watch.changed(5.0)
    assert watch.left(5.25) == pytest.approx(LOOK_SECONDS - 0.25)
    os.truncate(path, 100)
    assert not watch.changed(5.5)
    assert watch.changed(5.0 + LOOK_SECONDS)
    assert FileWatch(None).left(5.0) == float("inf")
    assert not FileWatch(None).changed(5.0)


class ChangingPainter(FakePainter):
    """Draws once; then its file has become shorter, until it is loaded again."""

    broken = False

    def __init__(self, mapped: Mapped) -> None:
        super().__init__()
        self.mapped, self.loads = mapped, 0

    @property
    def file(self) -> Mapped:  # type: ignore[override]
        return self.mapped

    def draw(self, state: ViewerState, density: float = 1.0, *, exact: bool = True) -> Drawn:
        if self.broken:
            raise CorruptFileError("x", "ends")
        self.broken = True
        return super().draw(state, density, exact=exact)

    def reload(self) -> Loaded:
        self.broken, self.loads = False, self.loads + 1
        if self.loads == 1:
            raise CorruptFileError("x.tsplat", "ends in a header")
        return Loaded(77, 2)


def test_a_file_that_became_shorter_leaves_the_picture_and_a_key_loads_it_again(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tsplat.viewer.file_watch.LOOK_SECONDS", 1e6)
    reload: list[Event] = [Key("ctrl+r")]
    terminal, painter = FakeTerminal([Key("j")], reload, [Key("x")], reload), ChangingPainter(open_mapped(path))
    viewer = Viewer(terminal, painter, a_state(on_disk=True), "tsplat-x", path.parent)
    viewer.run()
    shown = b"".join(terminal.written)
    lines = [CHANGED.encode(), b" ends in a header ", b"loaded again"]
    assert [shown.index(line) for line in lines] == sorted(shown.index(line) for line in lines)
    assert painter.loads == 2
    assert (viewer.state.total, viewer.state.scene_degree) == (77, 2)
    assert b"\x1b[2J" in terminal.written[-1]


def test_a_file_that_is_broken_before_the_first_frame_ends_the_viewer(path: Path) -> None:
    painter = ChangingPainter(open_mapped(path))
    painter.broken = True
    with pytest.raises(CorruptFileError):
        Viewer(FakeTerminal(), painter, a_state(on_disk=True), "tsplat-x", path.parent).run()


def test_a_change_is_noticed_while_nothing_moves(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tsplat.viewer.file_watch.LOOK_SECONDS", 0.05)

    class Replacing(FakeTerminal):
        def events(self, timeout: float) -> list[Event]:
            assert timeout <= 0.05
            if self.written and not self.asked:
                path.with_name("other").write_bytes(small(6))
                path.with_name("other").replace(path)
            if CHANGED.encode() in b"".join(self.written):
                return [Key("q")]
            self.asked = 0
            return super().events(min(timeout, 0.05))

    terminal = Replacing()
    Viewer(terminal, ChangingPainter(open_mapped(path)), a_state(on_disk=True), "tsplat-x", path.parent).run()
    assert CHANGED.encode() in b"".join(terminal.written)


def test_without_a_file_the_key_does_nothing(tmp_path: Path) -> None:
    terminal = FakeTerminal([Key("ctrl+r")])
    Viewer(terminal, FakePainter(), a_state(), "tsplat-x", tmp_path).run()
    assert len(terminal.written) == 1


def test_a_scene_that_is_loaded_again_is_the_one_that_is_there_now(path: Path) -> None:
    stored = open_stored(path)
    painter = Painter(scenes_of(stored))
    painter.detail = Detail(stored, 300)
    path.write_bytes(small(9, 0))
    assert painter.reload() == Loaded(9, 0)
    assert painter.file is not stored.mapped
    assert painter.detail.scene is painter.scenes.loaded
    assert painter.detail._budget == 300


def test_levels_that_were_kept_and_became_shorter_are_done_without(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept, "folder", lambda: tmp_path)
    monkeypatch.setattr(remembered, "KEPT_FROM", 1000)
    scene, again = (random_gaussians(np.random.default_rng(6), 1000, 0) for _ in range(2))
    remembered.keep(scene, hierarchy(scene, 1))
    painter = Painter(scenes_of(again))
    painter.detail = Detail(again, 300)
    state = a_state(total=1000, kept=1000, output="half")
    painter.draw(state)
    painter.detail._thread.join(60.0)
    assert not painter.draw(state, exact=False).exact
    (entry,) = kept.entries()
    os.truncate(entry.path, 5000)
    for _ in range(2):
        drawn = painter.draw(state, exact=False)
        assert drawn.exact or drawn.visible > 500
        assert painter.detail_status(drawn) in ("", "merged")
