"""Exported checkpoints: against the PLY of the same scene, under all names, and liars."""

from __future__ import annotations

import io as streams
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.scenes import random_gaussians, shared_scenes
from tsplat import io
from tsplat.errors import CorruptFileError, LoadError, LoadWarning, TsplatError
from tsplat.scene import ARRAYS, Gaussians

SCENES = shared_scenes()
Arrays = dict[str, np.ndarray]

SPLATFACTO = {"sh0": "features_dc", "shN": "features_rest"}


def trained(gaussians: Gaussians, dtype: str = "<f4") -> Arrays:
    """Return what gsplat would keep of a scene."""
    opacities = np.clip(gaussians.opacities.astype(np.float64), 1e-7, 1 - 1e-7)
    arrays = {
        "means": gaussians.means,
        "quats": 1.5 * gaussians.quats,
        "scales": np.log(gaussians.scales),
        "opacities": np.log(opacities / (1 - opacities)),
        "sh0": gaussians.sh[:, :1],
        "shN": gaussians.sh[:, 1:],
    }
    return {name: array.astype(dtype) for name, array in arrays.items()}


def named(arrays: Arrays, way: str, splatfacto: bool) -> Arrays:
    """Return the arrays as one of the two trainers has them, behind a way to them."""
    if splatfacto:
        arrays = {SPLATFACTO.get(name, name): array for name, array in arrays.items()}
        arrays |= {"features_dc": arrays["features_dc"][:, 0], "opacities": arrays["opacities"][:, None]}
    return {f"{way}{name}": array for name, array in arrays.items()}


def written(folder: Path, arrays: Arrays, packed: bool = False) -> Path:
    path = folder / "scene.npz"
    (np.savez_compressed if packed else np.savez)(path, **arrays)
    return path


def zipped(folder: Path, files: dict[str, bytes], kind: int = zipfile.ZIP_STORED) -> Path:
    path = folder / "scene.npz"
    with zipfile.ZipFile(path, "w", kind) as archive:
        for name, content in files.items():
            archive.writestr(f"{name}.npy", content)
    return path


def npy(array: np.ndarray) -> bytes:
    stream = streams.BytesIO()
    np.lib.format.write_array(stream, array)
    return stream.getvalue()


def check_alike(found: Gaussians, truth: Gaussians, rtol: float = 1e-5) -> None:
    assert found.sh.shape == truth.sh.shape
    for name, array, true in zip(ARRAYS, found.arrays, truth.arrays, strict=True):
        np.testing.assert_allclose(array, true, rtol=rtol, atol=rtol, err_msg=name)


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize(
    ("way", "splatfacto"),
    [
        ("", False),
        ("splats.", False),
        ("splats/", False),
        ("gauss_params.", True),
        ("_model.gauss_params.", True),
        ("_model.", True),
        ("pipeline._model.gauss_params.", True),
        ("pipeline/_model.gauss_params.", True),
        ("checkpoints/step-000029999/pipeline/_model.gauss_params.", True),
        ("longer.than.a.format.sees." * 50, False),
    ],
)
def test_a_checkpoint_is_the_scene_that_its_ply_is(
    tmp_path: Path, rng: np.random.Generator, way: str, splatfacto: bool, packed: bool
) -> None:
    scene = random_gaussians(rng, 40, 2)
    arrays = {**named(trained(scene), way, splatfacto), "optimizers.means": np.zeros(3), "step": np.array(29999)}
    path = written(tmp_path, arrays, packed).rename(tmp_path / "a name that tells nothing")
    check_alike(io.load(path), io.load(io.save(tmp_path / "scene.ply", scene)))


@pytest.mark.parametrize("degree", range(5))
def test_every_degree_is_read(tmp_path: Path, rng: np.random.Generator, degree: int) -> None:
    scene = random_gaussians(rng, 10, degree)
    check_alike(io.load(written(tmp_path, trained(scene))), scene)


@pytest.mark.parametrize("dtype", ["<f2", ">f2", "<f4", ">f4", "<f8", ">f8"])
@pytest.mark.parametrize("order", [np.ascontiguousarray, np.asfortranarray])
def test_numbers_of_every_size_and_order_are_read(
    tmp_path: Path, rng: np.random.Generator, dtype: str, order: Callable[[np.ndarray], np.ndarray]
) -> None:
    scene = random_gaussians(rng, 30, 1)
    arrays = {name: order(array) for name, array in trained(scene, dtype).items()}
    check_alike(io.load(written(tmp_path, arrays)), scene, 1e-5 if dtype[-1] != "2" else 5e-3)


