"""One scene in the many ways in which people's PLYs hold it, read as it is meant; and what is no splat scene."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.io.plys import FORMATS, Table, in_halves, ply_bytes, splat_names, splats
from tests.scenes import field_files
from tsplat.errors import CorruptFileError, LoadError, LoadWarning
from tsplat.io import load, save
from tsplat.scene import SH_C0, Gaussians

NAMES = splat_names(0)
ROWS = 40
ALL = ("means", "quats", "scales", "opacities", "sh")
Cell = float | int
Change = Callable[[dict[str, list[Cell]]], dict[str, list[Cell]]]


def plain() -> dict[str, list[Cell]]:
    """Return the columns of a scene whose colours are bytes, so that every way to write them is exact."""
    rng = np.random.default_rng(3)
    columns = {name: rng.normal(size=ROWS).astype(np.float32).tolist() for name in NAMES}
    for channel in range(3):
        colors = rng.integers(0, 256, ROWS) / 255.0
        columns[f"f_dc_{channel}"] = ((colors - 0.5) / SH_C0).astype(np.float32).tolist()
        columns[f"scale_{channel}"] = rng.uniform(-5.0, -2.0, ROWS).astype(np.float32).tolist()
    return columns


def file_of(
    columns: dict[str, list[Cell]],
    types: dict[str, str] | None = None,
    kind: str = FORMATS[0],
    scalar: str = "float",
) -> bytes:
    rows = list(map(list, zip(*columns.values(), strict=True)))
    return ply_bytes([Table("vertex", [((types or {}).get(name, scalar), name) for name in columns], rows)], kind)


def loaded(folder: Path, content: bytes, name: str = "scene.ply", **options: bool | int) -> Gaussians:
    path = folder / name
    path.write_bytes(content)
    return load(path, **options)


def check_same(found: Gaussians, expected: Gaussians, names: Sequence[str] = ALL, atol: float = 2e-6) -> None:
    for name in names:
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), 2e-6, atol, err_msg=name)


def renamed(columns: dict[str, list[Cell]], rule: Callable[[str], str]) -> dict[str, list[Cell]]:
    return {rule(name): values for name, values in columns.items()}


def with_rgb(columns: dict[str, list[Cell]], white: float, names: Sequence[str]) -> dict[str, list[Cell]]:
    rest = {name: values for name, values in columns.items() if not name.startswith("f_dc_")}
    for channel, name in enumerate(names):
        shares = [SH_C0 * value + 0.5 for value in columns[f"f_dc_{channel}"]]
        rest[name] = [white * share if white == 1.0 else round(white * share) for share in shares]
    return rest


RGB = ("red", "green", "blue")
ALIKE: dict[str, Callable[[dict[str, list[Cell]]], bytes]] = {
    "doubles": lambda columns: file_of(columns, scalar="double"),
    "CloudCompare's names": lambda columns: file_of(
        renamed(columns, lambda name: name if name in "xyz" else f"scalar_{name}")
    ),
    "its old names, in capitals": lambda columns: file_of(
        renamed(columns, lambda name: f"scal_{name}".upper() if name not in "xyz" else name.upper()),
        scalar="double",
    ),
    "renamed twice": lambda columns: file_of(
        renamed(columns, lambda name: f"scalar_scalar_{name}" if name == "opacity" else name)
    ),
    "renamed beside the name as it is meant": lambda columns: file_of(
        {"scalar_opacity": [7.0] * ROWS, **columns, "Opacity": [9.0] * ROWS}
    ),
    "colours as bytes": lambda columns: file_of(with_rgb(columns, 255.0, RGB), dict.fromkeys(RGB, "uchar")),
    "colours as bytes, in ASCII": lambda columns: file_of(
        with_rgb(columns, 255.0, RGB), dict.fromkeys(RGB, "uint8"), "ascii"
    ),
    "colours of bytes as floats": lambda columns: file_of(with_rgb(columns, 255.0, ("r", "g", "b"))),
    "colours of bytes as ints": lambda columns: file_of(with_rgb(columns, 255.0, RGB), dict.fromkeys(RGB, "int")),
    "colours from 0 to 1": lambda columns: file_of(with_rgb(columns, 1.0, RGB)),
    "colours from 0 to 1, as doubles": lambda columns: file_of(with_rgb(columns, 1.0, RGB), scalar="double"),
    "colours as ushort": lambda columns: file_of(with_rgb(columns, 65535.0, RGB), dict.fromkeys(RGB, "ushort")),
    "colours beside the coefficients": lambda columns: file_of(
        columns | {name: [1] * ROWS for name in RGB}, dict.fromkeys(RGB, "uchar")
    ),
    "big-endian colours": lambda columns: file_of(
        with_rgb(columns, 65535.0, RGB), dict.fromkeys(RGB, "ushort"), "binary_big_endian"
    ),
}


@pytest.mark.parametrize("name", ALIKE)
def test_a_scene_is_the_same_however_its_columns_are_called_and_typed(tmp_path: Path, name: str) -> None:
    expected = loaded(tmp_path, file_of(plain()))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_same(loaded(tmp_path, ALIKE[name](plain())), expected)
        check_same(
            loaded(tmp_path, ALIKE[name](plain()), max_splats=ROWS - 1),
            loaded(tmp_path, file_of(plain()), max_splats=ROWS - 1),
        )


@pytest.mark.parametrize("kind", FORMATS[:2])
@pytest.mark.parametrize("scalar", ["ushort", "short"])
def test_halves_in_columns_of_integers_are_read_as_halves(tmp_path: Path, scalar: str, kind: str) -> None:
    columns = plain()
    columns["f_dc_1"] = [0.0] * ROWS
    rows = list(map(list, zip(*columns.values(), strict=True)))
    with pytest.warns(LoadWarning, match="its 14 columns of 16-bit integers hold numbers of 16-bit floating"):
        found = loaded(tmp_path, in_halves(splats(rows), scalar, kind))
    halved = {name: np.float16(values).astype(float).tolist() for name, values in columns.items()}
    check_same(found, loaded(tmp_path, file_of(halved)))


def test_whole_numbers_in_columns_of_integers_stay_whole_numbers(tmp_path: Path) -> None:
    columns: dict[str, list[Cell]] = {name: [1, 3, 2] for name in NAMES}
    check_same(loaded(tmp_path, file_of(columns, scalar="ushort")), loaded(tmp_path, file_of(columns)))


def test_two_scales_are_flat_splats_and_one_is_a_ball(tmp_path: Path) -> None:
    columns = plain()
    expected = loaded(tmp_path, file_of(columns))
    del columns["scale_2"]
    disks = loaded(tmp_path, file_of(columns))
    check_same(disks, expected, ("means", "quats", "opacities", "sh"))
    np.testing.assert_array_equal(disks.scales[:, :2], expected.scales[:, :2])
    assert not disks.scales[:, 2].any()
    del columns["scale_1"]
    balls = loaded(tmp_path, file_of(columns))
    np.testing.assert_array_equal(balls.scales, np.repeat(expected.scales[:, :1], 3, axis=1))


@pytest.mark.parametrize("column", ["filter_3D", "scalar_filter_3D", "filter_3d"])
def test_the_3d_filter_of_mip_splatting_is_applied(tmp_path: Path, column: str) -> None:
    columns = plain()
    expected = loaded(tmp_path, file_of(columns))
    columns[column] = [0.0, *np.linspace(0.001, 0.2, ROWS - 1).astype(np.float32).tolist()]
    columns["scale_0"][0] = columns["scale_1"][0] = columns["scale_1"][1] = -math.inf
    found = loaded(tmp_path, file_of(columns))
    filters = np.array(columns[column])
    squares = np.exp(np.array([columns[f"scale_{axis}"] for axis in range(3)], np.float64)) ** 2
    np.testing.assert_allclose(found.scales.T, np.sqrt(squares + filters**2), 1e-5)
    shares = np.sqrt((squares[:, 1:] / (squares[:, 1:] + filters[1:] ** 2)).prod(axis=0))
    np.testing.assert_allclose(found.opacities[1:], expected.opacities[1:] * shares, 1e-5)
    assert found.opacities[0] == expected.opacities[0], "without a filter nothing changes"
    assert found.antialiased
    assert not expected.antialiased


def saved_npz(folder: Path, columns: dict[str, list[Cell]]) -> Path:
    """Write the columns as gsplat's checkpoint has them."""

    def together(*names: str) -> np.ndarray:
        return np.stack([np.array(columns[name], np.float32) for name in names], 1)

    path = folder / "scene.npz"
    scales = together("scale_0", "scale_1", "scale_2")
    means, quats = together(*"xyz"), together(*(f"rot_{i}" for i in range(4)))
    sh0 = together(*NAMES[3:6])[:, None]
    np.savez(path, means=means, quats=quats, scales=scales, opacities=together("opacity"), sh0=sh0)
    return path


