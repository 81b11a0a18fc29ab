"""The folder that a person stands in runs no code, whatever lies in it beside a scene."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tsplat import warmup_process
from tsplat._jit import JIT
from tsplat._search_path import PACKAGE_FOLDER, safe_path

MODULES = (
    "numpy",
    "rich_click",
    "click",
    "platformdirs",
    "typing",
    "threading",
    "numba",
    "llvmlite",
    "PIL",
    "shutil",
)
"""What a command imports, of our own dependencies and of Python's library."""

SCRIPT = "import sys; from tsplat.__main__ import main; sys.exit(main())"
"""What the command `tsplat` is, as pip installs it."""


@pytest.fixture
def trap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Stand in a folder where each module leaves a file when it is run; return that file."""
    folder, ran = tmp_path / "downloaded", tmp_path / "RAN"
    folder.mkdir()
    code = f"open({str(ran)!r}, 'a').write(__name__ + ' ')\n"
    for name in MODULES:
        (folder / f"{name}.py").write_text(code)
    (folder / "tsplat").mkdir()
    (folder / "tsplat" / "__init__.py").write_text(code)
    (folder / "sitecustomize.py").write_text(code)
    (folder / ".numba_config.yaml").write_text("cpu_name: nonsense\n")
    monkeypatch.chdir(folder)
    return ran


def tsplat(*command: str, **environment: str) -> subprocess.CompletedProcess[str]:
    variables = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(
        [sys.executable, *command],
        env=variables | environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def script(folder: Path) -> str:
    (folder / "bin").mkdir()
    (folder / "bin" / "tsplat").write_text(SCRIPT)
    return str(folder / "bin" / "tsplat")


@pytest.mark.usefixtures("compiled")
def test_a_command_imports_nothing_from_there(trap: Path, tmp_path: Path) -> None:
    done = tsplat(script(tmp_path), "render", "demo", "-o", str(tmp_path / "x.png"), "--width", "16")
    assert done.returncode == 0, done.stderr
    assert not trap.exists()


@pytest.mark.usefixtures("compiled")
@pytest.mark.parametrize("python_path", ["", ".", ":", "/none:", "./"])
def test_nor_does_it_where_the_environment_names_that_folder(trap: Path, tmp_path: Path, python_path: str) -> None:
    """All but what Python takes from there before any of ours: who names a folder there trusts it."""
    (trap.parent / "downloaded" / "sitecustomize.py").unlink()
    (trap.parent / "downloaded" / "tsplat" / "__init__.py").unlink()
    (trap.parent / "downloaded" / "tsplat").rmdir()
    done = tsplat(script(tmp_path), "--version", PYTHONPATH=python_path)
    assert done.returncode == 0, done.stderr
    assert not trap.exists()


def test_as_a_module_it_imports_nothing_from_there_once_it_was_found(trap: Path) -> None:
    """Python looks for `tsplat` there first, whatever we do: where there is one, `python -P -m tsplat` will do."""
    place = trap.parent / "downloaded" / "tsplat"
    done = tsplat("-P", "-m", "tsplat", "--version")
    assert done.returncode == 0, done.stderr
    (place / "__init__.py").unlink()
    place.rmdir()
    done = tsplat("-m", "tsplat", "--version")
    assert done.returncode == 0, done.stderr
    assert not trap.exists()


@pytest.mark.skipif(not JIT, reason="nothing is compiled")
def test_the_process_that_compiles_on_the_first_run_imports_nothing_from_there(trap: Path) -> None:
    """It begins as it does beside a command, and imports all that compiling takes."""
    code = warmup_process.CODE.replace(
        "compile_others()", "import tsplat._compiler, tsplat.encode, PIL, rich_click"
    )
    command = [code if word == warmup_process.CODE else word for word in warmup_process.command()]
    done = tsplat(*command, PYTHONPATH=".")
    assert done.returncode == 0, done.stderr
    assert not trap.exists()


@pytest.mark.skipif(not JIT, reason="nothing is compiled")
def test_numba_takes_no_settings_from_there(trap: Path, tmp_path: Path) -> None:
    """Where it can read them: a module `yaml` stands for the one that it would use."""
    (tmp_path / "packages").mkdir()
    (tmp_path / "packages" / "yaml.py").write_text("def safe_load(file): return {'cpu_name': 'nonsense'}\n")
    code = "from numba.core import config; print(config.CPU_NAME)"
    ignore = "from tsplat._search_path import ignore_current_folder as ignore; ignore(); "
    assert not trap.exists()
    for path in (trap.parent / "downloaded").glob("*.py"):
        path.unlink()
    said = [tsplat("-P", "-c", each + code, PYTHONPATH=str(tmp_path / "packages")) for each in ("", ignore)]
    assert [done.stdout.strip() for done in said] == ["nonsense", "None"], said[1].stderr
    assert said[1].stderr == ""


def test_the_same_tsplat_is_found_as_before(trap: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", ["", ".", str(trap.parent / "downloaded"), "relative", *sys.path])
    found = safe_path()
    assert PACKAGE_FOLDER in found
    assert all(Path(entry).is_absolute() for entry in found)
    assert str(trap.parent / "downloaded") not in found
    monkeypatch.setattr(sys, "path", [""])
    assert safe_path() == [PACKAGE_FOLDER]


@pytest.mark.parametrize("kind", ["tsplat", "python", "packages"])
def test_a_folder_where_something_is_installed_may_be_stood_in(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    packages = next(path for path in sys.path if path.endswith("site-packages"))
    place = {"tsplat": PACKAGE_FOLDER, "python": str(Path(os.__file__).parent), "packages": packages}[kind]
    monkeypatch.chdir(place)
    monkeypatch.setattr(sys, "path", [place])
    assert place in safe_path()


def test_a_current_folder_that_was_removed_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "gone").mkdir()
    code = f"import os; os.chdir({str(tmp_path / 'gone')!r}); os.rmdir(os.getcwd()); {SCRIPT}"
    done = tsplat("-P", "-c", code, "--version")
    assert (done.returncode, done.stderr) == (0, "")


def test_the_package_imports_nothing_before_it_is_asked_for() -> None:
    code = "import sys; before = set(sys.modules); import tsplat; print(sorted(set(sys.modules) - before))"
    assert tsplat("-c", code).stdout.strip() == "['tsplat']"
    code = "import tsplat; print([hasattr(tsplat, name) for name in (*tsplat.__all__, 'none')], dir(tsplat))"
    said = tsplat("-c", code).stdout
    assert said.startswith(f"{[True] * 7 + [False]}")
    assert "'render'" in said
