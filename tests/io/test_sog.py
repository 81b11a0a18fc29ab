"""SOG scenes, zipped and in a folder: against a slow reader, and liars."""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.io import sogs
from tests.io.outcomes import within_memory
from tests.io.sogs import Scene, made_up, made_up_old, read_slowly, write_folder
from tsplat import io
from tsplat.errors import CorruptFileError, LoadError, OptionError, TsplatError
from tsplat.io import sog_planes
from tsplat.io.sog_files import Files
from tsplat.scene import Gaussians


def load_bytes(folder: Path, raw: bytes) -> Gaussians:
    path = folder / "scene.sog"
    path.write_bytes(raw)
    return io.load(path)


def check_like_slow_reader(gaussians: Gaussians, scene: Scene, count: int = 7) -> None:
    assert len(gaussians) == count
    for index in range(count):
        for name, values in read_slowly(scene, index).items():
            np.testing.assert_allclose(np.ravel(getattr(gaussians, name)[index]), values, 3e-6, 3e-7, err_msg=name)


@pytest.mark.parametrize("kind", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
@pytest.mark.parametrize("bands", range(4))
def test_a_zip_means_what_the_slow_reader_says(
    tmp_path: Path, rng: np.random.Generator, kind: int, bands: int
) -> None:
    scene = made_up(rng, bands=bands)
    gaussians = load_bytes(tmp_path, scene.zipped(kind))
    assert gaussians.sh_degree == bands
    check_like_slow_reader(gaussians, scene)


@pytest.mark.parametrize("bands", range(4))
def test_version_1_means_what_the_slow_reader_says(tmp_path: Path, rng: np.random.Generator, bands: int) -> None:
    scene = made_up_old(rng, bands)
    check_like_slow_reader(load_bytes(tmp_path, scene.zipped()), scene)


@pytest.mark.parametrize("name", ["meta.json", "scene.json", "scene"])
def test_a_folder_is_read_by_the_path_of_its_meta_json(
    tmp_path: Path, rng: np.random.Generator, name: str
) -> None:
    scene = made_up(rng)
    path = write_folder(tmp_path, scene.files()).rename(tmp_path / name)
    path.write_bytes(b"\xef\xbb\xbf\r\n " + json.dumps(scene.meta, indent=4).encode())
    check_like_slow_reader(io.load(path), scene)


def test_a_zip_that_lost_bytes_names_what_begins_before_it(tmp_path: Path, rng: np.random.Generator) -> None:
    raw = made_up(rng).zipped()
    with pytest.raises(CorruptFileError, match="begins at byte -10 by the zip's directory, expected 0 or more"):
        load_bytes(tmp_path, raw[:4] + raw[14:])


def test_a_palette_without_count_and_bands_is_measured(tmp_path: Path, rng: np.random.Generator) -> None:
    scene = made_up(rng, bands=2)
    del scene.meta["shN"]["count"], scene.meta["shN"]["bands"]
    check_like_slow_reader(load_bytes(tmp_path, scene.zipped()), scene)


def test_a_lost_first_entry_of_a_codebook_is_guessed_from_the_others(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    scene = made_up(rng)
    scene.planes["sh0"][..., 0] = 0
    scene.meta["sh0"]["codebook"] = [None, *range(1, 256)]
    gaussians = load_bytes(tmp_path, scene.zipped())
    np.testing.assert_allclose(gaussians.sh[:, 0, 0], 1 - 254 / 255, rtol=1e-6)


def test_a_scene_without_splats_is_empty(tmp_path: Path, rng: np.random.Generator) -> None:
    assert len(load_bytes(tmp_path, made_up(rng, count=0).zipped())) == 0


def test_a_limit_keeps_the_weightiest(tmp_path: Path, rng: np.random.Generator) -> None:
    path = tmp_path / "scene.sog"
    path.write_bytes(made_up(rng).zipped())
    whole, few = io.load(path), io.load(path, max_splats=2)
    weights = whole.opacities * np.sort(whole.scales, axis=1)[:, 1:].prod(axis=1)
    np.testing.assert_array_equal(few.means, whole.means[np.sort(np.argsort(-weights)[:2])])


def test_progress_grows_to_one(tmp_path: Path, rng: np.random.Generator) -> None:
    path = tmp_path / "scene.sog"
    path.write_bytes(made_up(rng).zipped())
    seen: list[float] = []
    io.load(path, progress=seen.append)
    assert len(seen) > 4
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


def test_a_zip_cut_anywhere_is_refused(tmp_path: Path, rng: np.random.Generator) -> None:
    whole = made_up(rng).zipped(zipfile.ZIP_DEFLATED)
    for length in range(1, len(whole)):
        with pytest.raises(CorruptFileError, match=r"scene\.sog.*expected") as caught:
            load_bytes(tmp_path, whole[:length])
        assert "\n" not in str(caught.value)


def test_a_folder_with_any_file_cut_anywhere_is_refused(tmp_path: Path, rng: np.random.Generator) -> None:
    files = made_up(rng, bands=0).files()
    path = write_folder(tmp_path, files)
    assert len(io.load(path)) == 7
    for name, content in files.items():
        for length in range(len(content)):
            (tmp_path / name).write_bytes(content[:length])
            # Of nothing at all and of bytes that are no JSON the front door says that no format is known.
            with pytest.raises(LoadError):
                io.load(path)
        (tmp_path / name).unlink()
        with pytest.raises(LoadError, match=name):
            io.load(path)
        (tmp_path / name).write_bytes(content)


@pytest.mark.filterwarnings("ignore::tsplat.errors.LoadWarning")
@pytest.mark.parametrize("old", [False, True])
def test_mutations_load_or_say_what_is_wrong(tmp_path: Path, rng: np.random.Generator, old: bool) -> None:
    files = (made_up_old(rng) if old else made_up(rng)).files()
    path = write_folder(tmp_path, files)
    messages = []
    for _ in range(400):
        name = rng.choice(list(files))
        content = bytearray(files[name])
        for position in rng.integers(0, len(content), rng.integers(1, 4)):
            content[position] = rng.choice(list(b'0123456789e-.,[]{}" \x00\xff')) ^ int(rng.integers(0, 2))
        (tmp_path / name).write_bytes(content)
        try:
            io.load(path)
        except TsplatError as error:
            messages.append(str(error))
        (tmp_path / name).write_bytes(files[name])
    assert len(messages) > 100
    assert not any("\n" in message for message in messages)


@pytest.mark.filterwarnings("ignore::tsplat.errors.LoadWarning")
def test_mutated_zips_load_or_say_what_is_wrong(tmp_path: Path, rng: np.random.Generator) -> None:
    whole = made_up(rng).zipped(zipfile.ZIP_DEFLATED)
    directory = whole.index(b"PK\x01\x02")
    messages = []
    for turn in range(600):
        content = bytearray(whole)
        # Half of them in the directory, where a zip can lie most.
        for position in rng.integers(directory if turn % 2 else 0, len(whole), 2):
            content[position] = rng.integers(0, 256)
        try:
            load_bytes(tmp_path, bytes(content))
        except TsplatError as error:
            messages.append(str(error))
    assert len(messages) > 300
    assert not any("\n" in message for message in messages)


def test_a_log_scale_of_minus_infinity_is_flat(tmp_path: Path, rng: np.random.Generator) -> None:
    scene = made_up(rng)
    codebook = scene.meta["scales"]["codebook"]
    before = load_bytes(tmp_path, scene.zipped()).scales
    lowest = min(codebook, key=lambda value: abs(math.exp(value) - before.min()))
    scene.meta["scales"]["codebook"] = [-math.inf if value == lowest else value for value in codebook]
    after = load_bytes(tmp_path, scene.zipped()).scales
    np.testing.assert_array_equal(after, np.where(before == before.min(), 0.0, before))


def test_a_scene_of_numbers_too_large_is_refused(tmp_path: Path, rng: np.random.Generator) -> None:
    scene = made_up(rng)
    scene.meta["means"]["maxs"] = [1e308, 1e308, 1e308]
    scene.meta["scales"]["codebook"] = [1e308] * 16
    scene.meta["sh0"]["codebook"] = [1e308] * 256
    with pytest.raises(
        LoadError, match=r"scene\.sog: none of its 7 splats can be drawn: 7 for nan or inf in means, 7 for"
    ):
        load_bytes(tmp_path, scene.zipped())


def change(*keys: str, to: Any) -> Callable[[dict[str, Any]], None]:
    def changed(meta: dict[str, Any]) -> None:
        for key in keys[:-1]:
            meta = meta[key]
        meta[keys[-1]] = to

    return changed


def drop(key: str) -> Callable[[dict[str, Any]], None]:
    return lambda meta: meta.pop(key)


META_FAULTS: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "another version": (change("version", to=3), "field version is 3, expected a whole number from 1 to 2"),
    "a version in words": (change("version", to="2"), "field version is '2', expected"),
    "a version that would change a terminal": (
        change("version", to="\x1b]0;\x07"),
        r"is '\\x1b\]0;\\x07', expected",
    ),
    "no count": (drop("count"), "field count is missing, expected a whole number"),
    "a negative count": (change("count", to=-1), "field count is -1, expected"),
    "a count with a fraction": (change("count", to=7.0), "field count is 7.0, expected"),
    "a count too large by two": (change("count", to=9), r"'\w+.webp' is 4x2 pixels, expected 9 to \d+ in all"),
    "a count too large for the bytes": (
        change("count", to=6 * 10**7),
        "means_l.webp' holds .* for 60000000 splats",
    ),
    "an absurd count": (change("count", to=10**30), "field count is 1000000"),
    "no means": (drop("means"), "field means is missing, expected an object"),
    "means as a list": (change("means", to=[1]), r"field means is \[1\], expected an object"),
    "two mins": (change("means", "mins", to=[0, 1]), r"field means.mins is \[0, 1\], expected 3 finite numbers"),
    "mins in words": (change("means", "mins", to=["0", "1", "2"]), "field means.mins is"),
    "mins that are endless": (change("means", "mins", to=[10**400, 1, 2]), "expected 3 finite numbers"),
    "nan": (change("means", "maxs", to=[math.nan, 1, 2]), r"field means.maxs is \[nan.*3 finite numbers"),
    "no codebook": (
        change("scales", to={"files": ["scales.webp"]}),
        "scales.codebook is missing, expected 1 to 256",
    ),
    "a short codebook": (change("scales", "codebook", to=[-3]), r"'scales.webp' names entry \d+ of 1"),
    "a long codebook": (change("sh0", "codebook", to=[0] * 257), "sh0.codebook is .*expected 1 to 256"),
    "one plane of means": (change("means", "files", to=["means_l.webp"]), "means.files is .*expected 2 names"),
    "a plane that is absent": (change("quats", "files", to=["q.webp"]), "'q.webp' is missing from the zip"),
    "a plane in another role": (change("quats", "files", to=["sh0.webp"]), "'sh0.webp' has a fourth byte of"),
    "four bands": (change("shN", "bands", to=4), "shN.bands is 4, expected a whole number from 0 to 3"),
    "bands unlike the plane": (
        change("shN", "bands", to=3),
        "'shN_centroids.webp' is 192x2 pixels, expected 1920",
    ),
    "fewer bands than the plane": (change("shN", "count", to=200), "'shN_centroids.webp' is 192x2 pixels"),
    "labels beyond the palette": (change("shN", "count", to=1), r"'shN_labels.webp' names entry \d+ of 1"),
    "a palette too large": (change("shN", "count", to=65537), "shN.count is 65537"),
}


@pytest.mark.parametrize("name", META_FAULTS)
def test_a_meta_that_lies_is_refused_in_one_line(tmp_path: Path, rng: np.random.Generator, name: str) -> None:
    fault, message = META_FAULTS[name]
    scene = made_up(rng)
    fault(scene.meta)
    with pytest.raises(CorruptFileError, match=message) as caught:
        load_bytes(tmp_path, scene.zipped())
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 300 + len(str(tmp_path))


@pytest.mark.parametrize(
    "name",
    [
        "../quats.webp",
        "/etc/hosts",
        "a/../../quats.webp",
        "C:quats.webp",
        "..\\quats.webp",
        "",
        "a\x00",
        7,
        None,
        ".",
    ],
)
def test_a_name_that_leads_outside_is_refused(tmp_path: Path, rng: np.random.Generator, name: object) -> None:
    scene = made_up(rng)
    scene.meta["quats"]["files"] = [name]
    (tmp_path / "quats.webp").write_bytes(sogs.webp(scene.planes["quats"]))
    path = write_folder(tmp_path / "scene", scene.files())
    with pytest.raises(CorruptFileError, match=r"field quats.files is .*expected 1 names of files inside"):
        io.load(path)


def test_a_plane_in_a_folder_below_is_inside(tmp_path: Path, rng: np.random.Generator) -> None:
    scene = made_up(rng)
    scene.meta["quats"]["files"] = ["below/quats.webp"]
    path = write_folder(tmp_path, scene.files())
    (tmp_path / "below").mkdir()
    (tmp_path / "quats.webp").rename(tmp_path / "below" / "quats.webp")
    check_like_slow_reader(io.load(path), scene)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"{", "'meta.json' is not JSON, expected an object"),
        (b"[1, 2]", "'meta.json' holds a JSON list, expected an object"),
        (b'{"a":' + b"[" * 100_000, "is not JSON"),
        (b"\xff\xfe\x00", "is not JSON"),
        (b'{"count": ' + b"1" * 5000 + b"}", "field means is missing"),
        (
            b'{"version": ' + b"1" * 5000 + b', "means": {}, "scales": {}, "sh0": {}}',
            "field version is inf, expected",
        ),
        (b" " * (1 << 18) + b"{}", "holds more than 262144 bytes"),
        (b"{}", "field means is missing"),
    ],
)
def test_a_meta_that_is_no_meta_is_refused(tmp_path: Path, text: bytes, message: str) -> None:
    with pytest.raises(CorruptFileError, match=message):
        load_bytes(tmp_path, sogs.zipped({"meta.json": text}, zipfile.ZIP_DEFLATED))


