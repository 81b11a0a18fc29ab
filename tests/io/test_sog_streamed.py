"""Streamed SOG: the runs of a level out of several scenes, and trees that lie."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.io.outcomes import within_memory
from tests.io.sogs import made_up, write_folder
from tests.scenes import shared_scenes
from tsplat import io
from tsplat.errors import CorruptFileError, LoadError, OptionError, TsplatError
from tsplat.io import sog
from tsplat.io.sog_levels import open_levels


def lods(**runs: tuple[int, int, int]) -> dict[str, Any]:
    keys = "file", "offset", "count"
    return {"bound": {}, "lods": {level[1:]: dict(zip(keys, run, strict=True)) for level, run in runs.items()}}


@pytest.fixture
def tree() -> dict[str, Any]:
    """Return a lod-meta.json of two levels: two leaves have both, one the coarse only, one the fine only."""
    leaves = [
        lods(l0=(0, 0, 3), l1=(1, 0, 2)),
        {"bound": {}, "children": [lods(l0=(2, 1, 4), l1=(1, 3, 1)), lods(l1=(1, 4, 3))]},
        lods(l0=(2, 6, 1)),
    ]
    names = ["a/meta.json", "b/meta.json", "c.sog"]
    return {"lodLevels": 2, "environment": None, "filenames": names, "tree": {"children": leaves}}


@pytest.fixture
def folder(tmp_path: Path, rng: np.random.Generator, tree: dict[str, Any]) -> Path:
    """Return the folder of such a scene; its files have SH degree 0, 1 and 2."""
    write_folder(tmp_path / "a", made_up(rng, bands=0).files())
    write_folder(tmp_path / "b", made_up(rng, bands=1).files())
    (tmp_path / "c.sog").write_bytes(made_up(rng, bands=2).zipped())
    (tmp_path / "sky.sog").write_bytes(made_up(rng, count=5).zipped())
    write_tree(tmp_path, tree)
    return tmp_path


def write_tree(folder: Path, tree: object) -> Path:
    path = folder / "lod-meta.json"
    path.write_text(json.dumps(tree))
    return path


def means(folder: Path, *parts: tuple[str, list[int]]) -> np.ndarray:
    return np.concatenate([io.load(folder / name).means[chosen] for name, chosen in parts])


def test_the_finest_level_is_read_run_by_run(folder: Path) -> None:
    found = io.load(folder / "lod-meta.json")
    # The leaf without a fine level gives its coarse one.
    parts = ("a/meta.json", [0, 1, 2]), ("b/meta.json", [4, 5, 6]), ("c.sog", [1, 2, 3, 4, 6])
    np.testing.assert_array_equal(found.means, means(folder, *parts))


def test_colours_of_lower_degree_are_padded_with_zeros(folder: Path) -> None:
    found = io.load(folder / "lod-meta.json")
    assert found.sh_degree == 2
    assert not found.sh[:3, 1:].any()
    assert not found.sh[3:6, 4:].any()
    np.testing.assert_array_equal(found.sh[6:], io.load(folder / "c.sog").sh[[1, 2, 3, 4, 6]])
    np.testing.assert_array_equal(found.sh[3:6, :4], io.load(folder / "b/meta.json").sh[4:])


def test_a_coarser_level_can_be_chosen(folder: Path) -> None:
    found = io.load(str(folder / "lod-meta.json"), lod=1)
    # The leaf without a coarse level gives its fine one.
    np.testing.assert_array_equal(found.means, means(folder, ("b/meta.json", [0, 1, 3, 4, 5, 6]), ("c.sog", [6])))
    assert len(io.load(folder / "lod-meta.json", lod=1, max_splats=2)) == 2


@pytest.mark.parametrize("level", [-1, 2])
def test_a_level_that_is_not_there_is_refused(folder: Path, level: int) -> None:
    with pytest.raises(OptionError, match=f"lod must be 0 .*, got {level}"):
        io.load(folder / "lod-meta.json", lod=level)


def test_a_level_of_a_missing_file_is_a_load_error(tmp_path: Path) -> None:
    with pytest.raises(LoadError, match="cannot be read: No such file"):
        io.load(tmp_path / "lod-meta.json", lod=0)


def test_a_level_too_large_for_memory_says_how_to_keep_less(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_memory(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(sog, "read_splats", no_memory)
    with pytest.raises(LoadError, match="keep fewer splats"):
        io.load(folder / "lod-meta.json", lod=0)


def test_the_environment_belongs_to_every_level(folder: Path, tree: dict[str, Any]) -> None:
    path = write_tree(folder, {**tree, "environment": "sky.sog"})
    sky = io.load(folder / "sky.sog").means
    for level in (0, 1):
        np.testing.assert_array_equal(io.load(path, lod=level).means[-5:], sky)


def test_progress_grows_to_one_over_all_files(folder: Path) -> None:
    seen: list[float] = []
    io.load(folder / "lod-meta.json", progress=seen.append)
    assert seen == sorted(seen)
    assert len({int(3 * fraction) for fraction in seen}) == 4
    assert seen[-1] == 1.0


def changed(tree: dict[str, Any], leaf: int, level: str, **values: object) -> None:
    tree["tree"]["children"][leaf]["lods"][level].update(values)


def many_large_runs(tree: dict[str, Any]) -> None:
    changed(tree, 0, "0", count=2**26)
    changed(tree, 2, "0", offset=5, count=2**26)


FAULTS: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "no levels": (lambda tree: tree.pop("lodLevels"), "field lodLevels is missing, expected a whole number"),
    "a file outside": (
        lambda tree: tree.update(filenames=["../a/meta.json"] * 3),
        r"field filenames is .*names of files inside",
    ),
    "an environment outside": (
        lambda tree: tree.update(environment="/sky.sog"),
        "field environment is '/sky.sog', expected the name of a file inside",
    ),
    "names that would change a terminal": (
        lambda tree: tree.update(filenames=["\x1b]0;\x07", "b", "c"]),
        r"field filenames is \['\\x1b\]0;\\x07', .*names of files inside",
    ),
    "names that are no list": (lambda tree: tree.update(filenames="abc"), "field filenames is 'abc'"),
    "a file that is missing": (
        lambda tree: tree.update(filenames=["a/meta.json", "b/meta.json", "d/meta.json"]),
        "names 'd/meta.json', which is missing",
    ),
    "a file without a name": (
        lambda tree: changed(tree, 0, "0", file=3),
        r"tree\.\.\.lods\.0\.file is 3, expected",
    ),
    "a negative file": (lambda tree: changed(tree, 0, "0", file=-1), r"lods\.0\.file is -1"),
    "a negative offset": (lambda tree: changed(tree, 0, "0", offset=-1), r"lods\.0\.offset is -1"),
    "a run past the end": (
        lambda tree: changed(tree, 0, "0", count=8),
        "names splat 7 of 'a/meta.json', expected less than 7",
    ),
    "an absurd run": (lambda tree: changed(tree, 0, "0", count=2**60), r"lods\.0\.count is 1152921504606846976"),
    "many large runs": (many_large_runs, "counts 134217735 splats in level 0, expected at most"),
    "runs that overlap": (
        lambda tree: changed(tree, 2, "0", offset=4),
        r"uses splat 4 of 'c\.sog' twice",
    ),
    "one file by two names": (
        lambda tree: tree.update(filenames=["./a/meta.json", "a//meta.json", "a/meta.json"]),
        r"uses splat \d of 'a/meta\.json' twice",
    ),
    "a node that is no object": (lambda tree: tree.update(tree=[1]), r"holds \[1\] in the tree, expected a node"),
    "a leaf of nothing": (lambda tree: tree.update(tree={}), r"field tree\.\.\.lods is missing"),
    "a leaf without levels": (lambda tree: tree.update(tree={"lods": {}}), "has a leaf without levels"),
    "a tree without leaves": (lambda tree: tree.update(tree={"children": []}), "has a tree without leaves"),
    "levels in words": (lambda tree: tree.update(tree={"lods": {"fine": {}}}), "has a leaf without levels"),
    "a tree in a tree": (lambda tree: tree.update(environment="lod-meta.json"), "field means is missing"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_tree_that_lies_is_refused_in_one_line(folder: Path, tree: dict[str, Any], name: str) -> None:
    fault, message = FAULTS[name]
    fault(tree)
    with pytest.raises(CorruptFileError, match=message) as caught:
        io.load(write_tree(folder, tree))
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 300 + len(str(folder))
    with pytest.raises(CorruptFileError, match=message.replace("35 splats in level 0", "38 splats in any level")):
        open_levels(folder / "lod-meta.json")


def test_splats_that_no_bytes_pay_for_are_counted_over_all_files(
    folder: Path, tree: dict[str, Any], rng: np.random.Generator
) -> None:
    scene = made_up(rng)
    scene.meta["count"] = 60_000
    tree["filenames"] = [f"{index}.sog" for index in range(3)]
    for name in tree["filenames"]:
        (folder / name).write_bytes(scene.zipped())
    path = write_tree(folder, tree)
    with pytest.raises(CorruptFileError, match=r"its scenes have \d{6} splats more than their means hold"):
        io.load(path)
    assert within_memory(path, 0) is None


def test_a_deep_tree_needs_no_deep_stack(folder: Path, tree: dict[str, Any]) -> None:
    for _ in range(300):
        tree["tree"] = {"children": [tree["tree"]]}
    assert len(io.load(write_tree(folder, tree))) == 11


def test_a_tree_cut_anywhere_is_refused(folder: Path) -> None:
    path = folder / "lod-meta.json"
    text = path.read_bytes()
    for length in range(len(text)):
        path.write_bytes(text[:length])
        with pytest.raises(LoadError, match=r"lod-meta\.json"):
            io.load(path)


@pytest.mark.filterwarnings("ignore::tsplat.errors.LoadWarning")
def test_mutated_trees_load_or_say_what_is_wrong(folder: Path, rng: np.random.Generator) -> None:
    path = folder / "lod-meta.json"
    text = path.read_bytes()
    messages = []
    for _ in range(400):
        content = bytearray(text)
        for position in rng.integers(0, len(text), 2):
            content[position] = rng.choice(list(b'0123456789-.,[]{}" \xff'))
        path.write_bytes(content)
        try:
            io.load(path)
        except TsplatError as error:
            messages.append(str(error))
        with contextlib.suppress(TsplatError):
            levels = open_levels(path)
            assert sorted(run for leaf in levels.leaves for run in leaf) == list(
                range(sum(map(len, levels.counts)))
            )
            for number, counts in enumerate(levels.counts):
                assert levels.read(number)[1][-1] <= counts.sum()
    assert len(messages) > 100
    assert not any("\n" in message for message in messages)


def test_a_splat_of_two_levels_is_refused_only_where_both_are_read(folder: Path, tree: dict[str, Any]) -> None:
    changed(tree, 0, "1", file=0, offset=2, count=3)
    path = write_tree(folder, tree)
    assert len(io.load(path)) == 11
    with pytest.raises(CorruptFileError, match=r"uses splat 2 of 'a/meta\.json' twice"):
        open_levels(path)


def test_levels_are_the_runs_of_the_files_leaf_by_leaf(folder: Path, tree: dict[str, Any]) -> None:
    levels = open_levels(write_tree(folder, {**tree, "environment": "sky.sog"}))
    assert [piece.name for piece in levels.files.pieces] == ["a/meta.json", "b/meta.json", "c.sog", "sky.sog"]
    assert [counts.tolist() for counts in levels.counts] == [[3], [2, 1, 3], [4, 1], [5]]
    # The leaf of the finer level only, the two that are children of one, the one of both, and the sky.
    assert sorted(levels.leaves) == [[1, 0], [2, 4], [3], [5], [6]]
    splats, ends = levels.read(2)
    assert ends.tolist() == [0, 4, 5]
    np.testing.assert_array_equal(splats.means[:5], means(folder, ("c.sog", [1, 2, 3, 4, 6])))
    assert (len(splats.means), levels.coefficients) == (6, 9)
    assert splats.opacities[5] == 0.0


SCENES = shared_scenes()


@pytest.mark.skipif(SCENES is None, reason="no folder of real scenes: set TSPLAT_SCENES or have ../shared/scenes")
def test_a_real_streamed_scene_has_its_levels() -> None:
    assert SCENES is not None
    path = SCENES / "playbot" / "lod-meta.json"
    finest, ply = io.load(path), io.load(SCENES / "ply" / "playbot_500k_sh2.ply")
    # The PLY was made from this level, so they agree to the last bits of float32.
    for name in ("means", "quats", "scales", "opacities", "sh"):
        np.testing.assert_allclose(getattr(finest, name), getattr(ply, name), 1e-5, 2e-6, err_msg=name)
    counts = [len(io.load(path, lod=level)) for level in range(3, 7)]
    assert counts == [31_000, 8_406, 3_000, 1_873]