def test_a_checkpoint_without_shn_has_degree_0(tmp_path: Path, rng: np.random.Generator) -> None:
    scene = random_gaussians(rng, 10, 0)
    arrays = trained(scene)
    del arrays["shN"]
    check_alike(io.load(written(tmp_path, arrays)), scene)


def test_splatfacto_without_harmonics_keeps_logits_of_colours(tmp_path: Path, rng: np.random.Generator) -> None:
    arrays = named(trained(random_gaussians(rng, 10, 0)), "_model.gauss_params.", True)
    logits = arrays["_model.gauss_params.features_dc"]
    sh = io.load(written(tmp_path, arrays)).sh
    np.testing.assert_allclose(
        0.5 + 0.28209479 * sh[:, 0], 1 / (1 + np.exp(-logits.astype(np.float64))), atol=1e-6
    )


def test_a_limit_keeps_the_weightiest_and_progress_grows_to_one(tmp_path: Path, rng: np.random.Generator) -> None:
    seen: list[float] = []
    path = written(tmp_path, trained(random_gaussians(rng, 100, 1)))
    whole, few = io.load(path, progress=seen.append), io.load(path, max_splats=5)
    weights = whole.opacities * np.sort(whole.scales, axis=1)[:, 1:].prod(axis=1)
    assert np.median(whole.opacities) < np.median(few.opacities)
    assert len(few) == 5
    assert weights.argmax() in [int(np.abs(whole.means - mean).sum(axis=1).argmin()) for mean in few.means]
    assert (len(seen), seen) == (6, sorted(seen))
    assert seen[-1] == 1.0


def test_splats_that_cannot_be_drawn_are_dropped(tmp_path: Path, rng: np.random.Generator) -> None:
    arrays = trained(random_gaussians(rng, 6, 1), "<f8")
    arrays["means"][0, 1], arrays["scales"][1, 2], arrays["quats"][2] = np.nan, 1e300, 0
    arrays["sh0"][3], arrays["opacities"][4] = 1e200, np.nan
    with pytest.warns(LoadWarning, match=r"scene\.npz: dropped 5 of 6 splats") as caught:
        assert len(io.load(written(tmp_path, arrays))) == 1
    assert caught[0].filename == __file__, "the warning points at the caller of load"


def test_no_splats_are_a_scene(tmp_path: Path, rng: np.random.Generator) -> None:
    assert io.load(written(tmp_path, trained(random_gaussians(rng, 0, 3)))).sh.shape == (0, 16, 3)


def swap(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Arrays], Arrays]:
    return lambda arrays: {**arrays, name: change(arrays[name])}


def without(name: str) -> Callable[[Arrays], Arrays]:
    return lambda arrays: {key: array for key, array in arrays.items() if key != name}


