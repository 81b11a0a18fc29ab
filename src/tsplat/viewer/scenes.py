"""The scene as the viewer's settings want it: fewer splats, or opacities taken another way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from tsplat.scene import Gaussians

F32 = npt.NDArray[np.float32]


class SceneVariants:
    """One loaded scene and the variant of it that was drawn last.

    Parameters
    ----------
    gaussians : Gaussians
        The scene as loaded.
    raw_opacity : bool
        Whether its opacities are the file's own numbers, not their sigmoid.
    """

    def __init__(self, gaussians: Gaussians, *, raw_opacity: bool = False) -> None:
        self.loaded, self.loaded_raw = gaussians, raw_opacity
        self._weightiest_first: npt.NDArray[np.intp] | None = None
        self._key = (len(gaussians), raw_opacity)
        self._variant = gaussians

    def variant(self, kept: int, raw_opacity: bool) -> Gaussians:
        """Return the ``kept`` weightiest splats in the order of the file, with opacities as asked."""
        key = (kept, raw_opacity)
        if key != self._key:
            self._variant, self._key = self._derive(kept, raw_opacity), key
        return self._variant

    def _derive(self, kept: int, raw_opacity: bool) -> Gaussians:
        gaussians = self.loaded
        if kept < len(gaussians):
            # In the file's order, so that the renderer's memory access stays as local as the file is.
            gaussians = gaussians.take(np.sort(self._order()[:kept]))
        if raw_opacity != self.loaded_raw:
            swap = unactivated if raw_opacity else activated
            gaussians = replace(gaussians, opacities=swap(gaussians.opacities))
        return gaussians

    def _order(self) -> npt.NDArray[np.intp]:
        if self._weightiest_first is None:
            self._weightiest_first = np.argsort(-weights(self.loaded), kind="stable")
        return self._weightiest_first


def weights(gaussians: Gaussians) -> F32:
    """Return how much each splat matters, float32 [N]: opacity times the area of its largest face."""
    largest = np.sort(gaussians.scales, axis=1)[:, 1:]
    weight: F32 = gaussians.opacities * largest[:, 0] * largest[:, 1]
    return weight


def unactivated(opacities: F32) -> F32:
    """Return the numbers whose sigmoid these opacities are, clamped to [0, 1]."""
    inside = np.clip(opacities, 1e-7, 1.0 - 1e-7, dtype=np.float64)
    return np.clip(np.log(inside / (1.0 - inside)), 0.0, 1.0).astype(np.float32)


def activated(opacities: F32) -> F32:
    """Return the sigmoid of these numbers."""
    return (1.0 / (1.0 + np.exp(-opacities.astype(np.float64)))).astype(np.float32)