@pytest.mark.parametrize("suffix", ["ply", "npz"])
def test_what_activation_makes_finite_is_kept(tmp_path: Path, suffix: str) -> None:
    columns = plain()
    columns["opacity"][:2], columns["scale_2"][2] = [math.inf, -math.inf], -math.inf
    found = loaded(tmp_path, file_of(columns)) if suffix == "ply" else load(saved_npz(tmp_path, columns))
    assert len(found) == ROWS
    assert found.opacities[:2].tolist() == [1.0, 0.0]
    assert found.scales[2, 2] == 0.0
    assert found.scales[2, 0] > 0.0


@pytest.mark.parametrize("column", ["opacity", "scale_1", "rot_0", "x", "f_dc_0"])
def test_a_scene_of_which_nothing_can_be_drawn_is_refused_with_counts(tmp_path: Path, column: str) -> None:
    field = {"opacity": "opacities", "scale_1": "scales", "rot_0": "quats", "x": "means", "f_dc_0": "sh"}[column]
    columns = plain() | {column: [math.nan] * ROWS}
    message = rf"none of its {ROWS} splats can be drawn: {ROWS} for .*nan or inf in {field}; export it again"
    for options in ({}, {"max_splats": 3}):
        with pytest.raises(LoadError, match=message):
            loaded(tmp_path, file_of(columns), **options)