def test_a_zip_of_something_else_says_what_is_missing(tmp_path: Path) -> None:
    for files in ({}, {"word/document.xml": b"<xml/>"}):
        with pytest.raises(CorruptFileError, match=r"'meta.json' is missing from the zip"):
            load_bytes(tmp_path, sogs.zipped(files))


def test_json_of_something_else_says_so(tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    path.write_text('{"model": {"version": "2.0"}, "parts": []}')
    with pytest.raises(LoadError, match=r"model\.json: is JSON, but neither a meta\.json nor a lod-meta\.json"):
        io.load(path)


def test_rare_packing_is_refused(tmp_path: Path, rng: np.random.Generator) -> None:
    with pytest.raises(CorruptFileError, match="expected stored or deflated"):
        load_bytes(tmp_path, made_up(rng).zipped(zipfile.ZIP_BZIP2))
    locked = bytearray(made_up(rng).zipped())
    locked[locked.index(b"PK\x01\x02") + 8] |= 1
    with pytest.raises(CorruptFileError, match=r"'meta.json' is encrypted"):
        load_bytes(tmp_path, bytes(locked))


def test_an_image_too_large_is_refused_before_it_is_decoded(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = made_up(rng).files()
    # Width and height less one, 14 bits each.
    huge = bytearray(files["sh0.webp"])
    assert huge[12:16] in (b"VP8L", b"VP8X")
    huge[12:16] = b"VP8L"
    huge[21:25] = (16383 | 16383 << 14).to_bytes(4, "little")
    files["means_l.webp"] = bytes(huge)
    decode = sog_planes._decode

    def refuse(files: Files, name: str, encoded: bytes, size: tuple[int, int]) -> sog_planes.U8:
        assert name != "means_l.webp"
        return decode(files, name, encoded, size)

    monkeypatch.setattr(sog_planes, "_decode", refuse)
    with pytest.raises(
        CorruptFileError, match=r"'means_l.webp' is 16384x16384 pixels, expected 7 to 65550 in all"
    ):
        load_bytes(tmp_path, sogs.zipped(files))


def test_a_container_whose_image_is_larger_inside_is_refused(tmp_path: Path, rng: np.random.Generator) -> None:
    files = made_up(rng).files()
    inner = sogs.webp(rng.integers(0, 256, (100, 100, 4), dtype=np.uint8))[12:]
    extended = b"VP8X" + (10).to_bytes(4, "little") + b"\x10\0\0\0" + b"\x03\0\0\x01\0\0"
    body = b"WEBP" + extended + inner
    files["means_l.webp"] = b"RIFF" + len(body).to_bytes(4, "little") + body
    with pytest.raises(CorruptFileError, match=r"'means_l.webp' cannot be decoded"):
        load_bytes(tmp_path, sogs.zipped(files))


def test_an_image_of_another_size_than_its_header_is_refused(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sog_planes, "_size", lambda *_: (5, 5))
    with pytest.raises(CorruptFileError, match=r"is \(4, 2\) pixels inside, expected \(5, 5\)"):
        load_bytes(tmp_path, made_up(rng, bands=0).zipped())


def test_zeros_in_a_zip_do_not_pay_for_splats(tmp_path: Path, rng: np.random.Generator) -> None:
    scene = made_up(rng, count=10**6)
    files = scene.files()
    files["means_l.webp"] += bytes(1 << 20)
    files["noise"] = rng.bytes(1 << 20)
    with pytest.raises(CorruptFileError, match=r"'means_l\.webp' holds \d{3,4} bytes, expected at least 62500"):
        load_bytes(tmp_path, sogs.zipped(files, zipfile.ZIP_DEFLATED))


def test_sizes_in_a_zip_that_are_not_there_do_not_pay_for_splats(tmp_path: Path, rng: np.random.Generator) -> None:
    whole = bytearray(made_up(rng, count=10**6).zipped())
    entry = whole.rindex(b"means_l.webp") - 46
    assert whole[entry : entry + 4] == b"PK\x01\x02"
    whole[entry + 20 : entry + 28] = 2 * (1 << 24).to_bytes(4, "little")
    with pytest.raises(CorruptFileError, match=r"'means_l\.webp' holds \d{4} bytes, expected at least 62500"):
        load_bytes(tmp_path, bytes(whole))


def test_a_small_meta_in_a_folder_takes_no_room_for_the_largest(tmp_path: Path, rng: np.random.Generator) -> None:
    assert within_memory(write_folder(tmp_path, made_up(rng).files()), 0) is not None


def test_a_meta_packed_to_nothing_is_not_unpacked_to_millions_of_lists(tmp_path: Path) -> None:
    text = b'{"means": [' + b"[]," * 5_000_000 + b"0]}"
    path = tmp_path / "scene.sog"
    path.write_bytes(sogs.zipped({"meta.json": text}, zipfile.ZIP_DEFLATED))
    assert path.stat().st_size < 20_000
    assert within_memory(path, 0) is None


def test_a_packed_size_beyond_the_end_of_a_zip_takes_no_room(tmp_path: Path, rng: np.random.Generator) -> None:
    whole = bytearray(made_up(rng).zipped())
    entry = whole.rindex(b"meta.json") - 46
    whole[entry + 20 : entry + 28] = 2 * (1 << 30).to_bytes(4, "little")
    path = tmp_path / "scene.sog"
    path.write_bytes(whole)
    with pytest.raises(
        CorruptFileError, match=r"'meta\.json' takes 1073741824 bytes by the zip's directory, \d{4} are"
    ):
        io.load(path)
    assert within_memory(path, 0) is None


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x89PNG\r\n\x1a\n" + bytes(99), r"begins with b'\\x89PNG.*expected a WebP image"),
        (b"RIFF\x80\0\0\0WEBPVP8 " + bytes(99), "is a WebP of kind b'VP8 ', expected a lossless one"),
        (b"", "begins with b''"),
    ],
)
def test_a_plane_of_another_kind_is_refused(
    tmp_path: Path, rng: np.random.Generator, content: bytes, message: str
) -> None:
    files = made_up(rng).files()
    files["scales.webp"] = content
    with pytest.raises(CorruptFileError, match=message):
        load_bytes(tmp_path, sogs.zipped(files))


def test_a_plane_padded_with_rubbish_is_refused(tmp_path: Path, rng: np.random.Generator) -> None:
    files = made_up(rng).files()
    files["scales.webp"] += bytes(1 << 20)
    with pytest.raises(CorruptFileError, match=r"'scales.webp' holds .*expected at most"):
        load_bytes(tmp_path, sogs.zipped(files, zipfile.ZIP_DEFLATED))


def test_a_level_of_a_scene_without_levels_is_refused(tmp_path: Path, rng: np.random.Generator) -> None:
    path = tmp_path / "scene.sog"
    path.write_bytes(made_up(rng).zipped())
    assert len(io.load(path, lod=0)) == 7
    with pytest.raises(OptionError, match="lod must be 0 in a scene that is not streamed, got 1"):
        io.load(path, lod=1)
