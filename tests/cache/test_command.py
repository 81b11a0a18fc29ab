"""`tsplat cache` says what is kept, and clears it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.scenes import random_gaussians
from tsplat import cli, kept
from tsplat._jit import JIT

pytestmark = pytest.mark.skipif(not JIT, reason="merging takes long without a compiler")


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "folder", lambda: tmp_path / "hierarchies")
    monkeypatch.setenv(kept.SIZE_VARIABLE, "2.5")
    monkeypatch.setenv("COLUMNS", "200")


@pytest.fixture
def scene() -> Path:
    from tsplat.lod import store

    cloud = random_gaussians(np.random.default_rng(0), 1234, 0)
    assert kept.keep("abc", 10**6, lambda file: store(file, cloud, 1, lambda _: None))
    return kept.entries()[0].path


def said(capsys: pytest.CaptureFixture[str], *args: str) -> str:
    assert cli.main(["cache", *args]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    return out


def test_an_empty_one_says_where_it_would_be(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert said(capsys) == f"{tmp_path}/hierarchies: 0.00 GB of at most 2.50 GB\n"


def test_it_lists_what_is_kept(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = said(capsys)
    assert "abc" in out
    assert "1,234" in out
    assert f"{scene.stat().st_size / 1e6:.2f} MB" in out


def test_a_broken_file_is_called_so(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene.write_bytes(b"x")
    assert "broken" in said(capsys)


def test_clearing_says_how_much_that_was(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert said(capsys, "--clear") == "removed 1 file, 0.00 GB\n"
    assert not scene.exists()
    assert said(capsys, "--clear") == "removed 0 files, 0.00 GB\n"


def test_a_bound_that_is_no_number_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(kept.SIZE_VARIABLE, "much")
    assert cli.main(["cache"]) == 2
    assert capsys.readouterr().err == "tsplat: TSPLAT_CACHE_GB must be gigabytes, 0 or more, got 'much'\n"
