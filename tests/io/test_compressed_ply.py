"""Compressed PLY files: every word against a slow reader, the real ones against their PLY twins."""

from __future__ import annotations

import math
import struct
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.io.compressed_plys import (
    BOUNDS,
    COLOR_BOUNDS,
    FIELDS,
    SCALE_BOUNDS,
    WORDS,
    assert_within_a_step,
    check,
    matched,
    small_tables,
    start_camera,
    tables,
)
from tests.io.plys import FORMATS, Table, one_splat, ply_bytes, splats
from tests.raster.compare import psnr
from tests.scenes import shared_scenes
from tsplat import io
from tsplat.errors import CorruptFileError, LoadError, LoadWarning, TsplatError
from tsplat.importance import importance
from tsplat.io import compressed_ply
from tsplat.raster import rasterize
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians

SCENES = shared_scenes()
NEEDS_SCENES = pytest.mark.skipif(
    SCENES is None, reason="no folder of real scenes: set TSPLAT_SCENES or have ../shared/scenes"
)


def load_bytes(folder: Path, raw: bytes, **options: Any) -> Gaussians:
    path = folder / "scene.ply"
    path.write_bytes(raw)
    return io.load(path, **options)


@pytest.mark.parametrize("sh_degree", range(4))
@pytest.mark.parametrize("kind", FORMATS[:2])
@pytest.mark.parametrize("colors", [True, False])
def test_every_word_means_what_the_slow_reader_says(
    tmp_path: Path, sh_degree: int, kind: str, colors: bool
) -> None:
    elements = small_tables(sh_degree, 600, colors)
    gaussians = load_bytes(tmp_path, ply_bytes(elements, kind))
    assert gaussians.sh_degree == sh_degree
    check(gaussians, elements)


def test_blocks_join_without_a_seam(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compressed_ply, "BLOCK", 512)
    elements = small_tables(1, 1300)
    check(load_bytes(tmp_path, ply_bytes(elements)), elements)


def test_a_splat_made_by_hand_is_where_its_bits_say(tmp_path: Path) -> None:
    head = b"ply\nformat binary_little_endian 1.0\nelement chunk 1\n"
    head += b"".join(b"property float %s\n" % name.encode() for name in BOUNDS + SCALE_BOUNDS + COLOR_BOUNDS)
    head += b"element vertex 1\n" + b"".join(b"property uint %s\n" % name.encode() for name in WORDS)
    head += b"element sh 1\n" + b"".join(b"property uchar f_rest_%d\n" % i for i in range(9)) + b"end_header\n"
    chunk = struct.pack("<18f", 0, 0, 0, 2047, 1023, 2047, -2047, 0, 0, 0, 0, 0, 0, 0, 0, 255, 255, 255)
    position, scale = 7 << 21 | 6 << 11 | 5, 2046 << 21
    rotation = 1 << 30 | 1023 << 20 | 511 << 10 | 512  # x left out, w at its largest, so x is about the same
    color = 10 << 24 | 20 << 16 | 30 << 8 | 51
    body = chunk + struct.pack("<4I9B", position, rotation, scale, color, 0, 1, 2, 64, 127, 128, 253, 254, 255)
    gaussians = load_bytes(tmp_path, head + body)
    np.testing.assert_allclose(gaussians.means, [[7, 6, 5]])
    np.testing.assert_allclose(gaussians.quats, [[math.sqrt(0.5), math.sqrt(0.5), 0, 0]], atol=1e-3)
    np.testing.assert_allclose(gaussians.scales, [[math.exp(-1), 1, 1]], rtol=1e-4)
    np.testing.assert_allclose(gaussians.opacities, [0.2])
    np.testing.assert_allclose(gaussians.sh[0, 0] * 0.28209479177387814 + 0.5, [10, 20, 30], rtol=1e-6)
    red, green, blue = [-4, -3.953125, -3.921875], [-1.984375, -0.015625, 0.015625], [3.921875, 3.953125, 4]
    np.testing.assert_allclose(gaussians.sh[0, 1:].T, [red, green, blue])


def test_a_long_comment_before_the_chunks_hides_nothing(tmp_path: Path) -> None:
    elements = small_tables()
    raw = ply_bytes(elements).replace(b"comment", b"comment " + b"so long " * 900 + b"\ncomment", 1)
    check(load_bytes(tmp_path, raw), elements)


def test_an_ordinary_ply_may_have_an_element_of_chunks(tmp_path: Path) -> None:
    raw = ply_bytes([Table("chunk", [("float", "min_x")], [[1.0]]), splats([one_splat(x=4.0)])])
    assert load_bytes(tmp_path, raw).means[0].tolist() == [4.0, 0.0, 0.0]


