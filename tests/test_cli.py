"""The command line: as a function through click's parser, and as the process a shell starts."""

from __future__ import annotations

import gzip
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import pytest
from PIL import Image

from tests.scenes import random_gaussians
from tsplat import __version__, cli
from tsplat.io import load, save

COMPILING = b"tsplat: compiling kernels, first run only\n"
pytestmark = pytest.mark.usefixtures("compiled")

HELP_PAGE = Path(__file__).parents[1] / "docs" / "cli.md"


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "cloud.ply"
    return save(path, random_gaussians(np.random.default_rng(3), 300, sh_degree=1))


def failure(capsys: pytest.CaptureFixture[str], *args: object) -> str:
    """Run what must fail with status 2; return its one line."""
    assert cli.main([str(arg) for arg in args]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("tsplat: ")
    assert err.count("\n") == 1
    return err


def process(*args: object, **options: object) -> subprocess.CompletedProcess[bytes]:
    environment = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES")}
    command = [sys.executable, "-m", "tsplat", *map(str, args)]
    return subprocess.run(command, capture_output=True, env=environment, timeout=120, check=False, **options)  # type: ignore[call-overload,no-any-return]


def test_version_is_the_packages(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"tsplat {__version__}\n"


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["none.ply"], "none.ply: cannot be read"),
        (["render", "none.ply", "-o", "x.png"], "none.ply: cannot be read"),
        (["info", "none.ply"], "none.ply: cannot be read"),
        (["render", "none.ply", "-o", "x.tiff"], "'.tiff' is not an image format"),
        (["render", "none.ply"], "Missing option '-o' / '--output'; see 'tsplat render --help'"),
        (["render"], "Missing argument 'SCENE'; see 'tsplat render --help'"),
        (["--wrong"], "No such option '--wrong'; see 'tsplat view --help'"),
        (["--output", "sixels"], "'sixels' is not one of"),
        (["--output", "sixel"], "needs a terminal"),
        (["render", "x.ply", "-o", "x.png", "--width", "0"], "0 is not in the range"),
        (["render", "x.ply", "-o", "x.png", "--fov-y", "180"], "180"),
        (["render", "x.ply", "-o", "x.png", "--eye", "1", "2"], "is not three numbers X Y Z"),
        (["render", "x.ply", "-o", "x.png", "--eye", "1", "2", "nan"], "is not three numbers"),
        (["render", "x.ply", "-o", "x.png", "--up", "w"], "'w' is not x, y, z, -x, -y, -z or three numbers"),
        (["render", "x.ply", "-o", "x.png", "--background", "pinkish"], "'pinkish' is not black, white"),
        (["render", "x.ply", "-o", "x.png", "--antialias", "best"], "'best' is not one of"),
        (["render", "x.ply", "-o", "x.png", "--eye"], "requires an argument"),
        (["info", "one.ply", "two.ply"], "unexpected extra argument"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_status_2(
    capsys: pytest.CaptureFixture[str], args: list[str], words: str
) -> None:
    assert words in failure(capsys, *args)


def test_a_camera_inside_its_target_is_one_line(capsys: pytest.CaptureFixture[str], scene: Path) -> None:
    line = failure(capsys, "render", scene, "-o", "x.png", "--eye", 1, 1, 1, "--target", 1, 1, 1)
    assert "target - eye" in line


@pytest.mark.skipif(sys.platform != "linux", reason="limits the addresses of a process")
def test_too_little_memory_is_one_line(scene: Path, tmp_path: Path) -> None:
    import resource

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))

    out = tmp_path / "large.png"
    ended = process("render", scene, "-o", out, "--width", 16384, "--height", 16384, preexec_fn=limited)
    assert (ended.returncode, ended.stdout) == (2, b"")
    said = ended.stderr.removeprefix(COMPILING).decode()
    assert re.fullmatch(r"tsplat: there is not enough memory \(.*\); .* a smaller picture need less\n", said)
    assert not any(tmp_path.iterdir())


def test_a_folder_that_is_not_there_is_one_line(capsys: pytest.CaptureFixture[str], scene: Path) -> None:
    line = failure(capsys, "render", scene, "-o", scene.parent / "none" / "x.png", "--width", 8, "--height", 8)
    assert "cannot be written" in line


