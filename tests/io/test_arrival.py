"""What comes from elsewhere is brought here to the end if it may be a scene, and while there is room for it."""

from __future__ import annotations

import errno
import shutil
from collections import namedtuple
from pathlib import Path

import pytest

from tests.io.honest_files import HONEST
from tsplat import io
from tsplat.errors import LoadError
from tsplat.io import arrival
from tsplat.io.arrival import keep_room, may_be_scene
from tsplat.io.formats import FORMATS, HEAD_BYTES

NO_SCENES = (bytes(4096), b"<!DOCTYPE html>" * 300, b"\x7fELF" * 1024, b"%PDF-1.7\n" * 500, b"[1, 2, 3]" * 500)


@pytest.mark.parametrize("name", HONEST)
def test_no_scene_is_cut_off(name: str) -> None:
    for path, content in HONEST[name].items():
        if Path(path).suffix != ".bin":  # comes with no scene from elsewhere
            assert may_be_scene(content[:HEAD_BYTES], Path(path).name), path
            assert may_be_scene(content[:HEAD_BYTES], "scene") or Path(path).suffix in arrival.UNMARKED


@pytest.mark.parametrize("suffix", ["", ".txt", *(suffix for known in FORMATS for suffix in known.suffixes)])
def test_what_is_cut_off_is_refused_whatever_follows(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"scene{suffix}"
    for content in NO_SCENES:
        if not may_be_scene(content[:HEAD_BYTES], path.name):
            path.write_bytes(content)
            with pytest.raises(LoadError):
                io.load(path)
        else:
            assert suffix in arrival.UNMARKED


def test_a_disk_is_not_filled_to_the_last_byte(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(10_000, 9_000, 1_000))
    keep_room(tmp_path / "x", 5_000, 800)
    keep_room(tmp_path / "x", 150, 850)
    with pytest.raises(OSError, match="No space left") as caught:
        keep_room(tmp_path / "x", 5_000, 801)
    assert caught.value.errno == errno.ENOSPC
