"""The script that compares with the C baseline: its turns, its floors, and what it cannot find."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scenes import random_gaussians

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "against_baseline.py"


@pytest.fixture(scope="module")
def script() -> Any:
    spec = importlib.util.spec_from_file_location("against_baseline", SCRIPT)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules["against_baseline"] = module  # its dataclasses look themselves up
    spec.loader.exec_module(module)
    return module


def contests(script: Any, one: tuple[float, float], two: tuple[float, float]) -> list[Any]:
    return [
        script.Contest(threads, {"total": baseline}, {"total": ours})
        for threads, (baseline, ours) in enumerate((one, two), 1)
    ]


def scaling(script: Any, two: float = 5.0) -> Any:
    return script.Scaling(ours={1: 10.0, 2: two}, blends={1: 1e8, 2: 1.9e8})


def test_ratios_are_the_baselines_time_over_ours_and_one_thread_over_two(script: Any) -> None:
    found = script.verdicts("x outside", (1280, 720), contests(script, (60.0, 10.0), (36.0, 5.0)), scaling(script))
    assert [(each.ratio, each.floor, each.holds) for each in found] == [
        (6.0, 6.0, True), (7.2, 7.0, True), (2.0, 1.8, True),
    ]  # fmt: skip
    assert [str(each) for each in found] == ["6.00", "7.20", "2.00 of 1.90"]
    small = script.verdicts("x outside", (240, 160), contests(script, (3.4, 1.0), (5.0, 1.0)), None)
    assert [(each.ratio, each.floor, each.holds) for each in small] == [(3.4, 3.5, False), (5.0, 5.0, True)]


def test_one_floor_below_is_status_1_and_marked(script: Any, capsys: pytest.CaptureFixture[str]) -> None:
    high = script.verdicts("x outside", (1280, 720), contests(script, (60.0, 10.0), (36.0, 5.0)), scaling(script))
    low = script.verdicts(
        "x inside", (1280, 720), contests(script, (60.0, 10.0), (36.0, 6.0)), scaling(script, 6.0)
    )
    assert script.conclude(high) == 0
    out = capsys.readouterr().out
    assert "3 of 3 floors hold\n" in out
    assert "!" not in out
    assert script.conclude([*high, *low]) == 1
    out = capsys.readouterr().out
    assert "4 of 6 floors hold; ! marks the others" in out
    assert out.count(" !") == 2 + 1
    assert "6.00 !" in out
    assert "1.67 of 1.90 !" in out


def test_both_take_turns_and_the_shortest_frame_counts(script: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[str] = []
    times = iter([9.0, 8.0, 5.0, 6.0])

    def baseline(*args: Any) -> dict[str, float]:
        order.append(f"baseline {args[-1]}")
        return {"total": next(times)}

    def ours(_scene: Any, _camera: Any, threads: int) -> Any:
        order.append(f"ours {threads}")
        warm_up = [{"total": 0.1}] * script.WARM_UP
        return iter([*warm_up, *({"total": threads + each} for each in (3.0, 1.0, 2.0))])

    monkeypatch.setattr(script, "_draw_baseline", baseline)
    monkeypatch.setattr(script, "_draw_ours", ours)
    cloud = random_gaussians(np.random.default_rng(2), 50)
    one, two = script.contest(Path("p"), Path("s"), cloud, script.views(cloud)[0], (240, 160), 2)
    assert order == ["baseline 1", "ours 1", "baseline 2", "ours 2"] * 2
    assert (one.baseline["total"], two.baseline["total"]) == (5.0, 6.0)
    assert (one.ours["total"], two.ours["total"]) == (2.0, 3.0)


@pytest.mark.parametrize("missing", ["baseline", "scene", "gcc"])
def test_what_is_missing_is_said_with_status_2(
    script: Any, missing: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    baseline, scene = tmp_path / "baseline.c", tmp_path / "x.ply"
    for path in (baseline, scene):
        path.touch()
    (tmp_path / f"{missing}.c").unlink(missing_ok=True)
    if missing == "scene":
        scene.unlink()
    monkeypatch.setenv("PATH", str(tmp_path))
    assert script.main([str(scene), "--baseline", str(baseline)]) == 2
    out, err = capsys.readouterr()
    looked_for = {"baseline": str(baseline), "scene": str(scene), "gcc": "gcc"}[missing]
    assert f"looked for {'a ' if missing == 'gcc' else ''}{looked_for}" in err
    assert out == ""
