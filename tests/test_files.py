"""Files that are whole or not there at all."""

from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from tsplat.errors import SaveError, TerminalError
from tsplat.files import replacing, tidy_end

posix_only = pytest.mark.skipif(os.name != "posix", reason="modes, owners, links and pipes are POSIX'")
root_only = pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0, reason="root alone gives them away"
)


def write(path: Path, content: bytes = b"new") -> None:
    with replacing(path) as file:
        file.write(content)


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


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_that_ends_the_process_leaves_no_half_file(tmp_path: Path, number: signal.Signals) -> None:
    def write_half() -> None:
        with tidy_end(), replacing(tmp_path / "x") as file:
            file.write(b"half")
            os.kill(os.getpid(), number)

    before = signal.signal(number, signal.SIG_DFL)
    try:
        with pytest.raises(SystemExit) as caught:
            write_half()
        assert signal.getsignal(number) is signal.SIG_DFL
    finally:
        signal.signal(number, before)
    assert caught.value.code == 128 + number
    assert not list(tmp_path.iterdir())


def test_a_signal_that_somebody_ignores_or_heeds_stays_theirs() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with tidy_end():
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_signals_are_left_alone_on_other_threads() -> None:
    failed: list[BaseException] = []

    def end() -> None:
        try:
            with tidy_end():
                pass
        except ValueError as error:
            failed.append(error)

    thread = threading.Thread(target=end)
    thread.start()
    thread.join()
    assert not failed


def test_a_thread_that_nobody_waits_for_leaves_nothing_behind(tmp_path: Path) -> None:
    code = f"""
import threading
from pathlib import Path
from tsplat.files import replacing
written = threading.Event()
def write():
    with replacing(Path({str(tmp_path / "x")!r})) as file:
        file.write(b"half")
        file.flush()
        written.set()
        threading.Event().wait()
threading.Thread(target=write, daemon=True).start()
assert written.wait(10.0)
assert list(Path({str(tmp_path)!r}).iterdir())
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
    assert list(tmp_path.iterdir()) == []


def test_threads_that_save_one_path_each_save_it_whole(tmp_path: Path) -> None:
    path, failed = tmp_path / "x", []

    def save(content: bytes) -> None:
        try:
            for _ in range(50):
                write(path, content)
        except SaveError as error:
            failed.append(error)

    contents = [bytes([number]) * 1000 for number in range(3)]
    threads = [threading.Thread(target=save, args=(content,)) for content in contents]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failed
    assert path.read_bytes() in contents
    assert list(tmp_path.iterdir()) == [path]


def test_an_unfinished_file_of_the_same_process_number_is_in_nobodys_way(tmp_path: Path) -> None:
    stale = tmp_path / f".x.{os.getpid()}.part"
    stale.write_bytes(b"of another container")
    write(tmp_path / "x")
    assert (tmp_path / "x").read_bytes() == b"new"
    assert stale.exists()


@pytest.mark.parametrize("name", ["x" * 255, "\N{SNOWMAN}" * 85, "new\nline", ".hidden", "a b"])
def test_any_name_that_the_file_system_takes_can_be_saved(tmp_path: Path, name: str) -> None:
    write(tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == [name]


@posix_only
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664, 0o444, 0o755])
def test_a_file_that_is_replaced_keeps_its_mode(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"old")
    path.chmod(mode)
    with replacing(path) as file:
        assert stat.S_IMODE(os.fstat(file.fileno()).st_mode) & 0o077 & ~mode == 0  # nor does it show more before
        file.write(b"new")
    assert path.read_bytes() == b"new"
    assert stat.S_IMODE(path.stat().st_mode) == mode


@posix_only
@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_a_new_file_has_the_mode_that_the_umask_leaves(tmp_path: Path, umask: int, mode: int) -> None:
    before = os.umask(umask)
    try:
        write(tmp_path / "x")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "x").stat().st_mode) == mode


@root_only
def test_a_file_that_is_replaced_keeps_its_owner(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"old")
    path.chmod(0o640)
    os.chown(path, 12345, 23456)
    write(path)
    about = path.stat()
    assert (about.st_uid, about.st_gid, stat.S_IMODE(about.st_mode)) == (12345, 23456, 0o640)


@root_only
def test_where_the_owner_cannot_be_kept_another_group_gets_no_rights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    path = tmp_path / "x"
    path.write_bytes(b"old")
    path.chmod(0o664)
    os.chown(path, 12345, 23456)
    monkeypatch.setattr(os, "fchown", refuse)
    write(path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o604


@posix_only
@pytest.mark.parametrize("there", [True, False])
def test_a_link_stays_and_what_it_leads_to_is_written(tmp_path: Path, there: bool) -> None:
    folder, link, hop = tmp_path / "folder", tmp_path / "link", tmp_path / "hop"
    folder.mkdir()
    if there:
        (folder / "x").write_bytes(b"old")
    hop.symlink_to("folder/x")
    link.symlink_to("hop")
    write(link)
    assert link.is_symlink()
    assert hop.is_symlink()
    assert (folder / "x").read_bytes() == b"new"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder", "hop", "link"]
    assert [path.name for path in folder.iterdir()] == ["x"]


@root_only
def test_a_link_that_somebody_else_put_into_a_folder_for_all_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine").write_bytes(b"old")
    (tmp_path / "x").symlink_to("mine")
    os.chown(tmp_path / "x", 12345, 12345, follow_symlinks=False)
    with pytest.raises(SaveError, match="it is a link that somebody else made"):
        write(tmp_path / "x")
    assert (tmp_path / "mine").read_bytes() == b"old"


@posix_only
@pytest.mark.parametrize("kind", ["pipe", "loop", "device"])
def test_what_is_no_file_is_refused_and_stays(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "x"
    if kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to("x" if kind == "loop" else os.devnull)
    before, device = path.lstat(), os.stat(os.devnull)
    with pytest.raises(SaveError, match=r"x: cannot be written: it is a device, a pipe or a link to itself"):
        write(path)
    assert path.lstat().st_ino == before.st_ino
    assert os.stat(os.devnull).st_rdev == device.st_rdev
    assert list(tmp_path.iterdir()) == [path]


def test_a_second_signal_does_not_keep_the_first_from_tidying_up(tmp_path: Path) -> None:
    code = f"""
import os, signal
from pathlib import Path
from tsplat import files
def interrupted(path, missing_ok=False):
    os.kill(os.getpid(), signal.SIGTERM)
    os.unlink(path)
Path.unlink = interrupted
with files.tidy_end(), files.replacing(Path({str(tmp_path / "x")!r})):
    os.kill(os.getpid(), signal.SIGTERM)
    signal.pause()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (128 + signal.SIGTERM, b"")
    assert list(tmp_path.iterdir()) == []