def test_render_writes_the_picture_and_says_so(
    capsys: pytest.CaptureFixture[str], scene: Path, tmp_path: Path
) -> None:
    out = tmp_path / "x.png"
    assert cli.main(["render", str(scene), "-o", str(out), "--width", "40", "--height", "30"]) == 0
    text = capsys.readouterr().out
    assert re.fullmatch(rf"{re.escape(str(out))}: 40 x 30, \d+ of 300 splats, rendered in \d+ ms\n", text)
    with Image.open(out) as picture:
        assert picture.size == (40, 30)
        assert np.asarray(picture).max() > 30


@pytest.mark.parametrize("suffix", ["jpg", "webp", "npy"])
def test_render_writes_each_format(scene: Path, tmp_path: Path, suffix: str) -> None:
    out = tmp_path / f"x.{suffix}"
    assert cli.main(["render", str(scene), "-o", str(out), "--width", "20", "--height", "10"]) == 0
    if suffix == "npy":
        assert np.load(out).shape == (10, 20, 4)
        assert np.load(out).dtype == np.float32
    else:
        with Image.open(out) as picture:
            assert picture.size == (20, 10)


def rendered(scene: Path, folder: Path, *args: object) -> np.ndarray:
    out = folder / "x.npy"
    arguments = ["render", scene, "-o", out, "--width", 32, "--height", 24, *args]
    assert cli.main([str(arg) for arg in arguments]) == 0
    picture: np.ndarray = np.load(out)
    return picture


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (["--up", "-y"], ["--up", 0, -1, 0]),
        (["--up", "-y"], ["--up=0,-2,0"]),
        (["--up", "-1", "0", "0"], ["--up", "-x"]),
        (["--background", "white"], ["--background", 1, 1, 1]),
        (["--background", "#ff0000"], ["--background", "1,0,0"]),
        (
            ["--eye", 0, 0, -3, "--target", 0, 0, 0, "--up", "-y"],
            ["--eye", "0 0 -3", "--target=0,0,0", "--up", "-y"],
        ),
    ],
)
def test_three_numbers_can_be_written_in_several_ways(
    scene: Path, tmp_path: Path, one: list[object], other: list[object]
) -> None:
    first = rendered(scene, tmp_path, *one)
    assert np.array_equal(first, rendered(scene, tmp_path, *other))
    assert not np.array_equal(first, rendered(scene, tmp_path, "--background", "grey", "--up", "z"))


@pytest.mark.parametrize(
    "args",
    [
        ["--eye", 0, 0, -3],
        ["--target", 0.5, 0, 0],
        ["--up", "z"],
        ["--fov-y", 30],
        ["--sh-degree", 0],
        ["--antialias", "mip"],
        ["--background", "white"],
        ["--max-splats", 20],
        ["--raw-opacity"],
    ],
    ids=lambda args: args[0],
)
def test_every_option_of_render_changes_the_picture(scene: Path, tmp_path: Path, args: list[object]) -> None:
    assert not np.array_equal(rendered(scene, tmp_path, *args), rendered(scene, tmp_path))


def test_an_spz_with_the_axes_of_a_ply_can_be_turned_over(scene: Path, tmp_path: Path) -> None:
    packed = save(tmp_path / "x.spz", load(scene))
    view = "--eye", 0, 0, -3, "--target", 0, 0, 0, "--up", "-y"
    assert not np.array_equal(
        rendered(packed, tmp_path, *view, "--spz-frame", "rdf"), rendered(packed, tmp_path, *view)
    )


@pytest.mark.parametrize("pack", [bytes, gzip.compress])
def test_what_is_only_called_an_spz_is_rendered_all_the_same(
    scene: Path, tmp_path: Path, pack: Callable[[bytes], bytes]
) -> None:
    named = tmp_path / "scene.spz"
    named.write_bytes(pack(scene.read_bytes()))
    np.testing.assert_array_equal(rendered(named, tmp_path), rendered(scene, tmp_path))


