"""`tsplat convert` through the command line's own parser."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.io.sogs import made_up, write_folder
from tests.scenes import random_gaussians
from tsplat import cli, edit, progress
from tsplat.errors import SaveWarning
from tsplat.io import load, save
from tsplat.io.formats import FORMATS
from tsplat.lod import decimate
from tsplat.scene import Gaussians


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    edit.remove_floaters(random_gaussians(np.random.default_rng(0), 9))
    decimate(random_gaussians(np.random.default_rng(0), 9), 4)


@pytest.fixture(scope="module")
def cloud() -> Gaussians:
    return random_gaussians(np.random.default_rng(3), 300, sh_degree=1)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory, cloud: Gaussians) -> Path:
    return save(tmp_path_factory.mktemp("scene") / "cloud.ply", cloud)


def convert(*args: object) -> int:
    return cli.main(["convert", *map(str, args)])


def converted(*args: object) -> Gaussians:
    """Run what must succeed; return the scene written, which is the last argument."""
    assert convert(*args) == 0
    return load(Path(str(args[-1])))


def account(capsys: pytest.CaptureFixture[str], *args: object) -> dict[str, Any]:
    capsys.readouterr()
    assert convert(*args, "--json") == 0
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    return document


def assert_alike(one: Gaussians, other: Gaussians) -> None:
    assert one.antialiased == other.antialiased
    for array, twin in zip(one.arrays, other.arrays, strict=True):
        np.testing.assert_allclose(array, twin, atol=2e-6)


@pytest.mark.parametrize(
    "suffix", [suffix for known in FORMATS if known.write for suffix in known.suffixes if suffix != ".json"]
)
def test_every_format_that_can_be_written_is_what_save_writes(
    scene: Path, cloud: Gaussians, tmp_path: Path, suffix: str
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SaveWarning)  # of colours that change with the view, by .splat
        saved = save(tmp_path / f"saved{suffix}", cloud)
    assert_alike(converted(scene, tmp_path / f"x{suffix}"), load(saved))


EDITS: dict[str, Callable[[Gaussians], Gaussians]] = {
    "--crop-box -0.5,-0.4,-1,0.6,0.3,1": lambda scene: edit.crop_box(scene, (-0.5, -0.4, -1), (0.6, 0.3, 1)),
    "--crop-sphere 0.1,0.2,0.3,0.5": lambda scene: edit.crop_sphere(scene, (0.1, 0.2, 0.3), 0.5),
    "--min-opacity 0.4": lambda scene: edit.drop_faint(scene, 0.4),
    "--max-scale 0.1": lambda scene: edit.drop_large(scene, 0.1),
    "--remove-floaters": lambda scene: edit.remove_floaters(scene),
    "--remove-floaters 0.5": lambda scene: edit.remove_floaters(scene, 0.5),
    "--decimate 70": lambda scene: decimate(scene, 70),
    "--decimate 25%": lambda scene: decimate(scene, 75),
    "--sh-degree 0": lambda scene: edit.lower_sh_degree(scene, 0),
    "--rotate 10,-20,30": lambda scene: edit.rotate(scene, (10, -20, 30)),
    "--translate 1,2,-3": lambda scene: edit.translate(scene, (1, 2, -3)),
    "--scale 2.5": lambda scene: edit.scale(scene, 2.5),
    "--max-splats 20": lambda scene: edit.keep_most_important(scene, 20),
}


@pytest.mark.parametrize("option", EDITS)
def test_an_option_does_what_its_function_does(scene: Path, tmp_path: Path, option: str) -> None:
    before = load(scene)
    wanted = EDITS[option](before)
    assert len(wanted) < len(before) or wanted is not before
    assert_alike(converted(scene, *option.split(" "), tmp_path / "x.ply"), wanted)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (["--translate", 1, 2, -3], ["--translate=1,2,-3"]),
        (["--crop-box", -0.5, -0.4, -1, 0.6, 0.3, 1], ["--crop-box", "-0.5,-0.4,-1,0.6,0.3,1"]),
        (["--crop-box", "-0.5 -0.4 -1 0.6 0.3 1"], ["--crop-box=0.6,0.3,1,-0.5,-0.4,-1"]),
        (["--remove-floaters"], ["--remove-floaters=2"]),
        (["--remove-floaters", "--scale", 2], ["--scale", 2, "--remove-floaters", 2]),
    ],
)
def test_numbers_can_be_written_in_several_ways(
    scene: Path, tmp_path: Path, one: list[object], other: list[object]
) -> None:
    assert_alike(converted(scene, *one, tmp_path / "1.ply"), converted(scene, *other, tmp_path / "2.ply"))


@pytest.mark.parametrize(
    ("amount", "of_300"), [("1", 1), ("300", 300), ("999", 300), ("0.01%", 1), ("12.5%", 38), ("100%", 300)]
)
def test_so_many_splats_are_left_as_were_asked_for(scene: Path, tmp_path: Path, amount: str, of_300: int) -> None:
    assert len(converted(scene, "--decimate", amount, tmp_path / "x.ply")) == of_300


def test_edits_are_made_in_the_order_in_which_they_are_given(
    capsys: pytest.CaptureFixture[str], scene: Path, tmp_path: Path
) -> None:
    before, out = load(scene), tmp_path / "x.ply"
    given = [
        "--max-scale 1000000",
        "--translate 1.125,0,0",
        "--rotate 0,0,90",
        "--translate 0,0,2",
        "--crop-sphere 0,1.125,2,0.5",
    ]
    words = [word for option in given for word in option.split()]
    document = account(capsys, *words[:2], scene, *words[2:], out)
    wanted = edit.rotate(edit.translate(before, (1.125, 0, 0)), (0, 0, 90))
    wanted = edit.crop_sphere(edit.translate(wanted, (0, 0, 2)), (0, 1.125, 2), 0.5)
    assert 0 < len(wanted) < 300
    assert_alike(load(out), wanted)
    assert [step["edit"] for step in document["edits"]] == given


def test_several_scenes_become_one(scene: Path, tmp_path: Path) -> None:
    second = save(tmp_path / "second.ply", random_gaussians(np.random.default_rng(9), 50, sh_degree=3))
    joined = converted(scene, second, tmp_path / "x.ply")
    assert (len(joined), joined.sh_degree) == (350, 3)
    assert_alike(joined, edit.join([load(scene), load(second)]))


def test_a_limit_holds_for_all_scenes_together(
    capsys: pytest.CaptureFixture[str], scene: Path, tmp_path: Path
) -> None:
    second, out = save(tmp_path / "2.ply", random_gaussians(np.random.default_rng(9), 50)), tmp_path / "x.ply"
    document = account(capsys, scene, "--min-opacity", 0.6, second, "--max-splats", 40, out)
    most_important = edit.keep_most_important(edit.join([load(scene), load(second)]), 40)
    assert_alike(load(out), edit.drop_faint(most_important, 0.6))
    assert [about["splats"] for about in document["inputs"]] == [40, 40]
    assert document["edits"][0]["edit"] == "--max-splats 40"


@pytest.mark.parametrize(
    ("flags", "flagged"), [((True, True), True), ((False, False), False), ((True, False), False)]
)
def test_a_joined_scene_is_antialiased_when_all_are_and_a_warning_says_when_some_are(
    capsys: pytest.CaptureFixture[str], cloud: Gaussians, tmp_path: Path, flags: tuple[bool, ...], flagged: bool
) -> None:
    paths = [save(tmp_path / f"{index}.ply", replace(cloud, antialiased=flag)) for index, flag in enumerate(flags)]
    assert converted(*paths, tmp_path / "x.ply").antialiased == flagged
    warning = "tsplat: warning: 1 of 2 scenes are antialiased; joined, none counts as antialiased\n"
    assert capsys.readouterr().err == ("" if len(set(flags)) == 1 else warning)


@pytest.mark.parametrize("option", EDITS)
def test_no_edit_forgets_that_a_scene_is_antialiased(cloud: Gaussians, tmp_path: Path, option: str) -> None:
    path = save(tmp_path / "tagged.ply", replace(cloud, antialiased=True))
    assert converted(path, *option.split(" "), tmp_path / "x.ply").antialiased


def test_a_file_can_be_converted_in_place(scene: Path, tmp_path: Path) -> None:
    path = tmp_path / "x.ply"
    path.write_bytes(scene.read_bytes())
    before = load(path)
    assert_alike(converted(path, "--min-opacity", 0.5, path), edit.drop_faint(before, 0.5))
    assert list(tmp_path.iterdir()) == [path]


def test_the_demo_is_a_scene(tmp_path: Path) -> None:
    assert len(converted("demo", "--max-splats", 100, tmp_path / "x.splat")) == 100


@pytest.mark.parametrize(
    ("args", "words"),
    [
        ([], "Missing argument 'IN...'"),
        (["x.ply"], "Missing argument 'IN...'"),
        (["none.ply", "x.ply"], "none.ply: cannot be read"),
        (["none.ply", "x.xyz"], "x.xyz: suffix '.xyz' is no format that can be written; use one of .ply, "),
        (["none.ply", "x"], "suffix '' is no format"),
        (["none.ply", "none/x.ply"], "none/x.ply: cannot be written: No such file or directory"),
        (["SCENE", "--crop-box", "1,2,3", "x.ply"], "'1,2,3' is not six numbers X0,Y0,Z0,X1,Y1,Z1"),
        (["SCENE", "--crop-sphere", "1,2,3", "x.ply"], "'1,2,3' is not four numbers X,Y,Z,R"),
        (["SCENE", "--crop-sphere", "1,2,3,-1", "x.ply"], "the radius of a sphere must be 0 or more, got -1"),
        (["SCENE", "--rotate", "1", "2", "nan", "x.ply"], "is not three numbers X,Y,Z"),
        (["SCENE", "--remove-floaters=few", "x.ply"], "'few' is not a number of standard deviations"),
        (["SCENE", "--min-opacity", "2", "x.ply"], "2.0 is not in the range"),
        (["SCENE", "--scale", "0", "x.ply"], "0.0 is not in the range"),
        (["SCENE", "--decimate", "0", "x.ply"], "'0' is neither a number of splats, 1 or more, nor a percentage"),
        (["SCENE", "--decimate", "101%", "x.ply"], "'101%' is neither a number of splats"),
        (["SCENE", "--decimate", "half", "x.ply"], "'half' is neither a number of splats"),
        (["SCENE", "--sh-degree", "5", "x.ply"], "5 is not in the range"),
        (["SCENE", "--translate", "9e37,0,0", "--scale", "9", "x.ply"], "means must be finite"),
        (["SCENE", "--min-opacity", "0.1", "--crop-sphere", "9,9,9,1", "--scale", "2", "x.ply"],
         "--crop-sphere 9,9,9,1 removes the last 2"),
        (["EMPTY", "x.ply"], "there are no splats in EMPTY; nothing is written"),
        (["EMPTY", "EMPTY", "x.ply"], "there are no splats in EMPTY, EMPTY"),
        (["SCENE", "--lod", "1", "x.ply"], "lod must be 0 in a scene that is not streamed, got 1"),
        (["SCENE", "--lod", "-1", "x.ply"], "'-1' is not a level of detail, 0 or more, or all"),
        (["SCENE", "--spz-frame", "up", "x.ply"], "'up' is not one of 'ldb', 'rdb'"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)  # fmt: skip
def test_what_cannot_be_done_is_one_line_and_leaves_the_old_file(
    capsys: pytest.CaptureFixture[str],
    scene: Path,
    cloud: Gaussians,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    args: list[str],
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    empty = save(tmp_path / "empty.ply", cloud.take([]))
    (tmp_path / "x.ply").write_bytes(b"old")
    named = {"SCENE": str(scene), "EMPTY": str(empty)}
    assert convert(*(named.get(arg, arg) for arg in args)) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert words.replace("EMPTY", str(empty)) in err
    assert err.count("\n") == 1
    assert {path.name: path.stat().st_size for path in tmp_path.iterdir() if path != empty} == {"x.ply": 3}


def test_the_account_adds_up(capsys: pytest.CaptureFixture[str], scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.spz"
    document = account(capsys, scene, scene, "--min-opacity", 0.5, "--rotate", "1,2,3", "--sh-degree", 0, out)
    about = {"format": "PLY", "splats": 300, "sh_degree": 1, "antialiased": False, "bytes": scene.stat().st_size}
    assert document["inputs"] == [{"name": str(scene), **about}] * 2
    opaque = 2 * len(edit.drop_faint(load(scene), 0.5))
    assert document["edits"] == [
        {"edit": "--min-opacity 0.5", "removed": 600 - opaque, "splats": opaque, "sh_degree": 1},
        {"edit": "--rotate 1,2,3", "removed": 0, "splats": opaque, "sh_degree": 1},
        {"edit": "--sh-degree 0", "removed": 0, "splats": opaque, "sh_degree": 0},
    ]
    size, ratio = out.stat().st_size, out.stat().st_size / (2 * scene.stat().st_size)
    assert document["output"] == {
        "name": str(out), "format": "SPZ", "splats": opaque, "bytes": size, "ratio": ratio,
        "origin": None, "losses": [],
    }  # fmt: skip


def test_the_table_says_the_same_for_people(
    capsys: pytest.CaptureFixture[str], scene: Path, tmp_path: Path
) -> None:
    out = tmp_path / "[b]\x1b[1mx.spz"
    assert convert(scene, "--min-opacity", 0.5, "--scale", 2, out) == 0
    table, err = capsys.readouterr()
    assert err == ""
    left = len(edit.drop_faint(load(scene), 0.5))
    share = f"{100 * out.stat().st_size / scene.stat().st_size:.3g} %"
    for words in (
        r"[b]\x1b[1mx.spz",
        "cloud.ply",
        "PLY",
        "SPZ",
        "--min-opacity 0.5",
        f" {300 - left} ",
        f" {left} ",
        share,
    ):
        assert words in table.replace("\n", "")


def test_the_files_that_a_json_names_are_counted(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = write_folder(tmp_path / "sog", made_up(np.random.default_rng(0)).files())
    document = account(capsys, path, tmp_path / "x.ply")
    assert document["inputs"][0]["format"] == "SOG"
    assert document["inputs"][0]["bytes"] == sum(file.stat().st_size for file in path.parent.iterdir())


def test_what_one_of_several_levels_weighs_is_not_known(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    for name in "fine", "coarse":
        write_folder(tmp_path / name, made_up(np.random.default_rng(0)).files())
    lods = {str(level): {"file": level, "offset": 0, "count": 7 - level} for level in range(2)}
    tree = {"lodLevels": 2, "filenames": ["fine/meta.json", "coarse/meta.json"], "tree": {"lods": lods}}
    path = tmp_path / "lod-meta.json"
    path.write_text(json.dumps(tree))
    assert convert(path, "--lod", 1, tmp_path / "x.ply") == 0
    assert "%" not in capsys.readouterr().out
    document = account(capsys, path, "--lod", 1, tmp_path / "x.ply")
    assert (document["inputs"][0]["splats"], document["inputs"][0]["bytes"]) == (6, None)
    assert document["output"]["ratio"] is None


def test_a_terminal_is_shown_how_far_it_is(scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stderr = io.StringIO()
    monkeypatch.setattr(stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", stderr)
    monkeypatch.setattr(progress, "BAR_AFTER", 0.0)
    assert convert(scene, "--remove-floaters", tmp_path / "x.spz") == 0
    assert "editing x.spz" in stderr.getvalue()
    assert "100%" in stderr.getvalue()


def test_nothing_of_it_is_imported_for_help() -> None:
    code = "import sys; from tsplat import cli; cli.main(['convert', '--help']); print(list(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=120, check=True)
    modules = done.stdout.decode().splitlines()[-1]
    assert "'tsplat.convert.command'" in modules
    for heavy in ("'numba'", "'PIL'", "'tsplat.edit'", "'tsplat.io'", "'tsplat.raster'"):
        assert heavy not in modules


@pytest.mark.skipif("NUMBA_DISABLE_JIT" in os.environ, reason="nothing is compiled")
def test_plain_conversion_does_not_wait_for_a_compiler(scene: Path, tmp_path: Path) -> None:
    args = ["convert", str(scene), str(tmp_path / "x.splat")]
    code = f"import sys; from tsplat import cli; cli.main({args}); print('numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=120, check=True)
    assert done.stdout.decode().splitlines()[-1] == "False"
