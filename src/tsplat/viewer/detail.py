"""Fewer, merged splats while the view moves: built beside the first frames, used once they are ready."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from tsplat.camera import Camera
from tsplat.rendering import Rendering, RenderOptions
from tsplat.scene import Gaussians

if TYPE_CHECKING:
    from tsplat.lod import Cut


class Detail:
    """The levels of detail of one scene, for one viewer.

    Parameters
    ----------
    gaussians : Gaussians
        The scene.
    budget : int, optional
        How many splats a frame gets while the view moves; by default some for each pixel, 0 for all.
    """

    def __init__(self, gaussians: Gaussians, budget: int | None = None) -> None:
        self.gaussians, self._budget = gaussians, budget
        self._cut: Cut | None = None
        self._first: Camera
        self.done = 0.0
        """How far building is, 0 to 1."""
        # A daemon, so that quitting does not wait.
        self._thread = threading.Thread(target=self._build, name="tsplat-detail", daemon=True)

    def budget(self, camera: Camera) -> int:
        """Return how many splats a frame of this size gets."""
        from tsplat.lod import default_budget

        return default_budget(camera) if self._budget is None else self._budget or len(self.gaussians)

    def helps(self, gaussians: Gaussians, camera: Camera) -> bool:
        """Tell whether a frame would be drawn with fewer splats; start building where that is not known yet."""
        if gaussians is not self.gaussians or len(gaussians) <= self.budget(camera):
            return False
        if self._thread.ident is None:
            self._first = camera
            self._thread.start()
        return self._cut is not None

    def status(self, exact: bool) -> str:
        """Return what is said of the splats of a frame that was drawn, exactly or not."""
        if self._cut is None and self._thread.ident is not None:
            return f"building levels {100.0 * self.done:.0f} %"
        return "" if exact else "merged"

    def draw(self, camera: Camera, options: RenderOptions) -> Rendering:
        """Draw within the budget, as `helps` said it would help."""
        from tsplat.lod import rasterize_within

        return rasterize_within(self.gaussians, camera, options, self.budget(camera), self._cut)

    def _build(self) -> None:
        from tsplat.lod import Cut, hierarchy

        # One thread: those of the frames are not waited for, nor kept waiting.
        cut = Cut(hierarchy(self.gaussians, 1, self._progress))
        cut.blocks(self._first, RenderOptions(), 1)  # no frame should wait for the kernel
        self._cut = cut

    def _progress(self, fraction: float) -> None:
        self.done = fraction