FAULTS: dict[str, tuple[Callable[[Arrays], Arrays], str]] = {
    "no means": (without("means"), "holds no scenes, expected one: means, quats"),
    "no colours": (without("sh0"), "holds no scenes, expected one: .* sh0 or features_dc; export the splats"),
    "two scenes": (
        lambda arrays: {**arrays, **{f"b.{key}": array for key, array in arrays.items()}},
        "holds 2 scenes, expected one",
    ),
    "no quats": (without("quats"), "'quats.npy' is missing from the zip"),
    "no opacities": (without("opacities"), "'opacities.npy' is missing from the zip"),
    "no features_rest": (
        lambda arrays: without("features_rest")(named(arrays, "", True)),
        "'features_rest.npy' is missing from the zip",
    ),
    "fewer quats": (swap("quats", lambda a: a[1:]), r"'quats.npy' has shape \[6, 4\], expected \[7, 4\]"),
    "quats of three": (swap("quats", lambda a: a[:, 1:]), r"'quats.npy' has shape \[7, 3\], expected \[7, 4\]"),
    "means of two": (swap("means", lambda a: a[:, 1:]), r"'means.npy' has shape \[7, 2\], expected \[7, 3\]"),
    "a mean": (swap("means", lambda a: a[0, 0]), r"'means.npy' has shape \[\], expected \[0, 3\]"),
    "opacities of two": (
        swap("opacities", lambda a: np.stack([a, a], 1)),
        r"'opacities.npy' has shape \[7, 2\], expected \[7\] or \[7, 1\]",
    ),
    "an odd degree": (
        swap("shN", lambda a: a[:, :2]),
        r"'shN.npy' has shape \[7, 2, 3\], expected .* \[7, 3, 3\] or",
    ),
    "colours channel by channel": (swap("shN", lambda a: a.transpose(0, 2, 1)[..., :2]), r"has shape \[7, 3, 2\]"),
    "whole numbers": (swap("scales", lambda a: a.astype("<i4")), "holds numbers of type '<i4', expected float16"),
    "complex numbers": (
        swap("scales", lambda a: a.astype("<c8")),
        "holds numbers of type '<c8', expected float16",
    ),
    "objects": (swap("scales", lambda a: a.astype(object)), r"holds numbers of type '\|O', expected float16"),
    "records": (swap("scales", lambda a: a.view([("x", "<f4", 3)])), "holds numbers of type|has a header"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_arrays_that_are_no_scene_are_refused_in_one_line(
    tmp_path: Path, rng: np.random.Generator, name: str
) -> None:
    fault, message = FAULTS[name]
    arrays = fault(trained(random_gaussians(rng, 7, 1)))
    with pytest.raises(LoadError, match=message) as caught:
        io.load(written(tmp_path, arrays))
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 300 + len(str(tmp_path))


def test_a_name_without_end_stays_short_in_the_message(tmp_path: Path, rng: np.random.Generator) -> None:
    arrays = trained(random_gaussians(rng, 7, 1)) | {"means": np.zeros((7, 2))}
    with pytest.raises(CorruptFileError, match=r"'xxxx.* has shape \[7, 2\], expected \[7, 3\]") as caught:
        io.load(written(tmp_path, named(arrays, "x" * 60_000 + ".", False)))
    assert len(str(caught.value)) < 400 + len(str(tmp_path))


def test_nothing_pickled_is_run(tmp_path: Path, rng: np.random.Generator) -> None:
    class Trap:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return (tmp_path / "sprung").touch, ()  # type: ignore[return-value]

    arrays = trained(random_gaussians(rng, 7, 1)) | {
        "means": np.array([[Trap()] * 3] * 7, object),
        "other": Trap(),
    }
    with pytest.raises(CorruptFileError, match=r"'means.npy' holds numbers of type '\|O'"):
        io.load(written(tmp_path, arrays))
    arrays["means"] = np.zeros((7, 3))
    assert len(io.load(written(tmp_path, arrays))) == 7
    assert not (tmp_path / "sprung").exists()


HEADERS: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "no magic": (lambda raw: b"\x93NUMPX" + raw[6:], r"begins with b'\\x93NUMPX"),
    "another version": (lambda raw: raw[:6] + b"\x04" + raw[7:], "and a version from 1 to 3"),
    "nothing at all": (lambda raw: raw[:0], "begins with b''"),
    "a header without end": (lambda raw: raw[:8] + b"\xff\xff" + raw[10:], "has a header up to byte 65545"),
    "no shape": (lambda raw: raw.replace(b"'shape'", b"'shade'"), "expected descr, fortran_order and shape"),
    "a shape below zero": (
        lambda raw: raw.replace(b"(7, 3)", b"(7,-3)"),
        "expected descr, fortran_order and shape",
    ),
    "an order that is neither": (lambda raw: raw.replace(b"False", b"Fals3"), "expected descr, fortran_order"),
    "a byte more": (lambda raw: raw + b"\0", r"holds more bytes, expected 212 for its shape \[7, 3\]"),
    "a byte less": (lambda raw: raw[:-1], r"holds 211 bytes, expected 212 for its shape \[7, 3\]"),
    "smaller numbers": (lambda raw: raw.replace(b"<f4", b"<f2"), "holds more bytes, expected 170"),
    "larger numbers": (lambda raw: raw.replace(b"<f4", b"<f8"), "holds 212 bytes, expected 296"),
}


@pytest.mark.parametrize("kind", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
@pytest.mark.parametrize("name", HEADERS)
def test_a_header_that_lies_is_refused_in_one_line(
    tmp_path: Path, rng: np.random.Generator, name: str, kind: int
) -> None:
    fault, message = HEADERS[name]
    files = {key: npy(array) for key, array in trained(random_gaussians(rng, 7, 1)).items()}
    assert fault(files["means"]) != files["means"]
    files["means"] = fault(files["means"])
    with pytest.raises(CorruptFileError, match=message) as caught:
        io.load(zipped(tmp_path, files, kind))
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(("count", "message"), [(10**8, "for 100000000 splats"), (10**15, "for 10{15} splats")])
def test_headers_that_claim_much_cost_little(tmp_path: Path, count: int, message: str) -> None:
    sides = {"means": "3", "quats": "4", "scales": "3", "opacities": "", "sh0": "1, 3", "shN": "24, 3"}
    files = {
        name: npy(np.zeros(3, np.float32)).replace(
            b"(3,), }" + b" " * 24, f"({count}, {side}), }}".encode().ljust(31)
        )
        for name, side in sides.items()
    }
    path = zipped(tmp_path, files)
    tracemalloc.start()
    with pytest.raises(CorruptFileError, match=rf"'means.npy' holds 140 bytes, expected at least .* {message}"):
        io.load(path)
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()


def test_zeros_that_unpack_to_much_are_refused(tmp_path: Path) -> None:
    count = 300_000
    shapes = {"means": (3,), "quats": (4,), "scales": (3,), "opacities": (), "sh0": (1, 3)}
    arrays = {name: np.zeros((count, *shape), np.float32) for name, shape in shapes.items()}
    path = written(tmp_path, arrays, packed=True)
    assert path.stat().st_size < 40_000
    tracemalloc.start()
    with pytest.raises(CorruptFileError, match=r"'means.npy' holds \d+ bytes, expected at least 300000"):
        io.load(path)
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()


def test_reading_takes_at_most_four_times_the_scene(tmp_path: Path, rng: np.random.Generator) -> None:
    path = written(tmp_path, trained(random_gaussians(rng, 20_000, 3), "<f8"))
    tracemalloc.start()
    scene = io.load(path)
    assert tracemalloc.get_traced_memory()[1] < 4 * scene.nbytes
    tracemalloc.stop()


@pytest.mark.parametrize("packed", [False, True])
def test_a_file_cut_anywhere_is_refused(tmp_path: Path, rng: np.random.Generator, packed: bool) -> None:
    whole = written(tmp_path, trained(random_gaussians(rng, 3, 1)), packed).read_bytes()
    path = tmp_path / "cut.npz"
    for length in range(1, len(whole), 3):
        path.write_bytes(whole[:length])
        with pytest.raises(CorruptFileError, match=r"cut\.npz.*expected") as caught:
            io.load(path)
        assert "\n" not in str(caught.value)


@pytest.mark.filterwarnings("ignore::tsplat.errors.LoadWarning")
@pytest.mark.parametrize("packed", [False, True])
def test_mutations_load_or_say_what_is_wrong(tmp_path: Path, rng: np.random.Generator, packed: bool) -> None:
    whole = written(tmp_path, trained(random_gaussians(rng, 7, 1)), packed).read_bytes()
    directory = whole.index(b"PK\x01\x02")
    path = tmp_path / "mutated.npz"
    messages = []
    for turn in range(300):
        content = bytearray(whole)
        for position in rng.integers(directory if turn % 2 else 0, len(whole), 2):
            content[position] = rng.integers(0, 256)
        path.write_bytes(content)
        try:
            io.load(path)
        except TsplatError as error:
            messages.append(str(error))
    assert len(messages) > 150
    assert not any("\n" in message for message in messages)


@pytest.mark.filterwarnings("ignore::tsplat.errors.LoadWarning")
def test_mutated_arrays_load_or_say_what_is_wrong(tmp_path: Path, rng: np.random.Generator) -> None:
    files = {name: npy(array) for name, array in trained(random_gaussians(rng, 7, 1)).items()}
    messages = []
    for _ in range(300):
        name = rng.choice(list(files))
        content = bytearray(files[name])
        for position in rng.integers(0, 80, 2):
            content[position] = rng.choice(list(b"0123456789<>|()[]{}',:fFT \n\x00\xff"))
        try:
            io.load(zipped(tmp_path, {**files, name: bytes(content)}))
        except TsplatError as error:
            messages.append(str(error))
    assert len(messages) > 150
    assert not any("\n" in message for message in messages)


@pytest.mark.parametrize("first", ["means_l.webp", f"{'long' * 300}.webp"])
def test_a_zip_that_begins_otherwise_is_still_a_sog(tmp_path: Path, first: str) -> None:
    with zipfile.ZipFile(path := tmp_path / "scene.sog", "w") as archive:
        archive.writestr(first, "{}")
        archive.writestr("meta.json", "{}")
    with pytest.raises(CorruptFileError, match="field means is missing"):
        io.load(path)


@pytest.mark.skipif(SCENES is None, reason="no folder of real scenes: set TSPLAT_SCENES or have ../shared/scenes")
def test_a_real_scene_is_the_one_its_ply_is(tmp_path: Path) -> None:
    assert SCENES is not None
    scene = io.load(SCENES / "format_matrix" / "yashica.ply")
    check_alike(io.load(written(tmp_path, trained(scene), packed=True)), scene)
