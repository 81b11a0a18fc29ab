"""Files that are whole or not there at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from tsplat.errors import SaveError, TerminalError
from tsplat.files import replacing


def test_the_file_is_there_only_when_all_went_well(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"old")
    with replacing(path) as file:
        file.write(b"new")
        assert path.read_bytes() == b"old"
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ZeroDivisionError, SystemExit])
def test_whatever_ends_the_writing_leaves_the_old_file(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"old")

    def write_half() -> None:
        with replacing(path) as file:
            file.write(b"half")
            raise error

    with pytest.raises(error):
        write_half()
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_an_error_that_is_not_about_the_file_keeps_its_words(tmp_path: Path) -> None:
    with pytest.raises(TerminalError, match=r"^the terminal went away$"), replacing(tmp_path / "x"):
        raise TerminalError("the terminal went away")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["none/x", ""])
def test_a_place_that_takes_no_file_is_known_before_anything_is_done(tmp_path: Path, name: str) -> None:
    reached = False
    with pytest.raises(SaveError, match="cannot be written"), replacing(tmp_path / name):
        reached = True
    assert not reached
