"""Points without sizes: of a PLY, of a mesh, of COLMAP; and how large they are drawn."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.io.colmaps import Point, colmap_binary, colmap_text
from tests.io.plys import FORMATS, Table, ply_bytes
from tests.scenes import field_files
from tsplat.errors import CorruptFileError, LoadWarning
from tsplat.io import load
from tsplat.io.points import SIGMA, SPREAD, point_sizes
from tsplat.scene import SH_C0, Gaussians

POINTS: list[Point] = [
    (float(x), 2.0 * y, 0.25 * x * y, 40 * x, 250 - 30 * y, 7) for x in range(4) for y in range(3)
]
RGB = ("red", "green", "blue")
FACES = Table("face", [("list uchar int", "vertex_indices")], [[[0, 1, 2]]])
SAID = "are drawn as balls, sized by their neighbours; for splats, open what training wrote"


def cloud(colors: str = "uchar", faces: bool = False, kind: str = FORMATS[0], white: float = 255.0) -> bytes:
    columns = [*(("float", axis) for axis in "xyz"), ("float", "nx"), *((colors, name) for name in RGB)]
    rows = [
        [x, y, z, 0.0, *(color * white / 255.0 if colors == "float" else int(color) for color in rgb)]
        for x, y, z, *rgb in POINTS
    ]
    return ply_bytes([Table("vertex", columns, rows), *([FACES] if faces else [])], kind)


FILES: dict[str, tuple[str, bytes, str]] = {
    "a PLY": ("input.ply", cloud(), "is a point cloud: its 12 points"),
    "an ASCII PLY": ("input.ply", cloud(kind="ascii"), "is a point cloud: its 12 points"),
    "a PLY of colours from 0 to 1": ("input.ply", cloud("float", white=1.0), "is a point cloud: its 12 points"),
    "a PLY of colours to 255 as floats": ("input.ply", cloud("float"), "is a point cloud: its 12 points"),
    "a mesh": ("mesh.ply", cloud(faces=True), "is a mesh: its 12 points"),
    "COLMAP's points": ("points3D.bin", colmap_binary(POINTS), "is a point cloud of COLMAP: its 12 points"),
    "COLMAP's text": ("points3D.txt", colmap_text(POINTS), "is a point cloud of COLMAP: its 12 points"),
    "its text by another name": ("sparse.x", colmap_text(POINTS), "is a point cloud of COLMAP: its 12 points"),
    "text without a header": (
        "points3D.txt",
        b"\n\n".join(colmap_text(POINTS).splitlines()[3:]),
        "is a point cloud of COLMAP: its 12 points",
    ),
}


def loaded(folder: Path, name: str, content: bytes, **options: int) -> Gaussians:
    path = folder / name
    path.write_bytes(content)
    return load(path, **options)


@pytest.mark.parametrize("name", FILES)
def test_points_are_drawn_as_balls_and_it_is_said(tmp_path: Path, name: str) -> None:
    file, content, said = FILES[name]
    with pytest.warns(LoadWarning, match=f"{said} {SAID}") as caught:
        found = loaded(tmp_path, file, content)
    assert len(caught) == 1
    assert caught[0].filename == __file__, "the warning points at the caller of load"
    means = np.array(POINTS)[:, :3]
    np.testing.assert_allclose(found.means, means)
    np.testing.assert_allclose(SH_C0 * found.sh[:, 0] + 0.5, np.array(POINTS)[:, 3:] / 255.0, atol=1e-6)
    distances = np.linalg.norm(means[:, None] - means[None], axis=2)
    nearest = np.sort(distances, axis=1)[:, 1:4].mean(axis=1)
    np.testing.assert_allclose(found.scales, SIGMA * np.repeat(nearest[:, None], 3, axis=1), 1e-6)
    assert found.opacities.tolist() == [1.0] * 12
    assert found.quats.tolist() == [[1.0, 0.0, 0.0, 0.0]] * 12


@pytest.mark.filterwarnings("ignore::tsplat.errors.LoadWarning")
@pytest.mark.parametrize(
    ("names", "row", "colors"),
    [
        ((), [], [[0.5] * 3] * 3),
        (("scalar_Intensity",), [10.0, 20.0, 30.0], [[0.0] * 3, [0.5] * 3, [1.0] * 3]),
        (("Reflectance",), [-3e38, 0.0, 3e38], [[0.0] * 3, [0.5] * 3, [1.0] * 3]),
        (("f_dc_0", "f_dc_1", "f_dc_2"), [0.0, 0.0, 0.0], [[0.5] * 3] * 3),
    ],
    ids=["no colours", "intensities", "as far as numbers go", "harmonics"],
)
def test_points_without_colours_are_grey(
    tmp_path: Path, names: tuple[str, ...], row: list[float], colors: list[list[float]]
) -> None:
    rows = [[float(i), 0.0, 0.0, *([row[i]] * len(names) if row else [])] for i in range(3)]
    content = ply_bytes([Table("vertex", [("float", name) for name in ("x", "y", "z", *names)], rows)])
    found = loaded(tmp_path, "scan.ply", content)
    np.testing.assert_allclose(SH_C0 * found.sh[:, 0] + 0.5, colors, atol=0.02)


@pytest.mark.filterwarnings("ignore::tsplat.errors.LoadWarning")
@pytest.mark.parametrize("suffix", ["ply", "bin", "txt"])
def test_points_that_are_nowhere_are_left_out_and_the_largest_kept(tmp_path: Path, suffix: str) -> None:
    points = [(math.nan, 0.0, 0.0, 0, 0, 0), *POINTS, (0.0, math.inf, 0.0, 0, 0, 0)]
    if suffix == "ply":
        columns = [("float", axis) for axis in "xyz"]
        content, name = ply_bytes([Table("vertex", columns, [point[:3] for point in points])]), "scene.ply"
    else:
        content, name = (colmap_binary if suffix == "bin" else colmap_text)(points), f"points3D.{suffix}"
    found = loaded(tmp_path, name, content)
    assert len(found) == 12
    few = loaded(tmp_path, name, content, max_splats=5)
    assert few.scales[:, 0].tolist() == [size for size in found.scales[:, 0] if size in few.scales][:5]
    assert few.scales.min() >= np.sort(found.scales[:, 0])[-5]


CLOUDS: dict[str, tuple[list[list[float]], list[float]]] = {
    "none": ([], []),
    "one": ([[5.0, 5.0, 5.0]], [SIGMA]),
    "two": ([[0.0, 0.0, 0.0], [0.0, 3.0, 4.0]], [5 * SIGMA] * 2),
    "all at one place": ([[1.0, 2.0, 3.0]] * 50, [SIGMA] * 50),
    "twins": ([[0.0, 0.0, 0.0]] * 4 + [[float(i), 9.0, 0.0] for i in range(40)], [SIGMA / SPREAD * 4 / 3] * 4),
    "one far away": ([[float(i % 9), float(i // 9), 0.0] for i in range(81)] + [[1e6, 0.0, 0.0]], []),
    "as far as numbers go": ([[3e38, 0.0, 0.0], [-3e38, 0.0, 0.0], [0.0, 3e38, 0.0]], []),
}


@pytest.mark.parametrize("name", CLOUDS)
def test_sizes_are_sound_whatever_the_points(name: str) -> None:
    points, expected = CLOUDS[name]
    sizes = point_sizes(np.array(points, np.float32).reshape(-1, 3))
    assert len(sizes) == len(points)
    assert np.isfinite(sizes).all()
    assert (sizes > 0.0).all()
    np.testing.assert_allclose(sizes[: len(expected)], expected)
    if len(sizes):
        usual = float(np.median(sizes))
        assert usual / (1.01 * SPREAD) <= sizes.min()
        assert float(sizes.max()) <= 1.01 * SPREAD * usual


def cut(raw: bytes) -> bytes:
    return raw[:-3]


BROKEN: dict[str, tuple[str, Callable[[], bytes], str]] = {
    "a count cut off": ("points3D.bin", lambda: b"\1\0\0", "holds 3 bytes, expected a count of 8"),
    "a count beyond the file": (
        "points3D.bin",
        lambda: struct.pack("<Q", 2**62) + bytes(51),
        "says 4611686018427387904 points, which need 51 bytes each, but holds 59",
    ),
    "the last point cut off": (
        "points3D.bin",
        lambda: cut(colmap_binary(POINTS)),
        "ends in point 11 of 12; it is truncated",
    ),
    "a point seen for ever": (
        "points3D.bin",
        lambda: colmap_binary(POINTS)[:51] + b"\xff" * 8 + colmap_binary(POINTS)[59:],
        "ends in point 1 of 12",
    ),
    "lines cut off": (
        "points3D.txt",
        lambda: b"\n".join(colmap_text(POINTS).splitlines()[:9]),
        "in point 6 of 12",
    ),
    "a line cut off": ("points3D.txt", lambda: b"# 3D point list\n1 2 3\n", "point 0 has 3 values, expected 7"),
    "a word": ("points3D.txt", lambda: b"1 2 3 x\x1b 5 6 7\n", r"point 0 holds a word .* 'x\\x1b'; fetch"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_points_of_colmap_are_one_line(tmp_path: Path, name: str) -> None:
    file, content, message = BROKEN[name]
    with pytest.raises(CorruptFileError, match=message) as caught:
        loaded(tmp_path, file, content())
    assert str(caught.value).isprintable()


@pytest.mark.filterwarnings("ignore::tsplat.errors.LoadWarning")
def test_a_line_that_is_longer_than_what_is_read_at_once_is_one_point(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tsplat.io.colmap_points.MAX_LINE", 64)
    monkeypatch.setattr("tsplat.io.colmap_points.LINES", 2)
    lines = [b"%d %d 0 0 1 2 3 0.5 " % (i, i) + b"7 8 " * 99 for i in range(5)]
    assert loaded(tmp_path, "points3D.txt", b"\n".join(lines)).means[:, 0].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]


FIELD = field_files()


@pytest.mark.skipif(not FIELD.is_dir(), reason="no folder of odd files: have ../shared/field")
def test_the_points_that_training_began_with_look_like_what_it_made() -> None:
    with pytest.warns(LoadWarning, match="is a point cloud: its 7116 points"):
        found = load(FIELD / "c11_model" / "input.ply")
    house = load(FIELD / "ref_house.ply")
    np.testing.assert_allclose(found.means, house.means)
    np.testing.assert_allclose(found.sh, house.sh, atol=0.01)
    assert 0.5 < np.median(found.scales) / np.median(house.scales.max(axis=1)) < 2.0