def test_columns_and_elements_that_mean_nothing_here_are_passed_over(tmp_path: Path) -> None:
    elements = small_tables()
    want = load_bytes(tmp_path, ply_bytes(elements))
    faces = Table("face", [("list uchar int", "vertex_indices")], [[[0, 1, 2]], [[]]])
    vertex = Table("vertex", [("double", "time"), *elements[1].columns], [[0.5, *row] for row in elements[1].rows])
    found = load_bytes(tmp_path, ply_bytes([faces, elements[2], vertex, elements[0]]))
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(found, name), getattr(want, name))


def test_a_file_of_no_splats_is_a_scene_of_none(tmp_path: Path) -> None:
    assert len(load_bytes(tmp_path, ply_bytes(tables([], [])))) == 0


def test_chunks_without_finite_bounds_are_left_out(tmp_path: Path) -> None:
    elements = small_tables(0, 600)
    whole = load_bytes(tmp_path, ply_bytes(elements))
    chunks = [list(chunk) for chunk in elements[0].rows]
    chunks[0][3], chunks[2][9] = math.nan, math.inf  # a position, a log scale
    elements[0].rows = chunks
    with pytest.warns(LoadWarning, match="dropped 344 of 600 splats: nan, inf or a zero quat") as caught:
        gaussians = load_bytes(tmp_path, ply_bytes(elements))
    assert len(caught) == 1
    assert caught[0].filename == __file__, "the warning points at the caller of load"
    np.testing.assert_array_equal(gaussians.means, whole.means[256:512])


def test_a_limit_keeps_the_splats_that_matter_most(tmp_path: Path) -> None:
    raw = ply_bytes(small_tables(1, 300))
    whole = load_bytes(tmp_path, raw)
    best = np.sort(np.argsort(-importance(whole.scales, whole.opacities))[:20])
    np.testing.assert_array_equal(load_bytes(tmp_path, raw, max_splats=20).means, whole.means[best])


@pytest.mark.parametrize("sh_degree", [0, 1])
def test_progress_grows_to_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sh_degree: int) -> None:
    monkeypatch.setattr(compressed_ply, "BLOCK", 256)
    seen: list[float] = []
    load_bytes(tmp_path, ply_bytes(small_tables(sh_degree, 1300)), progress=seen.append)
    assert seen == sorted(set(seen))
    assert len(seen) == 6
    assert seen[-1] == 1.0


def test_a_file_cut_anywhere_is_refused(tmp_path: Path) -> None:
    whole = ply_bytes(small_tables())
    assert len(load_bytes(tmp_path, whole)) == 3
    for length in range(1, len(whole)):
        with pytest.raises(CorruptFileError, match=r"scene\.ply"):
            load_bytes(tmp_path, whole[:length])


def test_a_file_that_shrinks_while_it_is_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compressed_ply, "BLOCK", 256)
    path = tmp_path / "scene.ply"
    path.write_bytes(ply_bytes(small_tables(0, 600)))

    def cut(_: float) -> None:
        with path.open("r+b") as file:
            file.truncate(path.stat().st_size - 20)

    with pytest.raises(CorruptFileError, match=r"ends in row \d+ of 600 of 'vertex'; the file is truncated"):
        io.load(path, progress=cut)


def test_damage_is_an_error_of_ours_or_no_error(tmp_path: Path) -> None:
    whole = ply_bytes(small_tables())
    rng = np.random.default_rng(3)
    refused = 0
    for _ in range(400):
        raw = bytearray(whole)
        for at in rng.integers(0, len(raw), rng.integers(1, 5)):
            raw[at] = rng.integers(0, 256)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", LoadWarning)
            try:
                load_bytes(tmp_path, bytes(raw))
            except TsplatError as error:
                refused += 1
                assert "\n" not in str(error)  # noqa: PT017 - most damage is refused, some only moves a splat
    assert 100 < refused < 400


@pytest.mark.parametrize("values", [[3e38, -3e38], [math.inf, -math.inf], [math.nan, math.nan]])
def test_bounds_of_any_size_warn_of_nothing_but_the_splats(tmp_path: Path, values: list[float]) -> None:
    elements = small_tables(0)
    elements[0].rows = [np.repeat(values, 9).tolist()]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(LoadError, match=r"none of its \d+ splats can be drawn: .* nan or inf in scales"):
            load_bytes(tmp_path, ply_bytes(elements))


def test_log_scales_of_minus_infinity_are_flat_splats(tmp_path: Path) -> None:
    elements = small_tables(0)
    bounds = list(elements[0].rows[0])
    names = [name for _, name in elements[0].columns]
    for axis in "yz":
        bounds[names.index(f"min_scale_{axis}")] = bounds[names.index(f"max_scale_{axis}")] = -math.inf
    place = [name for _, name in elements[1].columns].index("packed_scale")
    rows = [list(row) for row in elements[1].rows]
    rows[0][place], rows[1][place] = 0, 2**32 - 1  # the ends, at which infinity times zero would be nan
    elements[1].rows = rows
    before = load_bytes(tmp_path, ply_bytes(elements))
    elements[0].rows = [bounds]
    after = load_bytes(tmp_path, ply_bytes(elements))
    np.testing.assert_array_equal(after.scales[:, 0], before.scales[:, 0])
    assert not after.scales[:, 1:].any()


