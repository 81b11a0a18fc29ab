from __future__ import annotations

import base64
import resource
from collections.abc import Iterator
from multiprocessing import resource_tracker
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path

import numpy as np
import pytest

from tests.encode.frames import U8, gradient
from tests.encode.test_kitty import commands
from tsplat.encode import handover
from tsplat.encode.kitty import Kitty
from tsplat.errors import OptionError


@pytest.fixture
def shared() -> Iterator[Kitty]:
    kitty = Kitty("shared")
    yield kitty
    kitty.clear()


@pytest.fixture
def filed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Kitty]:
    monkeypatch.setattr(handover, "_SHARED_DIRECTORY", tmp_path)
    kitty = Kitty("file")
    yield kitty
    kitty.clear()


def upload(kitty: Kitty, frame: U8) -> tuple[dict[str, str], str]:
    """Send a frame; return the one command's keys and the name of what was left."""
    ((keys, payload),) = commands(kitty.encode(frame, 2, 2, (10, 20)).upload)
    return keys, base64.b64decode(payload, validate=True).decode()


def fetch(keys: dict[str, str], name: str) -> U8:
    """Read shared memory as a terminal does, and remove it."""
    memory = SharedMemory(name.removeprefix("/"))
    shape = int(keys["v"]), int(keys["s"]), 3
    frame = np.frombuffer(memory.buf, np.uint8, count=int(keys["S"])).reshape(shape).copy()
    memory.close()
    memory.unlink()
    return frame


def is_there(name: str) -> bool:
    try:
        memory = SharedMemory(name.removeprefix("/"))
    except FileNotFoundError:
        return False
    memory.close()
    # Python takes whoever opens memory for its owner, who is to remove it.
    resource_tracker.unregister(name, "shared_memory")
    return True


def test_the_terminal_finds_the_very_pixels_in_shared_memory(shared: Kitty) -> None:
    for width in (1, 37, 200):
        frame = gradient(width, 23)
        keys, name = upload(shared, frame)
        assert keys.items() >= {"a": "t", "t": "s", "f": "24", "q": "2"}.items()
        assert np.array_equal(fetch(keys, name), frame)


def test_a_view_into_a_larger_frame_is_left_as_it_looks(shared: Kitty) -> None:
    frame = gradient(40, 30)[3:20:2, 5:31]
    assert np.array_equal(fetch(*upload(shared, frame)), frame)


def test_shared_memory_that_nobody_fetched_is_gone_after_clearing(shared: Kitty) -> None:
    names = [upload(shared, gradient(5, 4))[1] for _ in range(3)]
    assert all(map(is_there, names))
    shared.clear()
    assert not any(map(is_there, names))


def test_only_the_latest_eight_frames_wait_for_a_terminal_that_fetches_none(shared: Kitty) -> None:
    names = [upload(shared, gradient(5, 4))[1] for _ in range(11)]
    assert list(map(is_there, names)) == [False] * 3 + [True] * 8


def test_the_terminal_finds_the_very_pixels_in_a_file_that_it_may_remove(filed: Kitty, tmp_path: Path) -> None:
    frame = gradient(31, 17)
    keys, name = upload(filed, frame)
    assert keys.items() >= {"a": "t", "t": "t", "f": "24", "s": "31", "v": "17", "q": "2"}.items()
    assert "tty-graphics-protocol" in Path(name).name
    assert Path(name).parent == tmp_path
    assert Path(name).read_bytes() == frame.tobytes()
    assert Path(name).stat().st_mode & 0o077 == 0


def test_files_that_nobody_fetched_are_gone_after_clearing(filed: Kitty, tmp_path: Path) -> None:
    fetched, _ = (Path(upload(filed, gradient(5, 4))[1]) for _ in range(2))
    fetched.unlink()
    assert len(list(tmp_path.glob("*-tty-graphics-protocol"))) == 1
    filed.clear()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("transport", ["shared", "file"])
def test_where_there_is_no_room_frames_go_directly_and_leave_nothing(
    transport: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    directory = Path("/dev/shm") if transport == "shared" else tmp_path
    monkeypatch.setattr(handover, "_SHARED_DIRECTORY", tmp_path)
    before, kitty, frame = set(directory.glob("*tsplat*")), Kitty(transport), gradient(200, 100)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
    try:
        uploads = [kitty.encode(frame, 2, 2, (10, 20)).upload for _ in range(2)]
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    direct = Kitty()
    assert uploads == [direct.encode(frame, 2, 2, (10, 20)).upload for _ in range(2)]
    assert set(directory.glob("*tsplat*")) == before


def test_fidelity_takes_nothing_from_what_stays_on_the_machine(shared: Kitty) -> None:
    shared.fidelity = 0.1
    frame = gradient(50, 40)
    assert np.array_equal(fetch(*upload(shared, frame)), frame)


def test_a_transport_that_does_not_exist_is_refused() -> None:
    with pytest.raises(OptionError, match="one of shared, file, direct, got 'pigeon'"):
        Kitty("pigeon")
