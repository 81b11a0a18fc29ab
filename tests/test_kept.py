"""Files that are kept between runs: within a bound, the least recently used go first, and nothing ever fails."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import pytest

from tsplat import kept
from tsplat.errors import OptionError


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "folder", lambda: tmp_path / "tsplat" / "hierarchies")
    monkeypatch.setenv(kept.SIZE_VARIABLE, "1e-6")  # a thousand bytes


def writing(size: int) -> Callable[[BinaryIO], None]:
    def write(file: BinaryIO) -> None:
        file.write(bytes(size))

    return write


def names() -> list[str]:
    return [entry.path.stem for entry in kept.entries()]


def used(name: str, seconds: float) -> None:
    os.utime(kept.folder() / f"{name}.tsplat", (seconds, seconds))


def test_what_is_kept_is_recalled() -> None:
    assert kept.keep("a", 3, lambda file: file.write(b"abc") and None)
    path = kept.recalled("a")
    assert path is not None
    assert path.read_bytes() == b"abc"
    assert kept.recalled("b") is None


def test_what_was_not_used_for_longest_makes_room() -> None:
    for age, name in enumerate("abc"):
        assert kept.keep(name, 300, writing(300))
        used(name, 1000.0 + age)
    kept.recalled("a")
    assert kept.keep("d", 500, writing(500))
    assert sorted(names()) == ["a", "d"]


def test_what_needs_no_room_stays() -> None:
    for name in "abc":
        assert kept.keep(name, 300, writing(300))
    assert sorted(names()) == ["a", "b", "c"]


def test_what_is_larger_than_the_bound_is_not_kept_and_removes_nothing() -> None:
    assert kept.keep("a", 300, writing(300))
    assert not kept.keep("b", 1001, writing(1001))
    assert names() == ["a"]


def test_nothing_is_kept_where_the_bound_is_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(kept.SIZE_VARIABLE, "0")
    assert not kept.keep("a", 1, writing(1))
    assert names() == []


@pytest.mark.parametrize("text", ["much", "-1", "nan", "inf", "1e10"])
def test_a_bound_that_is_no_size_is_an_error_but_only_where_it_is_asked_for(
    monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    monkeypatch.setenv(kept.SIZE_VARIABLE, text)
    with pytest.raises(OptionError, match="TSPLAT_CACHE_GB must be gigabytes"):
        kept.bound()
    assert not kept.keep("a", 1, writing(1))


def test_a_disk_that_is_nearly_full_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(kept.SIZE_VARIABLE)
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": 5000}))
    assert kept.bound() == 1000
    assert kept.keep("a", 900, writing(900))
    assert kept.bound() == 1180  # what is kept could be free
    assert not kept.keep("b", 1200, writing(1200))


def test_much_room_is_not_filled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(kept.SIZE_VARIABLE)
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": 10**15}))
    assert kept.bound() == 8 * 10**9


def test_a_full_disk_keeps_nothing() -> None:
    def write(file: BinaryIO) -> None:
        file.write(b"half")
        raise OSError(28, "No space left on device")

    assert not kept.keep("a", 4, write)
    assert list(kept.folder().iterdir()) == []


def test_a_folder_that_cannot_be_made_keeps_nothing(tmp_path: Path) -> None:
    (tmp_path / "tsplat").write_text("in the way")
    assert not kept.keep("a", 1, writing(1))
    assert kept.recalled("a") is None
    assert kept.entries() == kept.clear() == []


def test_files_of_ended_processes_go_when_room_is_made() -> None:
    kept.folder().mkdir(parents=True)
    old, new = (kept.folder() / f".{name}.tsplat.1.part" for name in ("old", "new"))
    old.write_bytes(b"x")
    new.write_bytes(b"x")
    os.utime(old, (1000.0, 1000.0))
    assert kept.keep("a", 1, writing(1))
    assert new.exists()
    assert not old.exists()


def _pipe(file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


def _link(file: Path) -> None:
    file.rename(file.with_name("moved"))
    file.symlink_to("moved")


@pytest.mark.skipif(os.name != "posix", reason="pipes and modes are POSIX'")
@pytest.mark.parametrize(
    "damage",
    [_pipe, _link, lambda file: file.chmod(0o666), lambda file: file.parent.chmod(0o777)],
    ids=["pipe", "link", "for all to write", "folder for all to write"],
)
def test_what_a_stranger_may_have_put_there_is_as_good_as_none(damage: Callable[[Path], None]) -> None:
    assert kept.keep("a", 1, writing(1))
    path = kept.recalled("a")
    assert path
    damage(path)
    assert kept.recalled("a") is None
    assert [entry for entry in kept.entries() if not entry.path.is_file()] == []


@pytest.mark.skipif(os.name != "posix", reason="modes are POSIX'")
def test_nothing_is_kept_where_others_write() -> None:
    kept.folder().mkdir(parents=True)
    kept.folder().chmod(0o777)
    assert not kept.keep("a", 1, writing(1))
    assert list(kept.folder().iterdir()) == []


@pytest.mark.skipif(os.name != "posix", reason="modes are POSIX'")
def test_what_is_kept_is_for_nobody_else_to_see() -> None:
    assert kept.keep("a", 1, writing(1))
    assert (kept.folder() / "a.tsplat").stat().st_mode & 0o777 == 0o600
    assert kept.folder().stat().st_mode & 0o777 == 0o700


def test_clearing_removes_all_but_what_is_not_ours() -> None:
    assert kept.keep("a", 1, writing(1))
    (kept.folder() / ".b.tsplat.1.part").write_bytes(b"x")
    (kept.folder() / "notes.txt").write_text("mine")
    assert len(kept.clear()) == 2
    assert [path.name for path in kept.folder().iterdir()] == ["notes.txt"]
