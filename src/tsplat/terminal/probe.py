"""What this terminal can do: one batch of questions, and a pure function from the answers to a `Profile`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Profile:
    """What a terminal can do.

    Attributes
    ----------
    program, version : str
        What the terminal calls itself, or what the environment says; "" where nothing does.
    colors : int
        16777216 for 24-bit colour, else 256.
    kitty_graphics, sixel : bool
        Pictures it draws.
    synchronized : bool
        Whether an update can be held back until it is complete (mode 2026).
    kitty_keyboard : bool
        Whether keys report repeats and releases.
    pixel_mouse : bool
        Whether the mouse reports pixels (mode 1016).
    cell_size : tuple of 2 ints, or None
        Width and height of a text cell in pixels, from CSI 16t.
    window_size : tuple of 2 ints, or None
        Width and height of the text area in pixels, from CSI 14t.
    replies : mapping of str to str
        The answers by the name of the question, readable; for the HUD.
    """

    program: str = ""
    version: str = ""
    colors: int = 256
    kitty_graphics: bool = False
    sixel: bool = False
    synchronized: bool = False
    kitty_keyboard: bool = False
    pixel_mouse: bool = False
    cell_size: tuple[int, int] | None = None
    window_size: tuple[int, int] | None = None
    replies: Mapping[str, str] = field(default_factory=dict)


def detect(environment: Mapping[str, str], replies: bytes) -> Profile:
    """Return what a terminal can do, from the environment and the bytes it answered."""
    raise NotImplementedError


def outputs(profile: Profile) -> tuple[str, ...]:
    """Return the encoders this terminal can show, best first; never empty."""
    raise NotImplementedError


def choose_output(requested: str | None, environment: Mapping[str, str], profile: Profile) -> str:
    """Return the encoder to use: ``requested``, else TSPLAT_OUTPUT, else the best one.

    Raises
    ------
    OptionError
        ``requested`` or TSPLAT_OUTPUT names no encoder. One that the terminal did not announce is allowed.
    """
    raise NotImplementedError
