"""Fewer, coarser splats while the view moves: built or read beside the first frames, used once they are ready."""

from __future__ import annotations

import threading
from contextlib import suppress
from typing import TYPE_CHECKING

from tsplat.camera import Camera
from tsplat.drawing import draw_all
from tsplat.errors import CorruptFileError, TsplatError
from tsplat.rendering import Rendering, RenderOptions
from tsplat.scene import Gaussians

if TYPE_CHECKING:
    from tsplat.lod import Cut, Hierarchy, Stored


class Detail:
    """The levels of detail of one scene, for one viewer.

    Parameters
    ----------
    scene : Gaussians or Stored
        The scene; the levels of one on disk are there from the start, those of a streamed one the coarsest first.
    budget : int, optional
        How many splats a frame gets while the view moves; by default some for each pixel, 0 for all.
    """

    def __init__(self, scene: Gaussians | Stored, budget: int | None = None) -> None:
        self.scene, self._budget = scene, budget
        self._cut = None if isinstance(scene, Gaussians) else _new_cut(scene.tree)
        self._first: Camera
        self.done = 0.0
        """How far building or reading is, 0 to 1."""
        self._problem = ""
        # A daemon, so that quitting does not wait.
        self._thread = threading.Thread(target=self._work, name="tsplat-detail", daemon=True)

    def warm_up(self, camera: Camera) -> None:
        """Make the kernels ready that choose what to draw, where the first frame is going to need them."""
        if self._cut:
            with suppress(CorruptFileError):  # the first frame says so
                self._cut.blocks(camera, RenderOptions(), 1)

    def of(self, scene: Gaussians | Stored) -> Detail:
        """Return the levels of detail of another scene, for the same viewer."""
        return Detail(scene, self._budget)

    @property
    def complete(self) -> bool:
        """Whether all splats are there to be drawn."""
        return isinstance(self.scene, Gaussians) or self.scene.complete

    @property
    def reading(self) -> bool:
        """Whether there is more of the scene to come."""
        return not self.complete and not self._problem

    def budget(self, camera: Camera) -> int:
        """Return how many splats a frame of this size gets."""
        from tsplat.lod import default_budget

        return default_budget(camera) if self._budget is None else self._budget or len(self.scene)

    def helps(self, scene: Gaussians | Stored, camera: Camera) -> bool:
        """Tell whether a frame would be drawn with fewer splats; start building where that is not known yet."""
        if scene is not self.scene or (self.complete and len(scene) <= self.budget(camera)):
            return False
        if (self._cut is None or not self.complete) and self._thread.ident is None:
            self._first = camera
            self._thread.start()
        return self._cut is not None

    def status(self, exact: bool) -> str:
        """Return what is said of the splats of a frame that was drawn, exactly or not."""
        if not self.complete:
            return self._problem or f"reading levels {100.0 * self.done:.0f} %"
        if self._cut is None and self._thread.is_alive():
            return f"building levels {100.0 * self.done:.0f} %"
        return "" if exact else "merged"

    def draw(self, camera: Camera, options: RenderOptions) -> Rendering:
        """Draw within the budget, as `helps` said it would help.

        Raises
        ------
        CorruptFileError
            The scene is on disk, and its file changed.
        """
        from tsplat.lod import rasterize_within

        try:
            return rasterize_within(self.scene, camera, options, self.budget(camera), self._cut)
        except CorruptFileError:
            if not isinstance(self.scene, Gaussians):
                raise
            self._cut = None  # an earlier run kept these levels, and somebody changed their file
            return draw_all(self.scene, camera, options)

    def _work(self) -> None:
        if isinstance(self.scene, Gaussians):
            self._build(self.scene)
        else:
            self._read(self.scene)

    def _read(self, scene: Stored) -> None:
        try:
            scene.read_rest(self._progress)
        except TsplatError as error:
            self._problem = str(error)

    def _build(self, scene: Gaussians) -> None:
        from tsplat.lod import hierarchy
        from tsplat.lod.remembered import keep, recall

        earlier = recall(scene)
        # One thread: those of the frames are not waited for, nor kept waiting.
        tree = hierarchy(scene, 1, self._progress, earlier)
        cut = _new_cut(tree)
        with suppress(CorruptFileError):  # as `draw` says
            cut.blocks(self._first, RenderOptions(), 1)  # no frame should wait for the kernel
            self._cut = cut
        if earlier is None:
            keep(scene, tree)

    def _progress(self, fraction: float) -> None:
        self.done = fraction


def _new_cut(tree: Hierarchy) -> Cut:
    from tsplat.lod import Cut

    return Cut(tree)
