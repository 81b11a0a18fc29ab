"""Kitty graphics."""

from __future__ import annotations

from tsplat.encode.protocol import FALLBACK_CELL, U8, EncodedFrame


class Kitty:
    """Encode frames as pictures of the kitty graphics protocol."""

    name = "kitty"

    def pixels_per_cell(self, cell_width: int, cell_height: int) -> tuple[int, int]:
        """Return the size of the cell."""
        return (cell_width, cell_height) if cell_width and cell_height else FALLBACK_CELL

    def encode(self, frame: U8, columns: int, rows: int, cell_size: tuple[int, int]) -> EncodedFrame:
        """Draw a frame over text cells; see `Encoder.encode`."""
        raise NotImplementedError

    def clear(self) -> bytes:
        """Return what removes the pictures."""
        raise NotImplementedError
