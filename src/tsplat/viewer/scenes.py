"""The scene as the viewer's settings want it: fewer splats, or opacities taken another way."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

from tsplat.importance import importance, most_important
from tsplat.scene import Gaussians

if TYPE_CHECKING:
    from tsplat.lod import Stored

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
        self._key = (len(gaussians), raw_opacity)
        self._variant = gaussians
        self._scores: F32 | None = None

    def variant(self, kept: int, raw_opacity: bool) -> Gaussians:
        """Return the ``kept`` most important splats in the order of the file, with opacities as asked."""
        key = (min(kept, len(self.loaded)), raw_opacity)
        if key != self._key:
            self._variant, self._key = self._derive(*key), key
        return self._variant

    def _derive(self, kept: int, raw_opacity: bool) -> Gaussians:
        gaussians = self.loaded
        if kept < len(gaussians):
            if self._scores is None:
                self._scores = importance(gaussians.scales, gaussians.opacities)
            gaussians = gaussians.take(np.flatnonzero(most_important(self._scores, kept)))
        if raw_opacity != self.loaded_raw:
            swap = unactivated if raw_opacity else activated
            gaussians = replace(gaussians, opacities=swap(gaussians.opacities))
        return gaussians


class OnDisk:
    """A scene that is drawn as its file has it, whatever the settings are.

    Parameters
    ----------
    stored : Stored
        The scene.
    """

    def __init__(self, stored: Stored) -> None:
        self.loaded = stored

    def variant(self, kept: int, raw_opacity: bool) -> Stored:  # noqa: ARG002
        """Return all of it."""
        return self.loaded


Scenes: TypeAlias = SceneVariants | OnDisk


def scenes_of(scene: Gaussians | Stored, *, raw_opacity: bool = False) -> Scenes:
    """Return the variants of a scene, of which one on disk has no other."""
    return SceneVariants(scene, raw_opacity=raw_opacity) if isinstance(scene, Gaussians) else OnDisk(scene)


def unactivated(opacities: F32) -> F32:
    """Return the numbers whose sigmoid these opacities are, clamped to [0, 1]."""
    inside = np.clip(opacities, 1e-7, 1.0 - 1e-7, dtype=np.float64)
    raw: F32 = np.clip(np.log(inside / (1.0 - inside)), 0.0, 1.0).astype(np.float32)
    return raw


def activated(opacities: F32) -> F32:
    """Return the sigmoid of these numbers."""
    sigmoid: F32 = (1.0 / (1.0 + np.exp(-opacities.astype(np.float64)))).astype(np.float32)
    return sigmoid