def test_a_level_of_detail_is_for_streamed_scenes(capsys: pytest.CaptureFixture[str], scene: Path) -> None:
    assert cli.main(["info", str(scene), "--lod", "all"]) == 0
    assert "300" in capsys.readouterr().out
    for args in (["render", scene, "-o", "x.png"], ["info", scene], ["bench", scene], [scene]):
        assert "lod must be 0 in a scene that is not streamed" in failure(capsys, *args, "--lod", 2)
    assert "'few' is not a level of detail, 0 or more, or all" in failure(capsys, "info", scene, "--lod", "few")


def test_an_allowance_of_memory_does_not_change_the_picture(scene: Path, tmp_path: Path) -> None:
    np.testing.assert_array_equal(
        rendered(scene, tmp_path, "--memory", "0.00001"), rendered(scene, tmp_path, "--memory", "1")
    )


def test_threads_do_not_change_the_picture(scene: Path, tmp_path: Path) -> None:
    assert np.array_equal(rendered(scene, tmp_path, "--threads", 1), rendered(scene, tmp_path, "--threads", 2))


def test_the_training_focal_matters_to_relative_alone(scene: Path, tmp_path: Path) -> None:
    def at(antialias: str, focal: int) -> np.ndarray:
        return rendered(scene, tmp_path, "--antialias", antialias, "--train-focal", focal)

    assert np.array_equal(at("classic", 20), at("classic", 2000))
    assert not np.array_equal(at("relative", 20), at("relative", 2000))


FRAME = {"position": [0, 0, 0], "rotation": np.eye(3).tolist(), "width": 8, "height": 6, "fx": 90, "fy": 90}
LISTS = {
    "cameras.json": [FRAME],
    "transforms.json": {"fl_x": 90, "w": 8, "frames": [{}]},
    "transforms_train.json": {"camera_angle_x": 2 * np.arctan(4 / 90), "w": 8, "frames": [{}]},
}


@pytest.mark.parametrize("name", LISTS)
def test_render_is_relative_where_the_training_focal_lies_beside_the_scene(
    scene: Path, tmp_path: Path, name: str
) -> None:
    copy = tmp_path / "inner" / "cloud.ply"
    copy.parent.mkdir()
    copy.write_bytes(scene.read_bytes())
    view = "--eye", 0, 0, -3, "--target", 0, 0, 0, "--up", "-y"  # cameras may say where to begin, too
    classic = rendered(copy, tmp_path, *view)
    assert np.array_equal(classic, rendered(copy, tmp_path, *view, "--antialias", "classic"))
    (tmp_path / name).write_text(json.dumps(LISTS[name]))
    relative = rendered(copy, tmp_path, *view)
    told = rendered(copy, tmp_path, *view, "--antialias", "relative", "--train-focal", 90)
    np.testing.assert_allclose(relative, told, atol=1e-5)
    assert not np.array_equal(relative, classic)
    assert np.array_equal(classic, rendered(copy, tmp_path, *view, "--antialias", "classic"))


@pytest.mark.parametrize("suffix", [".ply", ".tsplat"])
def test_render_keeps_the_blur_of_training_where_the_eye_is_nearer_than_the_cameras(
    scene: Path, tmp_path: Path, suffix: str
) -> None:
    copy = tmp_path / "inner" / f"cloud{suffix}"
    copy.parent.mkdir()
    if suffix == ".ply":
        copy.write_bytes(scene.read_bytes())
    else:
        assert cli.main(["optimize", str(scene), "-o", str(copy)]) == 0
    near, far = ("--eye", 0, 0, -1.2, "--target", 0, 0, 0), ("--eye", 0, 0, -7, "--target", 0, 0, 0)
    told = [rendered(copy, tmp_path, *view, "--train-focal", 20) for view in (near, far)]
    listed = {**FRAME, "fx": 20, "fy": 20, "width": 16, "height": 12}
    (tmp_path / "cameras.json").write_text(json.dumps([{**listed, "position": [0, 0, -6]}]))
    known = [rendered(copy, tmp_path, *view) for view in (near, far)]
    by_hand = rendered(copy, tmp_path, *near, "--train-focal", 20)
    assert np.abs(known[0] - told[0]).max() > 0.1
    np.testing.assert_allclose(by_hand, known[0], atol=1e-5)
    np.testing.assert_allclose(known[1], told[1], atol=1e-5)


