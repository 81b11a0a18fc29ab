"""What every encoder offers, and what it hands back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

U8 = npt.NDArray[np.uint8]

FALLBACK_CELL = (10, 20)
"""Width and height of a text cell in pixels where the terminal does not say."""


@dataclass(frozen=True, slots=True)
class EncodedFrame:
    """The bytes of one frame, in the order in which they are written.

    Attributes
    ----------
    upload : bytes
        Pictures to store; changes nothing on screen. Write it before synchronized output begins: kitty
        gives up an update that takes too long. Empty for all encoders but kitty.
    draw : bytes
        What changes the screen, with the top left at the cursor's cell. Write it inside synchronized
        output, before any text that should stand above the picture. It leaves the cursor anywhere.
    """

    upload: bytes
    draw: bytes


class Encoder(Protocol):
    """Turns frames into bytes for one kind of terminal; may remember what it has left on screen."""

    @property
    def name(self) -> str:
        """One of `tsplat.encode.ENCODERS`."""

    def pixels_per_cell(self, cell_width: int, cell_height: int) -> tuple[int, int]:
        """Return how many frame pixels, across and down, one text cell shows at density 1.

        Parameters
        ----------
        cell_width, cell_height : int
            Size of a text cell in screen pixels; 0 where it is not known.
        """

    def encode(self, frame: U8, columns: int, rows: int, cell_size: tuple[int, int]) -> EncodedFrame:
        """Draw a frame over ``columns`` x ``rows`` text cells, its top left at the cursor's cell.

        Parameters
        ----------
        frame : ndarray of uint8, [H, W, 3]
            Any size; stretched to fill the cells, by area when it is larger, by nearest when smaller.
        columns, rows : int
            The text cells to cover, at least 1.
        cell_size : tuple of 2 ints
            Width and height of a text cell in screen pixels, (0, 0) where not known; only sixel needs it.

        Returns
        -------
        EncodedFrame

        Raises
        ------
        OptionError
            The frame is not uint8 [H, W, 3] or empty, or there are no cells.
        """

    def clear(self) -> bytes:
        """Return what removes the pictures left on screen; text is left to whoever draws next."""
