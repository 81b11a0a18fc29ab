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
    """Turns frames into bytes for one kind of terminal; may remember what it has left on screen.

    Attributes
    ----------
    fidelity : float
        From 0 to 1, to be set at any time. At 1, as it is at first, the next frame is sent exactly; below, it may
        differ a little from what was asked for, and more the lower it is, so that it takes fewer bytes.
    divisible : bool
        Whether the bytes of a frame may be sent with pauses and questions between their escape sequences; else a
        frame is one such sequence.
    """

    fidelity: float
    divisible: bool

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
            Only what differs from what is on screen, where the encoder knows it; nothing where nothing does.

        Raises
        ------
        OptionError
            The frame is not uint8 [H, W, 3] or empty, or there are no cells.
        """

    def forget(self, cells: npt.NDArray[np.bool_] | None) -> None:
        """Take it that something else is on screen now: these cells are sent with the next frame, changed or not.

        Whoever writes over the picture says so here when that is to go. An encoder that sends all of
        every frame, or whose pictures lie under the text, has nothing to do.

        Parameters
        ----------
        cells : ndarray of bool, [rows, columns], or None
            True where the picture is gone; None, or cells of another size than the last frame's, for all of it.
        """

    def abandon(self) -> bytes:
        """Return what ends a frame that was sent in part, and note that the one before it is still on screen."""

    def clear(self) -> bytes:
        """Return what removes the pictures left on screen; text is left to whoever draws next.

        The encoder forgets everything.
        """