def test_a_scene_too_faint_to_be_seen_says_so(tmp_path: Path) -> None:
    with pytest.warns(LoadWarning, match=rf"{ROWS} of {ROWS} splats are too faint to be seen"):
        loaded(tmp_path, file_of(plain() | {"opacity": [-9.0] * ROWS}))


@pytest.mark.parametrize("limit", [None, 7])
def test_raw_scales_are_taken_as_they_are(tmp_path: Path, limit: int | None) -> None:
    columns = plain()
    linear = {name: np.exp(columns[name]).tolist() if name[:5] == "scale" else columns[name] for name in columns}
    options = {"max_splats": limit} if limit else {}
    found = loaded(tmp_path, file_of(linear, scalar="double"), raw_scales=True, **options)
    check_same(found, loaded(tmp_path, file_of(columns), **options))
    with pytest.warns(LoadWarning, match=rf"{3 * ROWS} of {3 * ROWS} scales were negative and lost their sign"):
        loaded(tmp_path, file_of(columns), raw_scales=True, **options)


def test_a_checkpoint_may_be_raw_as_well(tmp_path: Path) -> None:
    columns = plain()
    raw = {name: np.exp(columns[name]).tolist() if name[:5] == "scale" else columns[name] for name in columns}
    raw["opacity"] = [1.0 / (1.0 + math.exp(-value)) for value in columns["opacity"]]
    expected = loaded(tmp_path, file_of(columns))
    check_same(load(saved_npz(tmp_path, raw), raw_scales=True, raw_opacity=True), expected)
    with pytest.warns(LoadWarning, match=f"of {ROWS} opacities lay outside 0 to 1 and were clamped"):
        load(saved_npz(tmp_path, columns), raw_opacity=True)


def test_splats_that_move_are_drawn_without_and_it_is_said(tmp_path: Path) -> None:
    columns = plain() | {name: [0.5] * ROWS for name in ("trbf_center", "motion_0", "omega_3")}
    with pytest.warns(LoadWarning, match="columns trbf_center, motion_0, omega_3 say how splats move in time"):
        assert len(loaded(tmp_path, file_of(columns))) == ROWS


def test_columns_that_go_by_another_name_are_named_beside_the_missing_ones(tmp_path: Path) -> None:
    columns = renamed(plain(), lambda name: name.replace("f_dc_", "features_dc_"))
    with pytest.raises(CorruptFileError, match=r"missing: f_dc_0, f_dc_1, f_dc_2, but there are 'features_dc_0'"):
        loaded(tmp_path, file_of(columns))


