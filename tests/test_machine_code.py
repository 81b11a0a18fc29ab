"""Kept machine code is what was kept under its name, or it is as if there were none."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tsplat import _kernel_cache, _machine_code
from tsplat._arguments import described, flat
from tsplat._jit import JIT, kernel
from tsplat._machine_code import HEADER_BYTES, MachineCode, from_bytes, to_bytes

pytestmark = pytest.mark.skipif(not JIT, reason="nothing is compiled or kept")

posix_only = pytest.mark.skipif(os.name != "posix", reason="pipes, modes and owners are POSIX'")


@kernel
def _twice(x):  # type: ignore[no-untyped-def]
    return x + x


@pytest.fixture(scope="module")
def code() -> MachineCode:
    from tsplat._compiler import compile_kernel

    return compile_kernel(_twice.function, (3,), lambda _: None)


def test_what_was_kept_comes_back_under_its_own_name_alone(code: MachineCode) -> None:
    kept = to_bytes(code, "twice-1")
    assert from_bytes(kept, "twice-1") == code
    assert from_bytes(kept, "twice-2") is None


def test_any_damage_is_noticed(code: MachineCode) -> None:
    kept = to_bytes(code, "twice")
    for place in [*range(HEADER_BYTES + 20), len(kept) // 2, len(kept) - 1]:
        damaged = bytearray(kept)
        damaged[place] ^= 1
        assert from_bytes(bytes(damaged), "twice") is None, place
    for end in [*range(HEADER_BYTES + 20), len(kept) // 2, len(kept) - 1]:
        assert from_bytes(kept[:end], "twice") is None, end
    assert from_bytes(kept + b"\0", "twice") is None
    assert from_bytes(bytes(4), "twice") is None  # whose CRC-32 is 0


@pytest.mark.parametrize("object_file", [b"", b"no object file", b"\x7fELF", bytes(1000)])
def test_what_is_no_object_file_is_never_linked(code: MachineCode, object_file: bytes) -> None:
    assert from_bytes(to_bytes(code._replace(object_file=object_file), "twice"), "twice") is None


def test_a_result_of_no_known_kind_is_refused(code: MachineCode) -> None:
    body = b"\xff\xfe\n" + code.object_file
    digest = hashlib.sha256(b"twice\n" + body).digest()
    kept = _machine_code.MAGIC + len(body).to_bytes(8, "little") + digest + body
    assert from_bytes(kept, "twice") is None


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: MachineCode) -> Iterator[Path]:
    """A folder of its own, where the kernel is kept."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    _kernel_cache.cache_folder.cache_clear()
    file = _kernel_cache.place(_twice.function, described(flat((3,)).types))
    assert file
    _kernel_cache.keep(file, code)
    assert is_found()
    yield file
    _kernel_cache.cache_folder.cache_clear()


def is_found() -> bool:
    """Tell whether a process that begins now would find the kernel."""
    _kernel_cache.cache_folder.cache_clear()
    fresh = kernel(_twice.function)
    found = fresh.ready(3)
    assert not found or fresh(21) == 42
    return found


def _pipe(file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


def _link(file: Path) -> None:
    file.rename(file.with_name("moved"))
    file.symlink_to("moved")


def _forged(file: Path) -> None:
    file.write_bytes(to_bytes(MachineCode("int", b"no object file"), file.name))


def _of_another_kernel(file: Path) -> None:
    code = from_bytes(file.read_bytes(), file.name)
    assert code
    file.write_bytes(to_bytes(code, "draw"))


def _large(file: Path) -> None:
    with file.open("r+b") as sparse:
        sparse.truncate(1 << 40)


DAMAGE: dict[str, Callable[[Path], object]] = {
    "nothing": lambda file: file.write_bytes(b""),
    "four zero bytes": lambda file: file.write_bytes(bytes(4)),
    "a right digest over no object file": _forged,
    "another kernel's": _of_another_kernel,
    "a terabyte": _large,
    "a pipe": _pipe,
    "a link": _link,
    "a file for all to write": lambda file: file.chmod(0o666),
}


@posix_only
@pytest.mark.parametrize("damage", DAMAGE)
def test_whatever_is_wrong_with_it_a_kernel_is_not_there_and_is_kept_again(
    place: Path, code: MachineCode, damage: str
) -> None:
    DAMAGE[damage](place)
    assert not is_found()
    _kernel_cache.keep(place, code)
    assert is_found()
    assert place.lstat().st_mode & 0o777 == 0o600


@posix_only
@pytest.mark.parametrize("mode", [0o777, 0o775, 0o757])
@pytest.mark.parametrize("above", [False, True])
def test_nothing_is_run_from_a_folder_that_others_can_write_to(place: Path, mode: int, above: bool) -> None:
    folder = place.parents[1] if above else place.parent
    folder.chmod(mode)
    assert not is_found()
    assert _kernel_cache.cache_folder() is None
    folder.chmod(0o755)
    assert is_found()


@posix_only
def test_a_folder_for_all_like_tmp_will_do_where_the_one_in_it_is_ours(place: Path) -> None:
    place.parents[1].chmod(0o1777)
    assert is_found()


@posix_only
@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="root alone gives them away")
@pytest.mark.parametrize("depth", [None, 0, 1])
def test_nothing_that_a_stranger_owns_is_run(place: Path, depth: int | None) -> None:
    os.chown(place if depth is None else place.parents[depth], 12345, 12345)
    assert not is_found()


@posix_only
def test_old_folders_that_are_not_ours_stay(place: Path, tmp_path: Path) -> None:
    (tmp_path / "cache" / "kernels-theirs").mkdir()
    (tmp_path / "cache" / "kernels-theirs").chmod(0o777)
    os.utime(tmp_path / "cache" / "kernels-theirs", (0, 0))
    shutil.rmtree(place.parent)
    _kernel_cache.cache_folder.cache_clear()
    assert _kernel_cache.cache_folder() == place.parent
    assert (tmp_path / "cache" / "kernels-theirs").exists()
