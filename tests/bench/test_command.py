"""`tsplat bench` through the command line's own parser."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.bench.conftest import Drawn
from tests.scenes import random_gaussians
from tsplat import cli, progress
from tsplat.io import save
from tsplat.processors import available_processors

pytestmark = pytest.mark.usefixtures("compiled")

STAGES = {"mean", "min", "p50", "p95", "p99"}


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "cloud.ply"
    return save(path, random_gaussians(np.random.default_rng(3), 300, sh_degree=1))


def bench(*args: object) -> int:
    return cli.main(["bench", *map(str, args)])


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["none.ply"], "none.ply: cannot be read"),
        (["--size", "640"], "'640' is not a size WxH"),
        (["--size", "0x8"], "each side 1 to 16384"),
        (["--size", "8x16385"], "each side 1 to 16384"),
        (["--size", "8x8", "8x0"], "'8x0' is not a size"),
        (["--size"], "requires an argument"),
        (["--threads", "0"], "'0' is not a list of thread counts like 1,2,4, each 1 to 1024"),
        (["--threads", "1,,2"], "'1,,2' is not a list"),
        (["--threads", "1025"], "each 1 to 1024"),
        (["--frames", "0"], "0 is not in the range"),
        (["--wrong"], "No such option '--wrong'"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_status_2(
    capsys: pytest.CaptureFixture[str], args: list[str], words: str
) -> None:
    assert bench(*args) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert words in err
    assert err.count("\n") == 1


def test_a_bad_scene_is_known_before_a_good_one_is_timed(drawn: Drawn, scene: Path) -> None:
    assert bench(scene, scene.parent / "none.ply") == 2
    assert not drawn


@pytest.mark.usefixtures("ceilings")
def test_json_holds_everything(capsys: pytest.CaptureFixture[str], scene: Path) -> None:
    assert bench(scene, "--size", "40x30", "--threads", "1,2", "--frames", 2, "--json") == 0
    out, err = capsys.readouterr()
    assert err == ""
    document = json.loads(out, parse_constant=pytest.fail)
    assert {"processor", "processors", "python", "numpy", "numba", "tsplat"} <= document["machine"].keys()
    assert document["ceilings"] == {"blends_per_second": 2e9, "copy_bytes_per_second": 1e10}
    (result,) = document["results"]
    assert {name: result[name] for name in ("scene", "splats", "sh_degree", "width", "height", "frames")} == {
        "scene": "cloud", "splats": 300, "sh_degree": 1, "width": 40, "height": 30, "frames": 2,
    }  # fmt: skip
    one, two = result["runs"]
    assert (one["threads"], two["threads"], one["speedup"]) == (1, 2, 1.0)
    assert two["speedup"] == pytest.approx(one["frame_ms"] / two["frame_ms"])
    assert one["micro_kernel_share"] == pytest.approx(one["blends_per_second"] / 2e9)
    assert two["micro_kernel_share"] == pytest.approx(two["blends_per_second"] / 2 / 2e9)
    for stages in (one["stages"], one["views"][0]["stages"]):
        assert stages.keys() == {"project", "sort", "bin", "composite", "frame"}
        assert all(spread.keys() == STAGES for spread in stages.values())
    counts = [[view[name] for name in ("name", "visible", "pairs", "blends")] for view in one["views"]]
    assert counts == [[view[name] for name in ("name", "visible", "pairs", "blends")] for view in two["views"]]
    assert all(0 < visible <= 300 and blends > 0 for _, visible, _, blends in counts)


@pytest.mark.parametrize("sizes", [["--size", "24x16", "32x16"], ["--size=24x16", "--size", "32x16"]])
def test_several_sizes_are_all_timed(drawn: Drawn, scene: Path, sizes: list[str]) -> None:
    assert bench(*sizes, scene, "--frames", 1) == 0
    assert [(camera.width, camera.height) for camera, _ in drawn[:: len(drawn) // 2]] == [(24, 16), (32, 16)]
    assert {threads for _, threads in drawn} == {1, available_processors()}


def test_repeated_thread_counts_are_timed_once(drawn: Drawn, scene: Path) -> None:
    assert bench(scene, "--size", "8x8", "--frames", 1, "--threads", "3,1,3") == 0
    assert [threads for _, threads in drawn].count(3) == len(drawn) // 2


@pytest.mark.usefixtures("drawn")
def test_the_tables_show_every_figure(capsys: pytest.CaptureFixture[str], scene: Path) -> None:
    assert bench(scene, "--size", "24x16", "--frames", 1, "--threads", "1,2,4,8,16") == 0
    out, err = capsys.readouterr()
    assert err == ""
    for word in ("cloud, 300 splats, 24 x 16", "SH degree 1", "paint", "composite", "frame", "p99", "speed-up",
                 "1.00x", "of kernel", "of copy", "outside 1", "inside 3", "16 thr. ms", "10.0 GB/s"):  # fmt: skip
        assert word in out
    assert "…" not in out
    assert "nan" not in out


@pytest.mark.usefixtures("ceilings")
def test_an_empty_scene_is_no_error(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = save(tmp_path / "empty.ply", random_gaussians(np.random.default_rng(0), 0))
    assert bench(path, "--size", "8x8", "--frames", 1) == 0
    assert "empty, 0 splats" in capsys.readouterr().out
    assert bench(path, "--size", "8x8", "--frames", 1, "--json") == 0
    run = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)["results"][0]["runs"][0]
    assert run["blends_per_second"] is run["micro_kernel_share"] is None


@pytest.mark.usefixtures("drawn")
def test_progress_is_for_terminals(
    capsys: pytest.CaptureFixture[str], scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    screen = io.StringIO()
    monkeypatch.setattr(screen, "isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", screen)
    assert bench(scene, "--size", "24x16", "--frames", 1, "--json") == 0
    assert json.loads(capsys.readouterr().out)
    assert "cloud 24 x 16" in screen.getvalue()
    assert "100%" in screen.getvalue()


def test_kernels_are_ready_before_the_first_frame(
    drawn: Drawn, scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames_before: list[int] = []
    monkeypatch.setattr(progress, "wait_for_kernels", lambda _: frames_before.append(len(drawn)))
    assert bench(scene, "--size", "24x16", "--frames", 1) == 0
    assert frames_before == [0]
    assert drawn


def test_nothing_of_it_is_imported_for_other_commands() -> None:
    code = "import sys; from tsplat import cli; cli.main(['bench', '--help']); print(list(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=120, check=True)
    modules = done.stdout.decode().splitlines()[-1]
    assert "'tsplat.bench.command'" in modules
    for heavy in ("'numba'", "'tsplat.bench.measure'", "'tsplat.bench.report'", "'tsplat.raster'"):
        assert heavy not in modules


@pytest.mark.usefixtures("drawn")
def test_without_one_thread_there_is_no_speed_up(capsys: pytest.CaptureFixture[str], scene: Path) -> None:
    assert bench(scene, "--size", "24x16", "--frames", 1, "--threads", "2") == 0
    out = capsys.readouterr().out
    assert "1.00x" not in out
    (row,) = [line for line in out.splitlines() if line.startswith("│ 2 ") and "paint" not in line]
    assert [cell.strip() for cell in row.split("│")].count("-") == 2  # nor a share of the copy
