"""Scenes read by kernels and by NumPy: the same values, and each kernel compiled for one set of types."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.io.honest_files import HONEST, written
from tsplat import decode, io
from tsplat._jit import JIT
from tsplat.decode import kernels
from tsplat.scene import Gaussians

PACKED = [name for name in HONEST if "SPZ" in name or name.startswith("compressed")]


def load(path: Path, monkeypatch: pytest.MonkeyPatch, *, compiled: bool) -> Gaussians:
    if compiled:
        decode.make_ready()
    else:
        monkeypatch.setattr(type(kernels.scale), "ready", lambda *_: False)
    assert (decode.decoders().scale is kernels.scale) == (compiled and JIT)
    return io.load(path)


@pytest.mark.parametrize("name", PACKED)
def test_a_scene_is_the_same_by_kernels_and_by_numpy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    path = written(tmp_path, HONEST[name])
    found, wanted = (load(path, monkeypatch, compiled=compiled) for compiled in (True, False))
    for one, other in zip(found.arrays, wanted.arrays, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.skipif(not JIT, reason="nothing is compiled")
@pytest.mark.parametrize("name", PACKED)
def test_reading_compiles_nothing_that_was_not_made_ready(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    decode.make_ready()
    ready = [set(kernel.codes) for kernel, _ in kernels.calls()]
    load(written(tmp_path, HONEST[name]), monkeypatch, compiled=True)
    assert [set(kernel.codes) for kernel, _ in kernels.calls()] == ready
