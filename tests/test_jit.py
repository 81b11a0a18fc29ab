"""What compiles kernels and keeps them: in processes of their own, each with the cache folder it is given."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tsplat import _kernel_cache as cache

PACKAGE = Path(cache.__file__).parent

KERNELS = """
from tsplat import _jit

@_jit.part
def double(x):
    return x + x

@_jit.kernel
def quadruple(x):
    return double(double(x))
"""


def run(folder: Path, code: str, **environment: str) -> str:
    """Run a program beside `KERNELS`; return what it printed."""
    module = folder / "kernels_of_test.py"
    if not module.exists():
        module.write_text(KERNELS)
    path = os.pathsep.join([str(folder), str(PACKAGE.parent)])
    variables = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": path, **environment}
    variables.pop("NUMBA_DISABLE_JIT", None)
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, env=variables, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout.decode().strip()


CALL = "import sys, kernels_of_test as k; print(k._jit.progress() is None, k.quadruple(3), k.double('ab'));"
COUNT = "p = k._jit.progress(); print(p and p.done, 'numba' in sys.modules)"


def test_the_second_process_runs_what_the_first_compiled_without_numba(tmp_path: Path) -> None:
    assert run(tmp_path, CALL + COUNT) == "True 12 abab\n2 True"
    assert run(tmp_path, CALL + COUNT) == "True 12 abab\nNone False"


def test_a_loaded_kernel_compiles_for_other_types(tmp_path: Path) -> None:
    run(tmp_path, CALL)
    assert run(tmp_path, CALL + "print(k.quadruple(0.25), k._jit.progress()[0])") == "True 12 abab\n1.0 2"


def test_without_a_folder_that_can_be_written_kernels_are_compiled_each_time(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for _ in range(2):
        assert run(tmp_path, CALL + COUNT, NUMBA_CACHE_DIR=str(tmp_path / "file")) == "True 12 abab\n2 True"


def test_a_part_that_is_made_a_kernel_is_compiled(tmp_path: Path) -> None:
    code = "import kernels_of_test as k; f = k._jit.kernel(k.double); print(f(21), len(f.codes))"
    assert run(tmp_path, code) == "42 1"


def test_other_users_of_numba_keep_their_cache_folder(tmp_path: Path) -> None:
    code = "import numba; before = numba.config.CACHE_DIR; import kernels_of_test as k; k.quadruple(1); "
    assert run(tmp_path, code + "print(before == numba.config.CACHE_DIR)") == "True"


def test_code_that_is_not_whole_is_compiled_again(tmp_path: Path) -> None:
    run(tmp_path, CALL)
    (kept,) = (tmp_path / "cache").glob("*/quadruple-*")
    kept.write_bytes(kept.read_bytes()[:-100])
    assert run(tmp_path, CALL + COUNT) == "True 12 abab\n2 True"
    assert run(tmp_path, CALL + COUNT) == "True 12 abab\nNone False"


def test_code_of_versions_that_were_long_not_used_goes_when_a_new_one_comes(tmp_path: Path) -> None:
    old, recent = (tmp_path / "cache" / f"kernels-{name}" for name in ("old", "recent"))
    for folder in (old, recent):
        folder.mkdir(parents=True)
        (folder / "draw-1").touch()
    os.utime(old, (0, 0))
    run(tmp_path, CALL)
    assert not old.exists()
    assert (recent / "draw-1").exists()


def test_a_part_that_is_edited_outside_of_the_package_is_compiled_again(tmp_path: Path) -> None:
    run(tmp_path, CALL)
    module = tmp_path / "kernels_of_test.py"
    module.write_text(module.read_text().replace("x + x", "x + x + x"))
    assert run(tmp_path, "import kernels_of_test as k; print(k.quadruple(3))") == "27"


def test_a_kernel_is_ready_once_it_was_compiled_for_such_arguments(tmp_path: Path) -> None:
    code = "import kernels_of_test as k; print(k.quadruple.ready(1), k.quadruple.ready(1.5))"
    assert run(tmp_path, code) == "False False"
    run(tmp_path, CALL)
    assert run(tmp_path, code) == "True False"


@pytest.fixture
def package(tmp_path: Path) -> Path:
    for name in ("rendering.py", "raster/bin.py", "cli.py", "viewer/loop.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(f"NAME = '{name}'\n")
    return tmp_path


@pytest.mark.parametrize("name", ["rendering.py", "raster/bin.py", "raster/new.py", "new/__init__.py"])
def test_an_edit_that_a_kernel_could_see_changes_the_digest(package: Path, name: str) -> None:
    before = cache.source_digest(package)
    (package / name).parent.mkdir(exist_ok=True)
    (package / name).write_text("NAME = 'edited'\n")
    assert cache.source_digest(package) != before


def test_what_moves_to_another_file_changes_the_digest(package: Path) -> None:
    before = cache.source_digest(package)
    (package / "raster" / "bin.py").rename(package / "raster" / "bins.py")
    assert cache.source_digest(package) != before


@pytest.mark.parametrize("name", ["cli.py", "viewer/loop.py", "viewer/new.py"])
def test_an_edit_that_no_kernel_can_see_compiles_nothing_again(package: Path, name: str) -> None:
    before = cache.source_digest(package)
    (package / name).write_text("NAME = 'edited'\n")
    assert cache.source_digest(package) == before


def test_no_kernel_sees_what_the_digest_leaves_out(tmp_path: Path) -> None:
    code = "import sys, tsplat.raster, tsplat.decode.kernels, tsplat.encode.sixel; print(*sys.modules)"
    seen = {name.split(".")[1] for name in run(tmp_path, code).split() if name.startswith("tsplat.")}
    assert "raster" in seen
    assert not seen & {name.removesuffix(".py") for name in cache.NOT_COMPILED}
    assert all((PACKAGE / name).exists() for name in cache.NOT_COMPILED)
