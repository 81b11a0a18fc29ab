"""The format of a file is what it holds, then what it is called, unless somebody asks for another."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.scenes import random_gaussians
from tsplat import io, options
from tsplat.errors import LoadError, OptionError
from tsplat.io.candidates import find_series
from tsplat.io.formats import FORMATS
from tsplat.io.options import FORMAT_NAMES, SPZ_FRAMES
from tsplat.io.recognition import PARSED_BYTES, recognized
from tsplat.io.sources import file_name
from tsplat.io.splat import may_be_splat

SCENE = random_gaussians(np.random.default_rng(5), 40, 1)
SUFFIXES = [".ply", ".compressed.ply", ".spz", ".sog", ".splat", ".gltf", ".glb"]


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("name", ["scene", "scene.bin", "download.1", "scene.json", "scene.zip"])
@pytest.mark.filterwarnings("ignore::tsplat.errors.SaveWarning")  # a .splat has no harmonics
def test_a_scene_of_an_odd_name_is_known_by_what_it_holds(tmp_path: Path, suffix: str, name: str) -> None:
    saved = io.save(tmp_path / f"saved{suffix}", SCENE)
    odd = tmp_path / name
    if suffix == ".splat" and name == "scene.json":
        return  # there the name says something, and what it says is not so
    odd.write_bytes(saved.read_bytes())
    assert recognized(odd).name.lower().endswith(suffix.removeprefix(".compressed").removeprefix("."))
    np.testing.assert_array_equal(io.load(odd).means, io.load(saved).means)


@pytest.mark.parametrize("suffix", [suffix for suffix in SUFFIXES if suffix != ".compressed.ply"])
@pytest.mark.filterwarnings("ignore::tsplat.errors.SaveWarning")  # a .splat has no harmonics
def test_a_format_may_be_asked_for(tmp_path: Path, suffix: str) -> None:
    saved = io.save(tmp_path / f"saved{suffix}", SCENE)
    odd = tmp_path / "scene.ksplat"
    odd.write_bytes(saved.read_bytes())
    np.testing.assert_array_equal(io.load(odd, format=suffix[1:]).means, io.load(saved).means)
    with pytest.raises(LoadError):
        io.load(saved, format="npz")


@pytest.mark.filterwarnings("ignore::tsplat.errors.SaveWarning")  # a .splat has no harmonics
def test_a_splat_is_known_by_how_it_begins_too(tmp_path: Path, rng: np.random.Generator) -> None:
    head = io.save(tmp_path / "saved.splat", SCENE).read_bytes()[:1024]
    assert may_be_splat(head)
    assert may_be_splat(head[:-1])
    assert not any(map(may_be_splat, (b"", head[:31], head[1:], bytes(1024), rng.bytes(1024))))


@pytest.mark.filterwarnings("ignore::tsplat.errors.SaveWarning")  # a .splat has no harmonics
def test_bytes_of_something_else_are_no_records(tmp_path: Path, rng: np.random.Generator) -> None:
    saved = io.save(tmp_path / "saved.splat", SCENE).read_bytes()
    for raw in (rng.bytes(3200), bytes(3200), saved[:-1], saved[3:-29], b"\x80" * 3200):
        path = tmp_path / "scene"
        path.write_bytes(raw)
        with pytest.raises(LoadError, match=r"is of no known format.*--format"):
            io.load(path)


def test_a_large_gltf_is_told_by_how_it_begins(tmp_path: Path) -> None:
    io.save(tmp_path / "saved.gltf", random_gaussians(np.random.default_rng(5), 20_000, 1))
    odd = (tmp_path / "saved.gltf").rename(tmp_path / "scene")
    assert odd.stat().st_size > PARSED_BYTES
    assert len(io.load(odd)) == 20_000


def test_a_format_that_is_not_known_is_refused() -> None:
    with pytest.raises(OptionError, match=r"format must be one of ply, .*, got 'obj'"):
        io.load(io.demo_path(), format="obj")


def test_a_scene_of_every_suffix_is_found_in_a_folder() -> None:
    suffixes = {suffix for known in FORMATS for suffix in known.suffixes} - {".json"}
    assert {
        suffix for suffix in suffixes if not find_series([f"a{suffix}"]) and not find_series([suffix])
    } == set()


def test_the_command_line_has_the_names_that_the_library_has() -> None:
    assert options.FORMAT_NAMES == FORMAT_NAMES
    assert options.SPZ_FRAMES == SPZ_FRAMES


@pytest.mark.parametrize(
    ("url", "name"),
    [
        ("https://host/download?file=scenes/garden.ksplat&token=x", "garden.ksplat"),
        ("https://host/x?response-content-disposition=attachment%3B%20filename%3D%22a%20b.splat%22", "a b.splat"),
        ("https://host/garden.ply?file=other.splat", "garden.ply"),
        ("https://host/garden?v=2", "garden"),
        ("https://host/?q=../../etc/x.ply", "x.ply"),
        ("https://[odd/x?y=z.ply#a.splat", "z.ply"),
    ],
)
def test_a_url_whose_path_has_no_suffix_is_called_what_its_query_says(url: str, name: str) -> None:
    assert file_name(url) == name
