"""What the viewer knows: one frozen value, and what of it can be seen.

Nothing here touches a terminal, a clock or a scene; `update` makes the next state from this one and an event.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

from tsplat.camera import Pose
from tsplat.rendering import RenderOptions
from tsplat.terminal.keys import TerminalSize

TAP = 0.12
"""Seconds that one press lasts at least, and at most where the terminal does not report releases."""

AUTO_ORBIT = 24.0
"""Degrees per second: once around in 15 seconds."""

Mode = Literal["orbit", "fly"]
Panel = Literal["", "hud", "help"]


@dataclass(frozen=True, slots=True)
class Tick:
    """Time passed.

    Attributes
    ----------
    seconds : float
        Wall-clock time since the last tick, not negative.
    """

    seconds: float


@dataclass(frozen=True, slots=True)
class Notice:
    """A line of text for the bottom of the screen, until the next key."""

    text: str


@dataclass(frozen=True, slots=True)
class Loaded:
    """The scene was loaded again: how many splats it has now, and their spherical-harmonics degree."""

    splats: int
    sh_degree: int


@dataclass(frozen=True, slots=True)
class Held:
    """A motion whose key is down, or was so briefly that some of its motion is still owed.

    Attributes
    ----------
    motion : str
        A name in `tsplat.viewer.motion.MOTIONS`.
    owed : float
        Seconds it still lasts when the key is up.
    down : bool
        Whether it lasts until the release; always false where no release will be reported.
    """

    motion: str
    owed: float = TAP
    down: bool = False


@dataclass(frozen=True, slots=True)
class Speeds:
    """How fast held keys act.

    Attributes
    ----------
    move : float
        Lengths per second; the length is the target's distance in orbit, the scene's radius in flight.
    turn : float
        Degrees per second.
    zoom : float
        Factor per second, above 1.
    """

    move: float = 0.6
    turn: float = 60.0
    zoom: float = 2.0


@dataclass(frozen=True, slots=True)
class ViewerState:
    """Everything that events change.

    Attributes
    ----------
    pose, start : Pose
        Where the eye is, and where Z takes it back to.
    radius : float
        Half the start view's distance, about the extent of the scene's bulk, in world units;
        flight is measured by it.
    size : TerminalSize
        The screen.
    screens : int
        How many times the screen had to be drawn from nothing: resized or resumed.
    outputs : tuple of str
        What this terminal can show, best first; ``output`` is one of them.
    total, kept : int
        Splats loaded, and how many of them are drawn from, the weightiest first.
    on_disk : bool
        Whether the scene is drawn as its file has it, so that ``kept`` and ``raw_opacity`` are what they are.
    raw_opacity : bool
        Whether the file's opacities are taken as they stand, not through the sigmoid.
    scene_degree : int
        Spherical-harmonics degree the scene holds.
    releases : bool
        Whether the terminal reports that a key went up.
    grabbed : tuple of (float, float, str), or None
        Column, row and button of the drag under way.
    pictures, ups, suspends, reloads : int
        How many times P, U, Ctrl-Z and Ctrl-R were pressed; the loop acts once for each.
    threads : int
        Processors there are.
    density : float
        Rendered pixels for each pixel of the output, along either side.
    row, scroll : int
        The selected row of the HUD, and the first one shown of the keys.
    message : str
        Text at the bottom of the screen.
    """

    pose: Pose
    start: Pose
    radius: float = 1.0
    size: TerminalSize = field(default_factory=lambda: TerminalSize(80, 24))
    options: RenderOptions = field(default_factory=RenderOptions)
    outputs: tuple[str, ...] = ("half",)
    output: str = "half"
    total: int = 0
    kept: int = 0
    on_disk: bool = False
    raw_opacity: bool = False
    scene_degree: int = 3
    threads: int = 1
    fov_y: float = 55.0
    density: float = 1.0
    saturation: float = 1.0
    speeds: Speeds = Speeds()
    mode: Mode = "orbit"
    auto_orbit: bool = False
    held: tuple[Held, ...] = ()
    releases: bool = False
    grabbed: tuple[float, float, str] | None = None
    panel: Panel = ""
    row: int = 0
    scroll: int = 0
    message: str = ""
    screens: int = 0
    pictures: int = 0
    ups: int = 0
    suspends: int = 0
    reloads: int = 0
    running: bool = True

    @property
    def moving(self) -> bool:
        """Whether time alone changes the picture."""
        return self.auto_orbit or bool(self.held)


def picture(state: ViewerState) -> ViewerState:
    """Return the part of the state that the rendered frame depends on; equal parts, equal frames."""
    return replace(
        state,
        start=state.pose,
        speeds=Speeds(),
        mode="orbit",
        auto_orbit=False,
        held=(),
        releases=False,
        grabbed=None,
        panel="",
        row=0,
        scroll=0,
        message="",
        screens=0,
        pictures=0,
        ups=0,
        suspends=0,
        reloads=0,
        running=True,
    )


def overlay(state: ViewerState) -> tuple[object, ...]:
    """Return what the text over the frame depends on, besides the picture."""
    return (
        state.panel,
        state.row,
        state.scroll,
        state.message,
        state.mode,
        state.auto_orbit,
        state.speeds,
        state.screens,
    )
