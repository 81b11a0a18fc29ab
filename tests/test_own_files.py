"""What may be run from a folder: files that this user wrote, where nobody else can write."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from tsplat.own_files import is_private, make_private, read_own

pytestmark = pytest.mark.skipif(os.name != "posix", reason="each user's folders are their own")

STRANGER = 12345


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    place = tmp_path / "above" / "folder"
    make_private(place)
    return place


def test_a_folder_that_is_made_is_private_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        make_private(tmp_path / "a" / "b")
    finally:
        os.umask(before)
    assert is_private(tmp_path / "a" / "b")
    for made in (tmp_path / "a", tmp_path / "a" / "b"):
        assert stat.S_IMODE(made.stat().st_mode) == 0o700


def test_an_own_folder_that_others_read_is_closed_to_them(tmp_path: Path) -> None:
    tmp_path.chmod(0o755)
    make_private(tmp_path)
    assert stat.S_IMODE(tmp_path.stat().st_mode) == 0o700


@pytest.mark.parametrize("mode", [0o770, 0o720, 0o702, 0o777, 0o1777])
def test_a_folder_that_others_can_write_to_is_not_private(folder: Path, mode: int) -> None:
    folder.chmod(mode)
    make_private(folder)  # which trusts nothing that is in there
    assert not is_private(folder)


@pytest.mark.parametrize(("mode", "private"), [(0o755, True), (0o775, False), (0o757, False), (0o1777, True)])
def test_nobody_else_can_put_another_folder_in_its_place(folder: Path, mode: int, private: bool) -> None:
    folder.parent.chmod(mode)
    assert is_private(folder) == private


def test_a_folder_of_somebody_else_is_not_private(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mine = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: mine + 1)
    assert not is_private(folder)


@pytest.mark.skipif(os.geteuid() != 0, reason="root alone gives files away")
@pytest.mark.parametrize("name", ["above", "above/folder"])
def test_a_stranger_owns_no_folder_on_the_way(folder: Path, name: str) -> None:
    os.chown(folder.parents[1] / name, STRANGER, STRANGER)
    assert not is_private(folder)


def test_what_is_no_folder_is_not_private(folder: Path) -> None:
    (folder / "file").touch()
    (folder / "link").symlink_to(folder)
    for name in ("file", "link", "none"):
        assert not is_private(folder / name)


def test_an_own_file_is_read(folder: Path) -> None:
    (folder / "x").write_bytes(b"content")
    assert read_own(folder / "x", 7) == b"content"
    assert read_own(folder / "x", 6) is None


@pytest.mark.parametrize("mode", [0o620, 0o602, 0o666])
def test_a_file_that_others_can_write_to_is_not_read(folder: Path, mode: int) -> None:
    (folder / "x").write_bytes(b"content")
    (folder / "x").chmod(mode)
    assert read_own(folder / "x", 100) is None


def test_neither_pipes_nor_links_nor_folders_are_read_or_waited_for(folder: Path) -> None:
    os.mkfifo(folder / "pipe")
    (folder / "x").write_bytes(b"content")
    (folder / "link").symlink_to("x")
    assert read_own(folder / "pipe", 100) is None
    for name in ("link", ".."):
        with pytest.raises(OSError, match=r"Too many levels|Is a directory"):
            read_own(folder / name, 100)


def test_a_file_of_somebody_else_is_not_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "x").write_bytes(b"content")
    mine = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: mine + 1)
    assert read_own(folder / "x", 100) is None
