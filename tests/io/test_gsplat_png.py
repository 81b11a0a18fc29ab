"""gsplat's PNG compression: what its own steps give, in a folder and in a zip, and folders that lie."""

from __future__ import annotations

import io as streams
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.io.gsplat_pngs import Files, compressed, decompressed
from tests.io.sogs import zipped
from tests.io.test_npz import trained
from tests.scenes import random_gaussians
from tsplat import io
from tsplat.errors import CorruptFileError, LoadError
from tsplat.io.on_disk import look

COUNT, ROWS = 49, 5


def some_files(degree: int = 2, bits: int = 6) -> Files:
    rng = np.random.default_rng(3)
    splats = trained(random_gaussians(rng, COUNT, degree))
    if not degree:
        del splats["shN"]
        return compressed(splats)
    splats["shN"] = splats["shN"][:ROWS]
    return compressed(splats, rng.integers(0, ROWS, COUNT), bits)


def folder_of(tmp_path: Path, files: Files) -> Path:
    folder = tmp_path / "compression"
    folder.mkdir(exist_ok=True)
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder


@pytest.mark.parametrize(("degree", "bits"), [(0, 6), (1, 6), (2, 8), (3, 3)])
def test_a_folder_holds_what_gsplat_makes_of_it(tmp_path: Path, degree: int, bits: int) -> None:
    files = some_files(degree, bits)
    found, expected = io.load(folder_of(tmp_path, files)), decompressed(files)
    np.testing.assert_array_equal(found.means, expected["means"])
    np.testing.assert_array_equal(found.scales, np.exp(expected["scales"]))
    np.testing.assert_allclose(found.opacities, 1 / (1 + np.exp(-expected["opacities"])), rtol=1e-6)
    lengths = np.linalg.norm(expected["quats"], axis=1)
    np.testing.assert_allclose(found.quats, expected["quats"] / lengths[:, None], atol=1e-6)
    np.testing.assert_array_equal(found.sh[:, :1], expected["sh0"])
    if degree:
        np.testing.assert_array_equal(found.sh[:, 1:], expected["shN"])
    assert found.sh_degree == degree


def test_a_meta_json_and_a_zip_of_the_folder_are_the_same_scene(tmp_path: Path) -> None:
    files = some_files()
    folder = folder_of(tmp_path, files)
    inside = {f"results/compression/{name}": content for name, content in files.items()}
    (tmp_path / "top.zip").write_bytes(zipped(files))
    (tmp_path / "deep.zip").write_bytes(zipped(inside, zipfile.ZIP_DEFLATED))
    expected = io.load(folder)
    for path in (folder / "meta.json", tmp_path / "top.zip", tmp_path / "deep.zip"):
        np.testing.assert_array_equal(io.load(path).sh, expected.sh)
    on_disk = look(folder / "meta.json")
    assert (on_disk.format, on_disk.files) == ("gsplat PNG", len(files))
    assert on_disk.nbytes == sum(map(len, files.values()))


def test_a_scene_of_no_splats_has_none(tmp_path: Path) -> None:
    shapes = {"means": [0, 3], "scales": [0, 3], "quats": [0, 4], "opacities": [0], "sh0": [0, 1, 3]}
    meta = {name: {"shape": shape, "dtype": "float32", "mins": []} for name, shape in shapes.items()}
    assert len(io.load(folder_of(tmp_path, {"meta.json": json.dumps(meta).encode()}))) == 0


def changed(name: str, change: Callable[[dict[str, Any]], object]) -> Callable[[Files], None]:
    """Return what changes a field of the meta.json."""

    def apply(files: Files) -> None:
        meta = json.loads(files["meta.json"])
        change(meta[name])
        files["meta.json"] = json.dumps(meta).encode()

    return apply


def image(mode: str, size: tuple[int, int]) -> bytes:
    stream = streams.BytesIO()
    Image.new(mode, size).save(stream, "PNG")
    return stream.getvalue()


