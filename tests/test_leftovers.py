"""What ended processes left is removed by the next, and nothing else is."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tsplat._leftovers import Owner, clear, hold
from tsplat.encode import handover
from tsplat.encode.handover import Handover
from tsplat.files import replacing
from tsplat.temporary import TemporaryFolder

pytestmark = pytest.mark.skipif(os.name != "posix", reason="nothing is looked for where there are no such locks")

FRAME = np.zeros((2, 2, 3), np.uint8)

KINDS = {
    "part": """
from tsplat.files import replacing
with replacing(folder / "scene.ply") as file:
    file.write(b"half")
    file.flush()
    ready()
""",
    "folder": """
from tsplat.temporary import TemporaryFolder
with TemporaryFolder() as place:
    (pathlib.Path(place) / "scene.ply").write_bytes(b"half")
    ready()
""",
    "frames": """
import numpy as np
from tsplat.encode import handover
handover._SHARED_DIRECTORY = folder
left = handover.Handover("file")
for _ in range(3):
    left.leave(np.zeros((2, 2, 3), np.uint8))
ready()
""",
}
"""What leaves something in a folder, if it is killed when it is ready."""

BEGIN = """
import pathlib, sys
folder = pathlib.Path(sys.argv[1])
def ready():
    print("ready", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(handover, "_SHARED_DIRECTORY", tmp_path)
    return tmp_path


def started(kind: str, folder: Path) -> subprocess.Popen[bytes]:
    process = subprocess.Popen(
        [sys.executable, "-c", BEGIN + KINDS[kind], folder],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, "TMPDIR": str(folder)},
    )
    assert process.stdout
    assert process.stdout.readline() == b"ready\n"
    return process


def make_another(kind: str, folder: Path) -> None:
    """Do what a next process does, and leave nothing."""
    if kind == "part":
        with replacing(folder / "other.ply"):
            pass
        (folder / "other.ply").unlink()
    elif kind == "folder":
        with TemporaryFolder():
            pass
    else:
        frames = Handover("file")
        frames.leave(FRAME)
        frames.clear()


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_killed_process_left_goes_with_the_next_and_what_is_in_use_stays(kind: str, folder: Path) -> None:
    with started(kind, folder) as process:
        there = sorted(folder.iterdir())
        assert there
        make_another(kind, folder)
        assert sorted(folder.iterdir()) == there
        process.send_signal(signal.SIGKILL)
        process.wait(60)
        assert sorted(folder.iterdir()) == there
        make_another(kind, folder)
        assert list(folder.iterdir()) == []


@pytest.mark.parametrize(("kind", "left"), [("part", ["scene.ply"]), ("folder", [])])
def test_who_ends_by_itself_leaves_nothing(kind: str, left: list[str], folder: Path) -> None:
    with started(kind, folder) as process:
        process.communicate(timeout=60)
    assert [path.name for path in folder.iterdir()] == left


def test_what_only_looks_like_a_leftover_stays(folder: Path) -> None:
    """Names that a person may give, links, and what belongs to somebody else."""
    names = [".scene.ply.part", ".scene.ply.1.part", ".scene.ply.0123456789abcde.part", "tsplat-download.tmp"]
    for name in names:
        (folder / name).write_text("mine")
    (folder / "tsplat-0123456789abcdef.tmp").symlink_to(folder / names[0])
    os.mkfifo(folder / ".x.0123456789abcdef.part")
    if os.geteuid() == 0:
        (folder / ".y.0123456789abcdef.part").touch()
        os.chown(folder / ".y.0123456789abcdef.part", 12345, 12345)
    before = sorted(folder.iterdir())
    for kind in KINDS:
        make_another(kind, folder)
    assert sorted(folder.iterdir()) == before


def test_a_file_that_was_taken_for_left_behind_is_made_again(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between the making and the holding another process may look."""
    removed: list[bool] = []

    def late(descriptor: int, path: Path) -> bool:
        if not removed:
            clear(folder, re.compile(r".*\.part"))
            removed.append(not path.exists())
        return hold(descriptor, path)

    monkeypatch.setattr("tsplat.files.hold", late)
    with replacing(folder / "x") as file:
        file.write(b"whole")
    assert removed == [True]
    assert (folder / "x").read_bytes() == b"whole"
    assert [path.name for path in folder.iterdir()] == ["x"]


def test_names_without_a_folder_need_none(tmp_path: Path) -> None:
    owner = Owner(tmp_path / "none")
    assert re.fullmatch(r"tsplat-[0-9a-f]{12}", owner.name)
    owner.close()


def test_a_forked_child_that_ends_takes_nothing_of_its_parents_along(folder: Path) -> None:
    code = (
        BEGIN
        + """
import atexit, os
from tsplat.files import replacing
from tsplat.temporary import TemporaryFolder
with TemporaryFolder() as place, replacing(folder / "x") as file:
    file.write(b"whole")
    file.flush()
    before = sorted(folder.iterdir())
    child = os.fork()
    if child == 0:  # what it unwinds on its way there would be its parent's as well
        atexit._run_exitfuncs()
        os._exit(0)
    os.waitpid(child, 0)
    assert sorted(folder.iterdir()) == before
"""
    )
    environment = {**os.environ, "TMPDIR": str(folder)}
    subprocess.run([sys.executable, "-c", code, folder], env=environment, timeout=60, check=True)
    assert (folder / "x").read_bytes() == b"whole"