def test_bounds_that_signal_nan_warn_of_nothing_but_the_splats(tmp_path: Path) -> None:
    elements = small_tables(0)
    rows = np.asarray(elements[0].rows, np.float32)
    marked = float(np.float32(1.5))
    rows[0, 0] = marked
    elements[0].rows = rows.tolist()
    raw = ply_bytes(elements)
    place = raw.index(np.float32(marked).tobytes(), raw.index(b"end_header"))
    signalling = (0x7F800001).to_bytes(4, "little")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(LoadError, match=r"none of its \d+ splats can be drawn: .* nan or inf in means"):
            load_bytes(tmp_path, raw[:place] + signalling + raw[place + 4 :])


LIES: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "a huge count": (
        lambda raw: raw.replace(b"vertex 3", b"vertex 9" + b"0" * 14),
        r"chunk: 1 rows, expected 3515625000000 for 9",
    ),
    "huge counts that agree": (
        lambda raw: raw.replace(b"vertex 3", b"vertex 256000").replace(b"chunk 1", b"chunk 1000"),
        "sh: 3 rows, expected 256000",
    ),
    "huge counts that all agree": (
        lambda raw: (
            raw.replace(b"vertex 3", b"vertex 256000")
            .replace(b"chunk 1", b"chunk 1000")
            .replace(b"sh 3", b"sh 256000")
        ),
        "1000 'chunk', 256000 'vertex', 256000 'sh' need at least",
    ),
    "a chunk too many": (
        lambda raw: raw.replace(b"chunk 1", b"chunk 2"),
        "chunk: 2 rows, expected 1 for 3 splats",
    ),
    "a splat too few": (lambda raw: raw.replace(b"vertex 3", b"vertex 2"), "sh: 3 rows, expected 2 for 2 splats"),
    "half the colours": (
        lambda raw: raw.replace(b"float max_g", b"float max_q"),
        "chunk: properties missing or not float: max_g;",
    ),
    "signed words": (
        lambda raw: raw.replace(b"uint packed_scale", b"int packed_scale"),
        "vertex: properties missing or not uint: packed_scale",
    ),
    "words in a list": (
        lambda raw: raw.replace(b"uint packed_color", b"list uchar uint packed_color"),
        "vertex: properties missing or not uint: packed_color",
    ),
    "one more list": (
        lambda raw: raw.replace(b"element sh", b"property list uchar int more\nelement sh"),
        "vertex: has a list",
    ),
    "ten coefficients": (
        lambda raw: raw.replace(b"end_header", b"property uchar f_rest_9\nend_header"),
        r"sh: 10 properties, expected 9, 24, 45",
    ),
    "a coefficient of another name": (
        lambda raw: raw.replace(b"f_rest_4", b"f_rest_9"),
        "sh: properties missing or not uchar: f_rest_4",
    ),
}


@pytest.mark.parametrize("name", LIES)
def test_a_header_that_contradicts_itself_is_one_clear_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    change, message = LIES[name]
    raw = ply_bytes(small_tables())
    assert change(raw) != raw

    def too_early(*_: object, **__: object) -> None:
        raise AssertionError("allocated before the counts were checked")

    monkeypatch.setattr(np, "empty", too_early)
    with pytest.raises(CorruptFileError, match=message) as caught:
        load_bytes(tmp_path, change(raw))
    assert "\n" not in str(caught.value)


def test_compressed_splats_in_ascii_are_refused(tmp_path: Path) -> None:
    with pytest.raises(LoadError, match="a compressed PLY in ASCII, expected binary"):
        load_bytes(tmp_path, ply_bytes(small_tables(), "ascii"))


@NEEDS_SCENES
@pytest.mark.parametrize(("name", "floor"), [("yashica", 42.0), ("playbot31k", 50.0)])
def test_a_real_scene_agrees_with_its_ply_twin(name: str, floor: float) -> None:
    assert SCENES is not None
    folder = SCENES / "format_matrix"
    truth, found = io.load(folder / f"{name}.ply"), io.load(folder / f"{name}.compressed.ply")
    assert found.sh.shape == truth.sh.shape
    some = found.take([i for i in range(len(found)) if i // 256 % 4 == 0])  # every fourth chunk: the rest is alike
    assert_within_a_step(matched(truth, some), some)
    camera = start_camera(truth)
    images = [rasterize(gaussians, camera, RenderOptions()).colors for gaussians in (found, truth)]
    assert np.ptp(images[1]) > 0.5
    assert psnr(*images) >= floor