def test_render_is_relative_where_the_training_focal_is_told(scene: Path, tmp_path: Path) -> None:
    told = rendered(scene, tmp_path, "--train-focal", 90)
    assert np.array_equal(told, rendered(scene, tmp_path, "--antialias", "relative", "--train-focal", 90))
    assert not np.array_equal(told, rendered(scene, tmp_path))


def test_a_scene_trained_with_antialiasing_is_drawn_its_own_way(scene: Path, tmp_path: Path) -> None:
    own = save(tmp_path / "own.ply", replace(load(scene), antialiased=True))
    mip = rendered(own, tmp_path, "--antialias", "mip")
    assert np.array_equal(mip, rendered(own, tmp_path))
    assert np.array_equal(mip, rendered(own, tmp_path, "--train-focal", 90))
    assert not np.array_equal(mip, rendered(scene, tmp_path))


def test_a_broken_list_beside_a_scene_is_one_line_of_warning(
    capsys: pytest.CaptureFixture[str], scene: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "cloud.ply"
    copy.write_bytes(scene.read_bytes())
    (tmp_path / "transforms.json").write_text("{}")
    classic = rendered(copy, tmp_path)
    err = capsys.readouterr().err
    assert err.startswith("tsplat: warning: ")
    assert err.count("\n") == 1
    assert np.array_equal(classic, rendered(scene, tmp_path))


def test_a_printed_picture_is_relative_to_a_guess_where_no_focal_is_known(scene: Path) -> None:
    guessed, told, classic = (
        process(scene, *args).stdout
        for args in ((), ("--antialias", "relative", "--train-focal", 1100), ("--antialias", "classic"))
    )
    assert guessed == told != classic


def test_an_error_that_ctrl_c_set_off_is_an_interruption_and_any_other_is_shown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        try:
            raise KeyboardInterrupt
        finally:
            raise RuntimeError("cannot release un-acquired lock")

    monkeypatch.setattr(cli, "open_scene", interrupted)
    assert cli.main(["render", "demo", "-o", "x.png"]) == 130
    monkeypatch.setattr(cli, "open_scene", lambda *_: [][0])
    with pytest.raises(IndexError):
        cli.main(["render", "demo", "-o", "x.png"])


def test_a_picture_of_an_empty_scene_is_no_error(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = save(tmp_path / "empty.ply", random_gaussians(np.random.default_rng(0), 0))
    assert cli.main(["render", str(path), "-o", str(tmp_path / "x.png"), "--width", "9", "--height", "9"]) == 0
    assert "0 of 0 splats" in capsys.readouterr().out


def test_a_warning_is_one_line(capsys: pytest.CaptureFixture[str], scene: Path, tmp_path: Path) -> None:
    broken = bytearray(scene.read_bytes())
    first = broken.index(b"end_header\n") + len(b"end_header\n")
    broken[first : first + 4] = np.float32(np.nan).tobytes()
    path = tmp_path / "nan.ply"
    path.write_bytes(broken)
    arguments = ["render", path, "-o", tmp_path / "x.png", "--width", 9, "--height", 9]
    assert cli.main([str(argument) for argument in arguments]) == 0
    out, err = capsys.readouterr()
    assert "of 299 splats" in out
    assert err.startswith("tsplat: warning: ")
    assert err.count("\n") == 1


def test_a_truncated_file_is_one_line_without_a_traceback(scene: Path, tmp_path: Path) -> None:
    path = tmp_path / "cut.ply"
    path.write_bytes(scene.read_bytes()[:-10])
    done = process(path)
    assert done.returncode == 2
    assert done.stdout == b""
    assert done.stderr.startswith(b"tsplat: ")
    assert done.stderr.count(b"\n") == 1


def test_a_scene_may_come_through_a_pipe(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.png"
    done = process("render", "-", "-o", out, "--width", 40, "--height", 30, input=scene.read_bytes())
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"of 300 splats" in done.stdout
    done = process("info", "-", "--json", input=gzip.compress(scene.read_bytes()))
    assert json.loads(done.stdout)["splats"] == 300
    done = process("-", input=scene.read_bytes()[:-10])
    assert done.returncode == 2
    assert done.stderr.startswith(b"tsplat: standard input: at byte ")
    assert done.stderr.count(b"\n") == 1


def test_a_pipe_gets_one_picture_as_text(scene: Path) -> None:
    done = process(scene)
    assert done.returncode == 0, done.stderr
    assert done.stderr in (b"", COMPILING)
    lines = done.stdout.decode().splitlines()
    assert len(lines) == 24
    assert all(line.count("▀") == 80 for line in lines)
    assert b"\x1b[38;2;" in done.stdout


def test_a_printed_picture_has_the_size_asked_for(capfdbinary: pytest.CaptureFixture[bytes], scene: Path,
                                                  monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    monkeypatch.setenv("COLUMNS", "50")
    assert cli.main([str(scene)]) == 0
    assert [line.count("▀") for line in capfdbinary.readouterr().out.decode().splitlines()] == [50] * 15
    assert cli.main([str(scene), "--width", "20", "--height", "4", "--output", "half256"]) == 0
    out = capfdbinary.readouterr().out
    assert [line.count("▀") for line in out.decode().splitlines()] == [20] * 4
    assert b";2;" not in out


def test_a_reader_that_leaves_early_hears_nothing(scene: Path) -> None:
    command = f"'{sys.executable}' -m tsplat '{scene}' --width 900 --height 300 | head -c 10 >/dev/null"
    done = subprocess.run(["/bin/sh", "-c", command], capture_output=True, timeout=120, check=False)
    assert done.stderr in (b"", COMPILING)


def installed_files() -> list[tuple[str, float]]:
    package = Path(cli.__file__).parent
    return sorted((str(path), path.stat().st_mtime) for path in package.rglob("*") if path.suffix != ".pyc")


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere no variable names the user's cache folder")
@pytest.mark.skipif("NUMBA_DISABLE_JIT" in os.environ, reason="nothing is compiled")
def test_the_first_run_ever_compiles_into_the_users_cache_and_says_so_once(
    scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    before = installed_files()
    arguments = "render", scene, "-o", tmp_path / "x.png", "--width", 32, "--height", 24
    first, second = process(*arguments), process(*arguments)
    assert (first.returncode, first.stderr) == (0, COMPILING)
    assert (second.returncode, second.stderr) == (0, b"")
    assert list(tmp_path.glob("tsplat/kernels-*/draw-*"))
    assert installed_files() == before


def test_help_is_quick_because_it_imports_nothing_heavy() -> None:
    code = "import sys; from tsplat import cli; cli.main(['--help']); print([m for m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=120, check=True)
    modules = done.stdout.decode().splitlines()[-1]
    for heavy in ("'numba'", "'PIL'", "'blessed'", "'asyncio'", "'fsspec'", "'tsplat.viewer'", "'tsplat.raster'"):
        assert heavy not in modules


def help_page() -> str:
    """Return the page of all commands and options, from the definitions that the parser uses."""
    context = click.Context(cli.command, info_name="tsplat", **cli.command.context_settings)
    parts = ["# The command line", "", "Made from the commands themselves by `pytest --update-goldens`.", ""]
    about: list[tuple[click.Command, click.Context]] = [(cli.command, context)]
    about += [(each, click.Context(each, context, name)) for name, each in cli.command.commands.items()]
    for command, inner in about:
        parts += [f"## `{inner.command_path}`", "", " ".join((command.help or "").split()), ""]
        parts += ["    " + " ".join([inner.command_path, *command.collect_usage_pieces(inner)]), ""]
        parts += ["| option | |", "|---|---|"]
        records = [param.get_help_record(inner) for param in command.get_params(inner) if param.opts[0] != "scene"]
        parts += [f"| `{name.replace('|', '&#124;')}` | {text} |" for name, text in filter(None, records)]
        parts += [""]
    return "\n".join(parts)


def test_the_help_page_is_not_stale(request: pytest.FixtureRequest) -> None:
    page = help_page()
    if request.config.getoption("--update-goldens"):
        HELP_PAGE.parent.mkdir(exist_ok=True)
        HELP_PAGE.write_text(page)
    assert HELP_PAGE.read_text() == page, "run pytest --update-goldens tests/test_cli.py"
