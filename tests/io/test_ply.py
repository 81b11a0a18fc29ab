"""Splat PLY files: every encoding against a slow reader, and every way to be broken."""

from __future__ import annotations

import math
import struct
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.io.outcomes import within_memory
from tests.io.plys import (
    FORMATS,
    STRUCT_CODES,
    Table,
    decoded,
    header_lines,
    one_splat,
    ply_bytes,
    read_slowly,
    row_bytes,
    splat_names,
    splats,
)
from tests.scenes import random_gaussians, shared_scenes
from tsplat import io
from tsplat.errors import CorruptFileError, LoadError, LoadWarning
from tsplat.importance import importance
from tsplat.io import ply, ply_rows
from tsplat.scene import Gaussians

FACES = Table(
    "face", [("list uchar int", "vertex_indices"), ("uchar", "flag")], [[[0, 1, 2], 7], [[], 8], [[5], 9]]
)
NOTES = Table("note", [("double", "time"), ("short", "kind")], [[1.5, -3], [2.5, 4]])


@pytest.fixture
def chunks_of_few_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make three splats of degree 0 a chunk, so that small files have many."""
    monkeypatch.setattr(ply_rows, "CHUNK_BYTES", 3 * 4 * len(splat_names(0)))


def load_bytes(folder: Path, raw: bytes, **options: Any) -> Gaussians:
    path = folder / "scene.ply"
    path.write_bytes(raw)
    return io.load(path, **options)


def check_rows(gaussians: Gaussians, rows: list[dict[str, float]]) -> None:
    assert len(gaussians) == len(rows)
    for index, row in enumerate(rows):
        for name, values in decoded(row).items():
            np.testing.assert_allclose(np.ravel(getattr(gaussians, name)[index]), values, 2e-6, 1e-7, err_msg=name)


@st.composite
def ply_files(draw: st.DrawFn) -> tuple[bytes, list[dict[str, float]]]:
    """Return a file and its rows: any format, types, order of columns, extra columns and elements."""
    names = [*splat_names(draw(st.integers(0, 3))), "nx", "label"]
    names = draw(st.permutations(names))
    columns = [(draw(st.sampled_from(sorted(STRUCT_CODES))), name) for name in names]
    seed, count = draw(st.integers(0, 2**32 - 1)), draw(st.integers(0, 4))
    rng = np.random.default_rng(seed)
    rows = [[_value(rng, STRUCT_CODES[scalar], name) for scalar, name in columns] for _ in range(count)]
    before = draw(st.lists(st.sampled_from([FACES, NOTES]), unique_by=id))
    after = [table for table in (FACES, NOTES) if table not in before]
    tables = [*before, Table("vertex", columns, rows), *after]
    raw = ply_bytes(tables, draw(st.sampled_from(FORMATS)), draw(st.sampled_from(["\n", "\r\n"])))
    return raw, [dict(zip(names, row, strict=True)) for row in rows]


def _value(rng: np.random.Generator, code: str, name: str) -> float:
    if code in "fd":
        value = float(rng.normal())
        return struct.unpack("f", struct.pack("f", value))[0] if code == "f" else value
    # rot_0 above 0 keeps a quat of whole numbers from being zero.
    return int(rng.integers(1 if name == "rot_0" else 0, 9))


@settings(deadline=None)
@given(ply_files())
def test_every_encoding_means_what_the_slow_reader_says(
    tmp_path_factory: pytest.TempPathFactory, file: tuple[bytes, list[dict[str, float]]]
) -> None:
    raw, rows = file
    check_rows(load_bytes(tmp_path_factory.mktemp("ply"), raw), rows)


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("sh_degree", range(5))
def test_the_rest_of_the_colours_is_channel_major(tmp_path: Path, kind: str, sh_degree: int) -> None:
    names = splat_names(sh_degree)
    row = [float(name[7:]) if name.startswith("f_rest_") else 1.0 for name in names]
    sh = load_bytes(tmp_path, ply_bytes([splats([row], sh_degree)], kind)).sh
    k = (sh_degree + 1) ** 2
    assert sh.shape == (1, k, 3)
    assert sh[0, 1:].T.ravel().tolist() == list(range(3 * (k - 1)))


@pytest.mark.usefixtures("chunks_of_few_rows")
@pytest.mark.parametrize("kind", FORMATS)
def test_chunks_join_without_a_seam(tmp_path: Path, kind: str) -> None:
    rows = [one_splat(x=float(index)) for index in range(10)]
    assert load_bytes(tmp_path, ply_bytes([splats(rows)], kind)).means[:, 0].tolist() == list(range(10))


@pytest.mark.usefixtures("chunks_of_few_rows")
@pytest.mark.parametrize("kind", FORMATS)
def test_broken_splats_are_left_out_and_counted_once(tmp_path: Path, kind: str) -> None:
    broken = [
        one_splat(x=math.nan),
        one_splat(f_dc_2=math.inf),
        one_splat(opacity=math.nan),
        one_splat(scale_1=100.0),
        one_splat(scale_1=math.inf),
        one_splat(rot_0=0.0),
        one_splat(rot_3=math.nan),
    ]
    rows = [one_splat(x=1.0), *broken[:4], one_splat(x=2.0), one_splat(x=3.0), *broken[4:], one_splat(x=4.0)]
    with pytest.warns(LoadWarning, match=r"dropped 7 of 11 splats: nan, inf or a zero quat") as caught:
        gaussians = load_bytes(tmp_path, ply_bytes([splats(rows)], kind))
    assert len(caught) == 1
    assert caught[0].filename == __file__, "the warning points at the caller of load"
    assert gaussians.means[:, 0].tolist() == [1.0, 2.0, 3.0, 4.0]


def test_a_double_too_large_for_float32_is_dropped_without_another_warning(tmp_path: Path) -> None:
    rows = [one_splat(x=1e300), one_splat(y=5.0)]
    with pytest.warns(LoadWarning, match="dropped 1 of 2"):
        assert len(load_bytes(tmp_path, ply_bytes([splats(rows, scalar="double")]))) == 1


def test_quats_of_any_length_become_unit(tmp_path: Path) -> None:
    rows = [one_splat(rot_0=3.0, rot_1=4.0), one_splat(rot_0=1e-30), one_splat(rot_0=1e30, rot_2=1e30)]
    quats = load_bytes(tmp_path, ply_bytes([splats(rows)])).quats
    half = math.sqrt(0.5)
    np.testing.assert_allclose(quats, np.array([[0.6, 0.8, 0, 0], [1, 0, 0, 0], [half, 0, half, 0]]), rtol=1e-6)


def test_extreme_logits_stay_opacities(tmp_path: Path) -> None:
    rows = [one_splat(opacity=value) for value in (-1000.0, 0.0, 1000.0)]
    assert load_bytes(tmp_path, ply_bytes([splats(rows)])).opacities.tolist() == [0.0, 0.5, 1.0]


def test_raw_opacities_are_taken_as_they_are(tmp_path: Path) -> None:
    rows = [one_splat(opacity=value) for value in (0.0, 0.25, 1.0, 1.0005)]
    gaussians = load_bytes(tmp_path, ply_bytes([splats(rows)]), raw_opacity=True)
    assert gaussians.opacities.tolist() == [0.0, 0.25, 1.0, 1.0]


@pytest.mark.parametrize("max_splats", [None, 2])
def test_logits_read_as_raw_opacities_are_clamped_with_a_warning(tmp_path: Path, max_splats: int | None) -> None:
    raw = ply_bytes([splats([one_splat(opacity=value) for value in (-3.0, 0.5, 7.0)])])
    with pytest.warns(LoadWarning, match="2 of 3 opacities lay outside 0 to 1 and were clamped"):
        load_bytes(tmp_path, raw, raw_opacity=True, max_splats=max_splats)


@pytest.mark.usefixtures("chunks_of_few_rows")
@pytest.mark.parametrize("limit", [1, 5, 39, 40, 41])
def test_a_limit_keeps_the_splats_that_matter_most_in_file_order(
    tmp_path: Path, rng: np.random.Generator, limit: int
) -> None:
    io.save(tmp_path / "all.ply", random_gaussians(rng, 40, 0))
    whole = io.load(tmp_path / "all.ply")
    best = np.sort(np.argsort(-importance(whole.scales, whole.opacities))[:limit])
    np.testing.assert_array_equal(io.load(tmp_path / "all.ply", max_splats=limit).means, whole.means[best])


@pytest.mark.usefixtures("chunks_of_few_rows")
def test_a_limit_breaks_ties_by_file_order_and_skips_broken_splats(tmp_path: Path) -> None:
    rows = [one_splat(x=float(index)) for index in range(9)]
    rows[1] = one_splat(x=math.nan, scale_0=9.0, scale_1=9.0)
    with pytest.warns(LoadWarning, match="dropped 1 of 9"):
        gaussians = load_bytes(tmp_path, ply_bytes([splats(rows)]), max_splats=5)
    assert gaussians.means[:, 0].tolist() == [0.0, 2.0, 3.0, 4.0, 5.0]


@pytest.mark.parametrize("kind", FORMATS[:2])
def test_a_file_cut_anywhere_is_refused(tmp_path: Path, kind: str) -> None:
    whole = ply_bytes([FACES, splats([one_splat(), one_splat()])], kind)
    assert len(load_bytes(tmp_path, whole)) == 2
    for length in range(1, len(whole)):
        with pytest.raises(CorruptFileError, match=r"scene\.ply"):
            load_bytes(tmp_path, whole[:length])


def test_rows_missing_behind_lists_are_noticed_before_anything_is_allocated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lists = Table("face", [("list ushort int", "vertex_indices")], [[list(range(5000))]])
    raw = ply_bytes([lists, splats([one_splat()])]).replace(b"element vertex 1\n", b"element vertex 9\n")
    monkeypatch.delattr(ply, "Decoder")
    with pytest.raises(CorruptFileError, match="ends in row 1 of 9 of 'vertex'"):
        load_bytes(tmp_path, raw)


def test_a_text_file_cut_between_two_words_is_refused(tmp_path: Path) -> None:
    whole = ply_bytes([FACES, splats([one_splat(), one_splat()])], "ascii").rstrip(b"\n")
    assert len(load_bytes(tmp_path, whole)) == 2
    for length in (index for index in range(1, len(whole)) if whole[index : index + 1].isspace()):
        with pytest.raises(CorruptFileError, match=r"scene\.ply"):
            load_bytes(tmp_path, whole[:length])


def test_a_file_that_shrinks_while_it_is_read_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scene.ply"
    path.write_bytes(ply_bytes([splats([one_splat()] * 40_000)]))

    def cut(_: float) -> None:
        with path.open("r+b") as file:
            file.truncate(1_000_000)

    with pytest.raises(CorruptFileError, match=r"ends in row \d+ of 40000 of 'vertex'; the file is truncated"):
        io.load(path, progress=cut)


BELLS = "\a" * 999

HEADER_FAULTS: dict[str, tuple[Callable[[str], str], str]] = {
    "no end_header": (lambda text: text.replace("end_header\n", ""), "no end_header"),
    "no format": (lambda text: text.replace("format binary_little_endian 1.0\n", ""), "no format line"),
    "unknown format": (lambda text: text.replace("little", "middle"), "is not understood"),
    "two formats": (lambda text: text.replace("comment", "format ascii 1.0\ncomment"), "is not understood"),
    "other version": (lambda text: text.replace("1.0", "2.0"), "is not understood"),
    "unknown line": (
        lambda text: text.replace("comment made", "elephant made"),
        "'elephant made for a test' is not",
    ),
    "negative count": (
        lambda text: text.replace("vertex 2", "vertex -2"),
        "has count '-2', expected a whole number",
    ),
    "count is no number": (lambda text: text.replace("vertex 2", "vertex two"), "has count 'two'"),
    "absurd count": (
        lambda text: text.replace("vertex 2", "vertex 9" + "0" * 17),
        "need at least .* bytes, 1[0-9]* are",
    ),
    "endless count": (lambda text: text.replace("vertex 2", "vertex 9" + "0" * 400), "has count '90000"),
    "count too large by one": (
        lambda text: text.replace("vertex 2", "vertex 3"),
        "3 'vertex' need at least 168 bytes",
    ),
    "unknown type": (lambda text: text.replace("float x", "half x"), "'half x' of 'vertex', expected a type"),
    "names of bells": (
        lambda text: text.replace("end_", f"element {BELLS} 0\nproperty {BELLS} x\nend_"),
        r"property '(\\x07){13}\\x0\.\.\.' of '(\\x07){13}",
    ),
    "list of unknown type": (lambda text: text.replace("float x", "list uchar half x"), "expected a type"),
    "list with a fractional length": (lambda text: text.replace("float x", "list float int x"), "expected a type"),
    "twice the same property": (
        lambda text: text.replace("float y", "float x"),
        "'x' of 'vertex' is declared twice",
    ),
    "twice the same element": (lambda text: text.replace("end_", "element vertex 0\nend_"), "is declared twice"),
    "property before any element": (
        lambda text: text.replace("comment", "property float q\ncomment"),
        "not understood",
    ),
    "missing properties": (
        lambda text: text.replace("rot_3", "rod_3").replace("float z", "float zz"),
        "missing: z, rot_3",
    ),
    "one f_rest": (
        lambda text: text.replace("end_", "property float f_rest_0\nend_"),
        "1 properties f_rest_.*, expected",
    ),
    "too many elements": (
        lambda text: text.replace("end_", "".join(f"element e{i} 0\n" for i in range(100)) + "end_"),
        "more than 100 elements",
    ),
    "too many properties": (
        lambda text: text.replace("end_", "".join(f"property char c{i}\n" for i in range(1000)) + "end_"),
        "more than 1000 properties",
    ),
    "endless header": (lambda text: text.replace("test", "test" * 100_000), "no end_header in the first 262144"),
}


@pytest.mark.parametrize("name", HEADER_FAULTS)
def test_a_broken_header_is_one_clear_line(tmp_path: Path, name: str) -> None:
    change, message = HEADER_FAULTS[name]
    tables = [splats([one_splat(), one_splat()])]
    text = "\n".join(header_lines("binary_little_endian", tables)) + "\n"
    assert change(text) != text
    body = b"".join(row_bytes(tables[0], row, "binary_little_endian") for row in tables[0].rows)
    with pytest.raises(CorruptFileError, match=message) as caught:
        load_bytes(tmp_path, change(text).encode("ascii") + body)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400 + len(str(tmp_path))


def test_f_rest_names_that_skip_a_number_are_named(tmp_path: Path) -> None:
    raw = ply_bytes([splats([[1.0] * 23], 1)]).replace(b"f_rest_4", b"f_rest_9")
    with pytest.raises(CorruptFileError, match="missing: f_rest_4"):
        load_bytes(tmp_path, raw)


def test_names_from_a_file_reach_the_message_without_control_characters(tmp_path: Path) -> None:
    for line in (
        b"property float \x1b]0;pwned\x07",
        b"element \x1b[31m 5x",
        b"\x1b[2J",
        b"property \x9b1m\xff \xe9",
    ):
        raw = ply_bytes([splats([one_splat()])]).replace(b"end_header", line + b"\n" + line + b"\nend_header")
        with pytest.raises(CorruptFileError) as caught:
            load_bytes(tmp_path, raw)
        assert str(caught.value).isprintable()
        assert str(caught.value).isascii()
    raw = ply_bytes([splats([one_splat()])]).replace(
        b"element vertex 1", b"element \x1b[31m 9999999\nproperty int \x1b\nelement vertex 1"
    )
    with pytest.raises(CorruptFileError, match=r"9999999 '\\x1b\[31m', 1 'vertex' need"):
        load_bytes(tmp_path, raw)


@pytest.mark.parametrize("kind", FORMATS[:2])
def test_a_list_of_negative_length_is_refused(tmp_path: Path, kind: str) -> None:
    lists = Table("face", [("list char int", "vertex_indices")], [[[1]]])
    raw = ply_bytes([lists, splats([one_splat()])], kind)
    start = raw.index(b"end_header\n") + len(b"end_header\n")
    with pytest.raises(CorruptFileError, match=rf"at byte {start}: row 0 of 'face' has a list of length -1"):
        load_bytes(tmp_path, raw[:start] + b"\xff" + raw[start + 1 :])


@pytest.mark.parametrize(
    ("word", "message"), [("zero", "a word that is no number"), ("0.0 0.0", "has 15 values, expected 14")]
)
def test_a_line_that_is_no_row_is_refused(tmp_path: Path, word: str, message: str) -> None:
    lines = ply_bytes([splats([one_splat(x=7.5), one_splat()])], "ascii").decode().replace("7.5", word)
    with pytest.raises(CorruptFileError, match=message):
        load_bytes(tmp_path, lines.encode())


def test_a_number_of_many_digits_takes_no_room_from_the_others(tmp_path: Path) -> None:
    rows = splats([one_splat(x=7.5), *[one_splat()] * 199])
    path = tmp_path / "scene.ply"
    path.write_bytes(ply_bytes([rows], "ascii").replace(b"7.5", b"7.5" + b"0" * 100_000))
    gaussians = within_memory(path, 0)
    assert gaussians is not None
    assert gaussians.means[0, 0] == 7.5


OTHER_KINDS = {
    "a compressed PLY without chunks": (
        [("uint", "packed_position"), ("uint", "packed_color")],
        "no element 'chunk'.*export the scene again",
    ),
    "neither splats nor points": ([("float", name) for name in ("x", "y", "red")], "properties missing: z"),
    "anchors of Scaffold-GS": (
        [("float", name) for name in (*splat_names(0), "f_offset_0", "f_anchor_feat_0")],
        "anchors of Scaffold-GS.*only its trained networks make splats of them",
    ),
    "lists in vertices": ([("list uchar int", "neighbours"), ("float", "x")], "'neighbours' is a list"),
}


@pytest.mark.parametrize("name", OTHER_KINDS)
def test_a_ply_that_holds_no_splats_is_refused_by_its_kind(tmp_path: Path, name: str) -> None:
    columns, message = OTHER_KINDS[name]
    with pytest.raises(LoadError, match=message):
        load_bytes(tmp_path, ply_bytes([Table("vertex", columns, [])]))


def test_a_ply_without_vertices_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LoadError, match="no element 'vertex'"):
        load_bytes(tmp_path, ply_bytes([FACES]))


def test_bytes_after_the_last_row_do_no_harm(tmp_path: Path) -> None:
    assert len(load_bytes(tmp_path, ply_bytes([splats([one_splat()])]) + b"more")) == 1


@pytest.mark.parametrize("sh_degree", range(5))
def test_saving_and_loading_keeps_the_scene(tmp_path: Path, rng: np.random.Generator, sh_degree: int) -> None:
    before = random_gaussians(rng, 9001, sh_degree)
    after = io.load(io.save(tmp_path / "scene.ply", before))
    for name in ("means", "quats", "scales", "opacities", "sh"):
        np.testing.assert_allclose(getattr(after, name), getattr(before, name), 1e-5, 1e-6, err_msg=name)


def test_saving_writes_what_the_slow_reader_reads(tmp_path: Path, rng: np.random.Generator) -> None:
    before = random_gaussians(rng, 5, 3)
    raw = io.save(tmp_path / "scene.ply", before).read_bytes()
    rows = read_slowly(raw, 5)
    assert list(rows[0])[:6] == ["x", "y", "z", "nx", "ny", "nz"]
    check_rows(before, rows)


def test_saving_keeps_the_ends_of_every_range_finite(tmp_path: Path) -> None:
    before = Gaussians(
        np.zeros((2, 3), np.float32),
        np.array([[1, 0, 0, 0]] * 2, np.float32),
        np.array([[0, 1, 1e-30], [1e30, 1, 1]], np.float32),
        np.array([0, 1], np.float32),
        np.zeros((2, 1, 3), np.float32),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        after = io.load(io.save(tmp_path / "scene.ply", before))
    np.testing.assert_allclose(after.opacities, before.opacities, atol=2e-7)
    np.testing.assert_allclose(after.scales, before.scales, rtol=1e-4, atol=2e-38)


SCENES = shared_scenes()


@pytest.mark.skipif(SCENES is None, reason="no folder of real scenes: set TSPLAT_SCENES or have ../shared/scenes")
@pytest.mark.parametrize(
    ("name", "count", "sh_degree"),
    [
        ("ply/plant.ply", 113_648, 0),
        ("ply/playbot_500k_sh2.ply", 500_000, 2),
        ("format_matrix/yashica.ply", 8192, 3),
        ("snowmiku/trained/snow_sh3_3000.ply", 37_900, 3),
    ],
)
def test_real_scenes_load_as_the_slow_reader_reads_them(name: str, count: int, sh_degree: int) -> None:
    assert SCENES is not None
    gaussians = io.load(SCENES / name)
    assert (len(gaussians), gaussians.sh_degree) == (count, sh_degree)
    check_rows(gaussians.take(range(50)), read_slowly((SCENES / name).read_bytes(), 50))
