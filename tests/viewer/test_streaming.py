"""A streamed scene in the viewer: shown by its coarsest levels at once, by finer ones as they are read."""

from __future__ import annotations

import gc
import json
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.io.servers import Server
from tests.io.sogs import made_up
from tests.lod.streams import write_stream
from tests.scenes import random_gaussians
from tests.viewer.states import a_state
from tsplat import cli, options
from tsplat._jit import JIT
from tsplat.errors import CorruptFileError, LoadError
from tsplat.io import load
from tsplat.lod import Streamed
from tsplat.scene import Gaussians
from tsplat.viewer.detail import Detail
from tsplat.viewer.picture import Painter
from tsplat.viewer.scenes import scenes_of

pytestmark = pytest.mark.skipif(not JIT, reason="thousands of splats take minutes without a compiler")

N, BUDGET = 3000, 1500
STATE = a_state(on_disk=True, total=N, kept=N, output="half")
HOW = {"max_splats": None, "raw_opacity": False, "spz_frame": "rub", "lod": 0}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_stream(tmp_path, random_gaussians(np.random.default_rng(6), N, 0), 2, 3)


@pytest.fixture
def streamed(path: Path) -> Streamed:
    scene = options.open_scene(str(path), HOW, levels=True)
    assert isinstance(scene, Streamed)
    return scene


def painter(scene: Gaussians | Streamed, budget: int = BUDGET) -> Painter:
    made = Painter(scenes_of(scene))
    made.detail = Detail(scene, budget)
    return made


