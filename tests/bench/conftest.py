"""Ceilings that take no time to measure, and a renderer that draws nothing."""

from __future__ import annotations

import numpy as np
import pytest

from tsplat.bench import measure
from tsplat.camera import Camera
from tsplat.rendering import Rendering, RenderOptions
from tsplat.scene import Gaussians


@pytest.fixture
def ceilings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace what takes seconds to measure."""
    monkeypatch.setattr(measure, "blends_per_second", lambda: 2e9)
    monkeypatch.setattr(measure, "copy_bytes_per_second", lambda: 1e10)
    monkeypatch.setattr(measure, "project_bytes", lambda gaussians, *_: 100 * len(gaussians))


class Drawn(list[tuple[Camera, int]]):
    """A renderer that keeps the camera and the threads of every frame; the n-th takes n ms to `paint`."""

    def rasterize(self, gaussians: Gaussians, camera: Camera, options: RenderOptions) -> Rendering:
        """Draw nothing."""
        self.append((camera, options.threads))
        alphas = np.zeros((camera.height, camera.width), np.float32)
        stage_ms = {"paint": float(len(self)), "composite": 0.5}
        return Rendering(alphas, alphas, None, len(gaussians), 7, 9, stage_ms)


@pytest.fixture
def drawn(ceilings: None, monkeypatch: pytest.MonkeyPatch) -> Drawn:  # noqa: ARG001
    """Replace the renderer."""
    drawn = Drawn()
    monkeypatch.setattr(measure, "rasterize", drawn.rasterize)
    return drawn
