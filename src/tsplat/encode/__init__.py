"""Front door: `encoder(name)` turns frames, uint8 [H, W, 3], into bytes for a terminal.

Knows nothing about Gaussians, cameras or the tty.
"""

from __future__ import annotations

from tsplat.encode.protocol import FALLBACK_CELL, EncodedFrame, Encoder
from tsplat.errors import OptionError

__all__ = ["ENCODERS", "FALLBACK_CELL", "EncodedFrame", "Encoder", "encoder"]

ENCODERS: tuple[str, ...] = ("kitty", "sixel", "half", "half256")
"""Names of the encoders, best picture first."""


def encoder(name: str) -> Encoder:
    """Return a new encoder.

    Parameters
    ----------
    name : {"kitty", "sixel", "half", "half256"}
        Kitty graphics, sixel graphics, or half blocks in 24-bit or 256 colours.

    Raises
    ------
    OptionError
        There is no encoder of this name.
    """
    if name in ("half", "half256"):
        from tsplat.encode.cells import HalfBlocks

        return HalfBlocks(256 if name == "half256" else 1 << 24)
    if name == "kitty":
        from tsplat.encode.kitty import Kitty  # isal

        return Kitty()
    if name == "sixel":
        from tsplat.encode.sixel import Sixel  # Numba, half a second

        return Sixel()
    raise OptionError(f"output must be one of {', '.join(ENCODERS)}, got {name!r}")
