"""Half blocks: two pixels in each text cell, as foreground and background of the upper half block."""

from __future__ import annotations

from tsplat.encode.protocol import U8, EncodedFrame


class HalfBlocks:
    """Encode frames as upper half blocks in 24-bit or 256 colours."""

    def __init__(self, colors: int = 1 << 24) -> None:
        self.name = "half256" if colors == 256 else "half"

    def pixels_per_cell(self, cell_width: int, cell_height: int) -> tuple[int, int]:  # noqa: ARG002
        """Return 1 across and 2 down, whatever the cell."""
        return 1, 2

    def encode(self, frame: U8, columns: int, rows: int, cell_size: tuple[int, int]) -> EncodedFrame:
        """Draw a frame over text cells; see `Encoder.encode`."""
        raise NotImplementedError

    def lines(self, frame: U8) -> list[bytes]:
        """Return one row of cells after another, for printing: no cursor moves, colours reset at each end.

        Parameters
        ----------
        frame : ndarray of uint8, [H, W, 3]
            Becomes W columns and H / 2 rows, rounded up.
        """
        raise NotImplementedError

    def clear(self) -> bytes:
        """Return nothing: text is overwritten, not removed."""
        return b""