@pytest.mark.parametrize("budget", [0, BUDGET])
def test_until_the_finest_level_is_read_what_is_there_is_drawn(
    streamed: Streamed, path: Path, budget: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, drawn, read = painter(streamed, budget), threading.Event(), Detail._read
    monkeypatch.setattr(Detail, "_read", lambda detail, scene: drawn.wait(60.0) and read(detail, scene))
    made.warm_up(STATE)
    first = made.draw(STATE)
    assert not first.exact
    assert 0 < first.visible <= len(load(path, lod=2))
    assert made.detail_status(first) == "reading levels 0 %"
    assert made.read == 0.0
    drawn.set()
    made.detail._thread.join(60.0)
    assert made.read == 1.0
    then = made.draw(STATE)
    assert then.exact
    assert made.detail_status(then) == ""
    np.testing.assert_array_equal(then.frame, painter(load(path)).draw(STATE).frame)
    merged = made.draw(STATE, exact=False)
    assert merged.exact == (budget == 0)
    assert first.visible < merged.visible <= max(1.1 * budget, (budget == 0) * N)


def test_a_file_that_turns_out_broken_leaves_what_was_read(streamed: Streamed, path: Path) -> None:
    (path.parent / "0_0.sog").write_bytes(b"PK\x03\x04 no longer a scene")
    made = painter(streamed)
    made.draw(STATE)
    made.detail._thread.join(60.0)
    assert made.read == 1.0
    drawn = made.draw(STATE)
    assert not drawn.exact
    assert drawn.visible > 0
    assert "0_0.sog" in made.detail_status(drawn)
    with pytest.raises(CorruptFileError, match=r"0_0\.sog"):
        made.save(STATE, path.with_name("x.png"))


def test_no_setting_changes_which_splats_of_it_are_drawn(streamed: Streamed) -> None:
    streamed.read_rest()
    made = painter(streamed)
    seen = made.draw(STATE).visible
    assert made.draw(a_state(on_disk=True, total=N, kept=10, raw_opacity=True, output="half")).visible == seen


def test_where_one_level_is_asked_for_that_is_loaded(path: Path) -> None:
    assert len(options.open_scene(str(path), HOW | {"lod": 2}, levels=True)) == len(load(path, lod=2))
    assert len(options.open_scene(str(path), HOW | {"lod": None}, levels=True)) == len(load(path, lod=None))
    for asked in (
        options.open_scene(str(path), HOW),
        options.open_scene(str(path), HOW | {"max_splats": N}, levels=True),
    ):
        assert isinstance(asked, Gaussians)
        assert len(asked) == N


def test_the_viewer_takes_all_levels_unless_one_is_asked_for(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[object] = []
    monkeypatch.setattr("tsplat.viewer.view", lambda scene, *_, **__: seen.append(type(scene)))
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    for options_said in ((), ("--lod", "0"), ("--max-splats", str(N))):
        assert cli.main([str(path), *options_said]) == 0
    assert seen == [Streamed, Gaussians, Gaussians]


def test_a_scene_of_tiny_leaves_is_loaded_as_one_level(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tsplat.lod.is_scattered", lambda _: True)
    assert isinstance(options.open_scene(str(path), HOW, levels=True), Gaussians)


@pytest.fixture
def server(
    path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Server]:
    monkeypatch.setenv("no_proxy", "*")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path_factory.mktemp("temporary")))
    with Server({each.name: each.read_bytes() for each in path.parent.iterdir()}) as running:
        yield running


@pytest.fixture
def afar(server: Server) -> Streamed:
    scene = options.open_scene(server.url("plain", "lod-meta.json?key=1"), HOW, levels=True)
    assert isinstance(scene, Streamed)
    return scene


def test_of_a_url_the_coarsest_levels_come_first_and_the_others_beside_the_frames(
    afar: Streamed, server: Server, path: Path
) -> None:
    assert sorted(server.asked) == ["2_0.sog", "2_1.sog", "lod-meta.json"]
    fractions: list[float] = []
    afar.read_rest(fractions.append)
    assert sorted(server.asked) == sorted(each.name for each in path.parent.iterdir())
    assert server.asked[3:5] in (["1_0.sog", "1_1.sog"], ["1_1.sog", "1_0.sog"])
    assert fractions == sorted(fractions)
    np.testing.assert_array_equal(painter(afar).draw(STATE).frame, painter(load(path)).draw(STATE).frame)


@pytest.mark.parametrize(
    ("content", "problem"),
    [(None, "is not there; check the address"), (b"PK\x03\x04 no scene", "the zip's directory cannot be read")],
)
def test_what_a_url_does_not_have_is_said_in_the_viewer_by_its_address(
    afar: Streamed, server: Server, content: bytes | None, problem: str
) -> None:
    del server.files["0_0.sog"]
    if content:
        server.files["0_0.sog"] = content
    made = painter(afar)
    made.draw(STATE)
    made.detail._thread.join(60.0)
    drawn = made.draw(STATE)
    assert not drawn.exact
    assert made.detail_status(drawn).startswith(f"{server.url('plain', '0_0.sog')}: {problem}")


def test_a_folder_of_fetched_files_goes_with_the_scene(server: Server) -> None:
    scene = options.open_scene(server.url("plain", "lod-meta.json"), HOW, levels=True)
    assert isinstance(scene, Streamed)
    folder = Path(tempfile.gettempdir())
    assert len(list(folder.iterdir())) == 1
    del scene
    gc.collect()
    assert not list(folder.iterdir())


def test_a_url_of_planes_and_of_several_degrees_is_read_as_from_a_file(server: Server, tmp_path: Path) -> None:
    """The first file has fewer harmonics than the second, which loses what is beyond them."""
    coarse, fine = (made_up(np.random.default_rng(seed), bands=bands) for seed, bands in ((3, 1), (2, 3)))
    lods = {"0": {"file": 1, "offset": 0, "count": 5}, "1": {"file": 0, "offset": 0, "count": 2}}
    names = ["a/meta.json", "b/meta.json"]
    server.files = {f"{folder}/{name}": content for folder, scene in (("a", coarse), ("b", fine))
                    for name, content in scene.files().items()}  # fmt: skip
    meta = {"lodLevels": 2, "environment": None, "filenames": names, "tree": {"lods": lods}}
    server.files["lod-meta.json"] = json.dumps(meta).encode()
    scene = options.open_scene(server.url("plain", "lod-meta.json"), HOW, levels=True)
    assert isinstance(scene, Streamed)
    assert scene.sh_degree == 1
    assert not any(name.startswith("b/") for name in server.asked)
    scene.read_rest()
    for name, content in fine.files().items():
        (tmp_path / name).write_bytes(content)
    whole = load(tmp_path / "meta.json")
    expected = Gaussians(*whole.arrays[:4], np.ascontiguousarray(whole.sh[:, :4])).take(np.arange(5))
    np.testing.assert_array_equal(painter(scene).draw(STATE).frame, painter(expected).draw(STATE).frame)


def test_a_url_of_something_else_is_loaded(server: Server, path: Path) -> None:
    made = made_up(np.random.default_rng(1))
    server.files = made.files() | {"x.json": b"[1]", "0_0.sog": (path.parent / "0_0.sog").read_bytes()}
    for name in ("meta.json", "0_0.sog"):
        assert isinstance(options.open_scene(server.url("plain", name), HOW, levels=True), Gaussians)
    with pytest.raises(LoadError, match=r"x\.json: "):
        options.open_scene(server.url("plain", "x.json"), HOW, levels=True)
    with pytest.raises(LoadError, match=r"y\.json: is not there"):
        options.open_scene(server.url("plain", "y.json"), HOW, levels=True)