def palette(**arrays: Any) -> bytes:
    stream = streams.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


CENTROIDS, LABELS = np.zeros((ROWS, 24), np.uint8), np.zeros(COUNT, np.uint16)

LIES: dict[str, tuple[Callable[[Files], object], str]] = {
    "a plane missing": (lambda files: files.pop("quats.png"), r"quats\.png: is missing"),
    "a plane cut": (lambda files: files.update({"scales.png": files["scales.png"][:-40]}), "cannot be decoded"),
    "no PNG": (lambda files: files.update({"sh0.png": b"GIF89a" + bytes(99)}), "expected a PNG image"),
    "another size": (lambda files: files.update({"sh0.png": image("RGB", (7, 8))}), "is 7x8 pixels, expected 49"),
    "other pixels": (
        lambda files: files.update({"sh0.png": image("L", (7, 7))}),
        "pixels of kind L, expected RGB",
    ),
    "other counts": (changed("quats", lambda field: field.update(shape=[9, 4])), "different number of splats"),
    "no shape": (changed("sh0", lambda field: field.pop("shape")), r"field sh0\.shape is missing"),
    "a shape of text": (changed("means", lambda field: field.update(shape=["49", 3])), r"field means\.shape is"),
    "nan": (changed("scales", lambda field: field.update(mins=[0, float("nan"), 0])), "expected 3 finite numbers"),
    "odd bits": (
        changed("shN", lambda field: field.update(quantization=99)),
        "expected a whole number from 1 to 8",
    ),
    "odd harmonics": (changed("shN", lambda field: field.update(shape=[49, 7, 3])), r"field shN\.shape is"),
    "a label too many": (
        lambda files: files.update({"shN.npz": palette(centroids=CENTROIDS, labels=LABELS + ROWS)}),
        "expected 0 to 4",
    ),
    "a label below": (
        lambda files: files.update({"shN.npz": palette(centroids=CENTROIDS, labels=LABELS.astype("i4") - 1)}),
        "or one below 0",
    ),
    "too few labels": (
        lambda files: files.update({"shN.npz": palette(centroids=CENTROIDS, labels=LABELS[:9])}),
        r"has shape \[9\], expected \[49\]",
    ),
    "narrow centroids": (
        lambda files: files.update({"shN.npz": palette(centroids=CENTROIDS[:, :9], labels=LABELS)}),
        "rows of 24",
    ),
    "labels that are no whole numbers": (
        lambda files: files.update({"shN.npz": palette(centroids=CENTROIDS, labels=LABELS.astype("f4"))}),
        "expected whole numbers",
    ),
}


@pytest.mark.parametrize("lie", LIES)
def test_a_folder_that_lies_is_one_clear_line(tmp_path: Path, lie: str) -> None:
    files = some_files()
    change, problem = LIES[lie]
    change(files)
    with pytest.raises(CorruptFileError, match=problem) as caught:
        io.load(folder_of(tmp_path, files))
    assert "\n" not in str(caught.value)


def test_ranges_beyond_float32_are_splats_that_cannot_be_drawn(tmp_path: Path) -> None:
    files = some_files(0)
    changed("means", lambda field: field.update(maxs=[1e300, 1, 1], mins=[-1e300, 0, 0]))(files)
    with pytest.raises(LoadError, match=f"none of its {COUNT} splats can be drawn"):
        io.load(folder_of(tmp_path, files))


def test_more_splats_than_means_have_bytes_are_refused_before_they_are_decoded(tmp_path: Path) -> None:
    side = 4096
    files = some_files(0)
    meta = json.loads(files["meta.json"])
    for fields in meta.values():
        fields["shape"][0] = side * side
    black = image("RGB", (side, side))
    files |= {"meta.json": json.dumps(meta).encode(), "means_l.png": black, "means_u.png": black}
    with pytest.raises(CorruptFileError, match=f"expected at least {side * side} for {side * side} splats"):
        io.load(folder_of(tmp_path, files))
