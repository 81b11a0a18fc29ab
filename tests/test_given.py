"""What callers hand over: NumPy's numbers are taken as Python's, all else is a line that shows it."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tsplat
from tests.scenes import random_gaussians
from tsplat import edit, io
from tsplat.edit import join
from tsplat.errors import TsplatError
from tsplat.io.options import LoadOptions
from tsplat.lod import (
    decimate,
    default_budget,
    hierarchy,
    open_stored,
    open_streamed,
    rasterize_all,
    rasterize_within,
    store,
)

SCENE = random_gaussians(np.random.default_rng(3), 40, 1)
CAMERA = tsplat.Camera.look_at((0, 0, -3), (0, 0, 0), (0, -1, 0), width=16, height=12, fov_y=55.0)
OPTIONS = tsplat.RenderOptions(threads=1)

Call = Callable[[Any], object]
Values = tuple[object, ...]

PATHS: dict[str, Call] = {
    "load": tsplat.load,
    "save": lambda path: io.save(path, SCENE),
    "load_cameras": io.load_cameras,
    "training_beside": io.training_beside,
    "open_stored": open_stored,
    "open_streamed": open_streamed,
}
SCENES: dict[str, Call] = {
    "save": lambda scene: io.save("x.ply", scene),
    "render": lambda scene: tsplat.render(scene, CAMERA),
    "rasterize_all": lambda scene: rasterize_all(scene, CAMERA, OPTIONS),
    "rasterize_within": lambda scene: rasterize_within(scene, CAMERA, OPTIONS, 300),
    "hierarchy": lambda scene: hierarchy(scene, 1),
    "store": lambda scene: store(None, scene, 1, print),
    "decimate": lambda scene: decimate(scene, 5),
    "crop_box": lambda scene: edit.crop_box(scene, (0, 0, 0), (1, 1, 1)),
    "crop_sphere": lambda scene: edit.crop_sphere(scene, (0, 0, 0), 1),
    "drop_faint": lambda scene: edit.drop_faint(scene, 0.5),
    "drop_large": lambda scene: edit.drop_large(scene, 0.5),
    "join": lambda scene: join([SCENE, scene]),
    "keep_most_important": lambda scene: edit.keep_most_important(scene, 5),
    "lower_sh_degree": lambda scene: edit.lower_sh_degree(scene, 0),
    "with_sh_degree": lambda scene: edit.with_sh_degree(scene, 0),
    "remove_floaters": edit.remove_floaters,
    "rotate": lambda scene: edit.rotate(scene, (1, 2, 3)),
    "scale": lambda scene: edit.scale(scene, 2),
    "translate": lambda scene: edit.translate(scene, (1, 2, 3)),
}
WHOLE: dict[str, Call] = {
    "max_splats": lambda number: LoadOptions(max_splats=number),
    "lod of load": lambda number: LoadOptions(lod=number),
    "lod of render": lambda number: tsplat.render(SCENE, CAMERA, lod=number),
    "budget": lambda number: rasterize_within(SCENE, CAMERA, OPTIONS, number),
    "count of decimate": lambda number: decimate(SCENE, number),
    "threads of decimate": lambda number: decimate(SCENE, 30, threads=number),
    "threads of hierarchy": lambda number: hierarchy(SCENE, number),
    "keep_most_important": lambda number: edit.keep_most_important(SCENE, number),
    "lower_sh_degree": lambda number: edit.lower_sh_degree(SCENE, number),
    "with_sh_degree": lambda number: edit.with_sh_degree(SCENE, number),
}
REAL: dict[str, Call] = {
    "radius": lambda number: edit.crop_sphere(SCENE, (0, 0, 0), number),
    "min_opacity": lambda number: edit.drop_faint(SCENE, number),
    "max_scale": lambda number: edit.drop_large(SCENE, number),
    "sigmas": lambda number: edit.remove_floaters(SCENE, number),
    "factor": lambda number: edit.scale(SCENE, number),
}
TRIPLES: dict[str, Call] = {
    "corner": lambda point: edit.crop_box(SCENE, point, (1, 1, 1)),
    "opposite": lambda point: edit.crop_box(SCENE, (1, 1, 1), point),
    "center": lambda point: edit.crop_sphere(SCENE, point, 1),
    "offset": lambda point: edit.translate(SCENE, point),
    "degrees": lambda point: edit.rotate(SCENE, point),
}
ARRAYS: dict[str, Call] = {
    name: lambda array, name=name: replace(SCENE, **{name: array})  # type: ignore[misc]
    for name in ("means", "quats", "scales", "opacities", "sh")
}

NO_PATHS: Values = (
    5,
    None,
    b"x.ply",
    ["x.ply"],
    1.5,
    object(),
    np.zeros(3),
    "x\0.ply",
    "x\ud800.ply",
    Path("x\0"),
)
NO_SCENES: Values = (5, None, "x.ply", SCENE.means, [SCENE], {}, object)
NO_NUMBERS: Values = ("2", [2], np.array([2, 2]), b"2", object(), {}, 2j, np.array("2"), np.datetime64("2020"))
NO_WHOLE: Values = (*NO_NUMBERS, 2.0, np.float32(2), -1, -(10**30), float("nan"))
NO_REAL: Values = (*NO_NUMBERS, None, True, float("nan"), np.array(np.nan), 10**400)
NO_TRIPLES: Values = (
    "123",
    None,
    5,
    (1, 2),
    [[1, 2, 3]],
    "abc",
    ("1", "2", "3"),
    (1, 2, float("nan")),
    [1, [2], 3],
    object(),
)
NO_ARRAYS: Values = ("x", None, 5, ["a"], [[1], [2, 3]], object(), {}, 2j, b"x", [None])
CASES: list[tuple[str, Call, Values]] = [
    *((name, call, NO_PATHS) for name, call in PATHS.items()),
    *((name, call, NO_SCENES) for name, call in SCENES.items()),
    *((name, call, NO_WHOLE) for name, call in WHOLE.items()),
    *((name, call, NO_REAL) for name, call in REAL.items()),
    *((name, call, NO_TRIPLES) for name, call in TRIPLES.items()),
    *((name, call, NO_ARRAYS) for name, call in ARRAYS.items()),
    ("take", SCENE.take, (5, None, "x", [0.5], [True] * 40, [40], [-41], [[1]], [[1], [2, 3]], object())),
    ("join", join, (5, None, [], SCENE, {SCENE}, "x")),
    ("progress", lambda call: tsplat.load(io.demo_path(), progress=call), (5, "x")),
    ("raw_opacity", lambda flag: LoadOptions(raw_opacity=flag), (1, "yes", None)),
    ("spz_frame", lambda name: LoadOptions(spz_frame=name), (1, "x" * 1000, ["rub"], np.zeros(2))),
    ("format", lambda name: LoadOptions(format=name), (1, "x" * 1000, ["ply"], np.zeros(2))),
    ("extra", lambda flag: LoadOptions(extra=flag), (1, "yes", None)),
    ("antialiased", lambda flag: tsplat.Gaussians(*SCENE.arrays, flag), (1, "yes", None, np.zeros(2))),
]


@pytest.mark.parametrize(("call", "values"), [case[1:] for case in CASES], ids=[case[0] for case in CASES])
def test_what_is_wrong_is_one_short_line_of_ours(call: Call, values: Values) -> None:
    for value in values:
        with pytest.raises(TsplatError) as caught:
            call(value)
        line = str(caught.value)
        assert line.isprintable(), value
        assert len(line) < 300, value


@pytest.mark.parametrize("name", [name for name in PATHS if name not in ("save", "training_beside")])
def test_what_is_no_file_is_not_waited_for(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / "pipe")
    for place in (tmp_path / "pipe", tmp_path, Path("/dev/zero"), tmp_path / "none", tmp_path / ("x" * 5000)):
        with pytest.raises(TsplatError):
            PATHS[name](place)


def test_a_line_says_what_was_given() -> None:
    with pytest.raises(TsplatError, match=r"^path must be a str or a Path, got b'x\.ply'$"):
        tsplat.load(b"x.ply")  # type: ignore[arg-type]
    with pytest.raises(TsplatError, match=r"^max_splats must be a whole number, 1 or more, got 2\.0$"):
        tsplat.load("x.ply", max_splats=2.0)
    with pytest.raises(TsplatError, match=r"^offset must be three finite numbers, got <ndarray of shape \(2,\)>$"):
        edit.translate(SCENE, np.zeros(2))
    with pytest.raises(TsplatError, match=r"^means must be an array of numbers, got \['a'\]$"):
        tsplat.Gaussians(["a"], *SCENE.arrays[1:])
    with pytest.raises(TsplatError, match=r"^a scene must be Gaussians, .* got 'x\.ply'$"):
        edit.scale("x.ply", 2)  # type: ignore[arg-type]


@pytest.mark.parametrize("call", [*WHOLE.values(), *REAL.values()], ids=[*WHOLE, *REAL])
def test_numbers_of_numpy_are_numbers(call: Call) -> None:
    for number in (np.int64(1), np.uint8(1), np.array(1), np.int32(1)):
        call(number)
    if call in REAL.values():
        for real in (np.float32(1), np.float64(1), np.array(1.0), np.float16(1), 1):
            call(real)


@pytest.mark.parametrize("call", TRIPLES.values(), ids=TRIPLES)
def test_arrays_of_any_numbers_are_points(call: Call) -> None:
    for point in ((1, 2, 3), [1.0, 2, 3], np.arange(3), np.ones(3, np.float16), (np.int8(1), np.float32(2), 3)):
        call(point)


def test_edits_that_outgrow_float32_warn_of_nothing() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for call in (lambda: edit.scale(SCENE, 1e300), lambda: edit.translate(SCENE, (1e300, 0, 0))):
            with pytest.raises(TsplatError, match="must be finite"):
                call()
        assert len(edit.drop_large(SCENE, 1e300)) == 40
        assert len(edit.drop_faint(SCENE, 1e300)) == 0
        assert len(edit.crop_box(SCENE, (-np.inf, -1e300, -9), (np.inf, 1e300, np.inf))) == 40


def test_default_budget_is_a_number_that_rasterize_within_takes() -> None:
    assert rasterize_within(SCENE, CAMERA, OPTIONS, default_budget(CAMERA)).visible > 0
