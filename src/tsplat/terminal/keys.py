"""What comes from the terminal, as plain values: keys, mouse, resizing, focus, and answers to frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

KeyAction = Literal["press", "repeat", "release"]
MouseAction = Literal["press", "release", "drag", "move", "wheel"]
MouseButton = Literal["left", "middle", "right", "none"]


@dataclass(frozen=True, slots=True)
class TerminalSize:
    """Size of the terminal.

    Attributes
    ----------
    columns, rows : int
        Text cells, at least 1.
    cell_width, cell_height : int
        Pixels of one text cell, both 0 where the terminal does not say.
    """

    columns: int
    rows: int
    cell_width: int = 0
    cell_height: int = 0

    @property
    def cell_size(self) -> tuple[int, int]:
        """Width and height of one text cell in pixels, (0, 0) where not known."""
        return self.cell_width, self.cell_height


@dataclass(frozen=True, slots=True)
class Key:
    """A key went down, repeats, or came up.

    Attributes
    ----------
    name : str
        The character typed ("a", "A", "+", "?"), or "space", "tab", "enter", "escape", "backspace",
        "up", "down", "left", "right", "home", "end", "pageup", "pagedown", "insert", "delete",
        "f1" to "f12". Modifiers come first: "ctrl+c", "alt+x", "shift+left", "ctrl+alt+shift+up";
        shift and a letter is the capital letter.
    action : {"press", "repeat", "release"}
        Only terminals with the kitty keyboard (`Profile.kitty_keyboard`) report repeats and releases;
        elsewhere a held key is a row of presses. A key repeats and comes up under the name it went
        down with, whatever became of the modifiers in between.
    """

    name: str
    action: KeyAction = "press"


@dataclass(frozen=True, slots=True)
class Mouse:
    """The mouse did something.

    Attributes
    ----------
    action : {"press", "release", "drag", "move", "wheel"}
        ``drag`` is motion with a button held.
    button : {"left", "middle", "right", "none"}
    x, y : float
        Text cells from the left and top edge of the screen, 0 is the first cell; whole numbers unless
        the terminal reports pixels.
    wheel : int
        1 away from the person (up), -1 towards (down), 0 when it is not the wheel.
    shift : bool
        Shift was held; most terminals keep shift+mouse for selecting text.
    """

    action: MouseAction
    button: MouseButton
    x: float
    y: float
    wheel: int = 0
    shift: bool = False


@dataclass(frozen=True, slots=True)
class Resize:
    """The terminal has a new size, or was just resumed: draw everything again."""

    size: TerminalSize


@dataclass(frozen=True, slots=True)
class Focus:
    """The terminal's window gained or lost the keyboard; keys held at the loss report no release."""

    gained: bool


@dataclass(frozen=True, slots=True)
class Answered:
    """The terminal has come to a `Session.question`: all that was written before it is on screen."""


Event = Key | Mouse | Resize | Focus | Answered
