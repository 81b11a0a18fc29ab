"""The views that a session begins with: the first one, and the same with something else up."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from tsplat.camera import Vector
from tsplat.first_view import FirstView, best_side, first_view, where_to_stand
from tsplat.framing import UPS, Up, axis_name
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians
from tsplat.viewer.picture import screen_pixels
from tsplat.viewer.state import ViewerState

if TYPE_CHECKING:
    from tsplat.lod import Stored

GREETING = "? keys   Tab settings   q quit"
GUESSED = "? keys   q quit   up is a guess: U turns it, --up says it"
TURNED = "? keys   q quit   upside down for an SPZ: --spz-frame rdf, or U"


class Starts:
    """Start views of one scene, for one viewer.

    Parameters
    ----------
    scene : Gaussians or Stored
        The scene.
    options : RenderOptions
        How it is drawn at first.
    aspect : float
        Width over height of the screen.
    fov_y : float
        Vertical field of view in degrees.
    up : tuple of 3 floats, optional
        What the person said is up.
    spz : bool
        As in `tsplat.framing.guess_up`.
    """

    def __init__(
        self,
        scene: Gaussians | Stored,
        options: RenderOptions,
        *,
        aspect: float,
        fov_y: float,
        up: Vector | None = None,
        spz: bool = False,
    ) -> None:
        self._scene, self._options = scene, options
        self.first = where_to_stand(scene, options, aspect=aspect, fov_y=fov_y, up=up, spz=spz)

    def settled(self, state: ViewerState) -> ViewerState:
        """Return the state at that side of the scene which shows most: the kernels are ready."""
        self.first = best_side(self._scene, self._options, self.first, aspect=_aspect(state), fov_y=state.fov_y)
        stands = state.pose == state.start
        return _begun(state, self.first) if stands else replace(_begun(state, self.first), pose=state.pose)

    def turned(self, state: ViewerState) -> ViewerState:
        """Return the state at the start view with the next direction up."""
        up = next_up(state.start.up)
        view = first_view(
            self._scene, replace(self._options, train_views=None), aspect=_aspect(state), fov_y=state.fov_y, up=up
        )
        return replace(_begun(state, view), message=f"up is {axis_name(up)}: --up {axis_name(up)} begins so")


def next_up(up: Vector) -> Vector:
    """Return the direction that is tried after this one: any of the six, nearest axis and all."""
    nearest = max(range(len(UPS)), key=lambda place: sum(a * b for a, b in zip(UPS[place], up, strict=True)))
    return UPS[(nearest + 1) % len(UPS)]


def greeting(up: Up) -> str:
    """Return what the first picture says below: the keys, and what was guessed."""
    if up.spz_frame:
        return TURNED
    return GUESSED if up.sureness == "weak" else GREETING


def _begun(state: ViewerState, view: FirstView) -> ViewerState:
    pose = view.pose
    return replace(state, pose=pose, start=pose, radius=0.5 * pose.distance, held=(), auto_orbit=False)


def _aspect(state: ViewerState) -> float:
    width, height = screen_pixels(state.size, state.output)
    return width / height