WORDS = {
    "nan(ind)": math.nan,
    "-nan(ind)": math.nan,
    "-NaN(IND)": math.nan,
    "nan(0x7fffff)": math.nan,
    "1.#QNAN": math.nan,
    "-1.#IND00": math.nan,
    "1.#R": math.nan,
    "1.#INF": math.inf,
    "-1.#INF00": -math.inf,
    "+inf": math.inf,
    "-Infinity": -math.inf,
}


@pytest.mark.parametrize("word", WORDS)
def test_a_word_for_no_number_costs_its_own_splat_alone(tmp_path: Path, word: str) -> None:
    columns = plain()
    columns["x"][3] = columns["opacity"][5] = 12345.0
    text = file_of(columns, kind="ascii").replace(b"12345.0", word.encode(), 1)
    text = text.replace(b"12345.0", word.encode() if math.isinf(WORDS[word]) else b"0.5", 1)
    with pytest.warns(LoadWarning, match=f"dropped 1 of {ROWS} splats"):
        found = loaded(tmp_path, text)
    assert len(found) == ROWS - 1
    if math.isinf(WORDS[word]):
        assert found.opacities[4] == (WORDS[word] > 0.0)


def test_empty_lines_and_comments_between_rows_are_passed_over(tmp_path: Path) -> None:
    text = file_of(plain(), kind="ascii")
    head, body = text.split(b"end_header\n")
    broken = head + b"end_header\r\n\r\n" + body.replace(b"\n", b"\r\n\r\n \ncomment by hand\n")
    check_same(loaded(tmp_path, broken), loaded(tmp_path, text))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            b"12345.0",
            b"0,5",
            r"row 3 of .* holds a word that is no number, '0,5'; write decimals with a point",
        ),
        (b"12345.0", b"\x1b[2J", r"no number, '\\x1b\[2J'; the file is damaged"),
        (b" ", b",", "row 0 of 'vertex' has 1 values, expected 14; put spaces between them"),
    ],
)
def test_other_words_are_refused_with_a_remedy(tmp_path: Path, old: bytes, new: bytes, message: str) -> None:
    columns = plain()
    columns["x"][3] = 12345.0
    head, body = file_of(columns, kind="ascii").split(b"end_header\n")
    with pytest.raises(CorruptFileError, match=message):
        loaded(tmp_path, head + b"end_header\n" + body.replace(old, new))


def test_what_is_read_in_its_own_way_is_written_in_the_usual_one(tmp_path: Path) -> None:
    columns = with_rgb(plain(), 255.0, RGB) | {"filter_3D": [0.01] * ROWS}
    found = loaded(tmp_path, file_of(renamed(columns, lambda name: f"scalar_{name}")))
    again = load(save(tmp_path / "again.ply", found))
    check_same(again, found)
    assert again.antialiased


FIELD = field_files()

HOUSES = {
    "c01_rgb_mode.ply": ("", 0.01),
    "c02_2dgs.ply": ("scales", 0.0),
    "c02b_scale_minus_inf.ply": ("scales", 0.0),
    "c06_cloudcompare.ply": ("", 0.0),
    "c13_opacity_inf.ply": ("opacities", 0.0),
    "c13b_opacity_half_inf.ply": ("opacities", 0.0),
    "e01_half_in_ushort.ply": ("", 0.002),
}
"""What is meant to differ from the house, and how far the rest may be off."""


@pytest.mark.skipif(not FIELD.is_dir(), reason="no folder of odd files: have ../shared/field")
@pytest.mark.filterwarnings("ignore::tsplat.errors.LoadWarning")
@pytest.mark.parametrize("name", HOUSES)
def test_a_file_from_the_field_is_the_house_that_it_should_be(name: str) -> None:
    differs, atol = HOUSES[name]
    house, found = load(FIELD / "ref_house.ply"), load(FIELD / name)
    check_same(found, house, [each for each in ALL if each != differs], atol)
    if differs == "scales":
        check_flat = np.sort(house.scales, axis=1)[:, 1:] if "-" in name else house.scales[:, :2]
        np.testing.assert_array_equal(found.scales[:, :2], check_flat)
        assert not found.scales[:, 2].any()
    if differs == "opacities":
        assert set(found.opacities.tolist()) <= {0.5, 1.0}
