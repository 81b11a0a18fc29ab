"""How large the terminal is, from all who say something about it: the kernel, its answers, and its reports."""

from __future__ import annotations

from collections.abc import Callable

from tsplat.terminal.keys import TerminalSize
from tsplat.terminal.limits import believed_cell, believed_cell_among, believed_cells
from tsplat.terminal.parser import PixelReport, SizeReport
from tsplat.terminal.probe import Profile

_FALLBACK = (80, 24)


class Sizes:
    """The size of a terminal, as the last one to speak has it.

    Parameters
    ----------
    window_size : callable
        Returns columns, rows, width and height as the kernel has them, each 0 where it does not know.
    profile : Profile
        What the terminal said when it was asked.

    Attributes
    ----------
    cell_size : tuple of 2 ints, or None
        Width and height of a text cell in pixels, as the terminal says.
    """

    def __init__(self, window_size: Callable[[], tuple[int, int, int, int]], profile: Profile) -> None:
        self._window_size, self._profile = window_size, profile
        self._reported: tuple[int, int] | None = None
        self.cell_size = profile.cell_size or self._cell_in(*(profile.window_size or (0, 0)))

    def now(self) -> TerminalSize:
        """Return the size now, within what any screen has; 80 x 24 where nobody knows it."""
        columns, rows, width, height = self._window()
        columns, rows = columns or _FALLBACK[0], rows or _FALLBACK[1]
        # The window's pixels may include a border, and are often missing; the terminal's answer is better.
        cell = self.cell_size or _cell(columns, rows, width, height)
        columns, rows = believed_cells(columns, rows)
        return TerminalSize(columns, rows, *(believed_cell_among(columns, rows, cell) or (0, 0)))

    def take(self, report: PixelReport | SizeReport) -> bool:
        """Take a late answer or a new size; return whether the size is another one now."""
        before = self.now()
        if isinstance(report, SizeReport):
            # What came last is right: over SSH, the kernel may learn of it earlier or later.
            self._reported = report.columns, report.rows
            if self._profile.cell_size:
                self.cell_size = self._cell_in(report.width, report.height) or self.cell_size
        elif report.kind == 6:
            self.cell_size = believed_cell(report.width, report.height) or self.cell_size
        elif self._profile.cell_size is None:
            self.cell_size = self._cell_in(report.width, report.height)
        return self.now() != before

    def heed_kernel(self) -> None:
        """Take the kernel's word again: it has just said that the size changed."""
        self._reported = None

    def _window(self) -> tuple[int, int, int, int]:
        columns, rows, width, height = self._window_size()
        if self._reported in (None, (columns, rows)):
            return columns, rows, width, height
        return (*self._reported, 0, 0)

    def _cell_in(self, width: int, height: int) -> tuple[int, int] | None:
        return _cell(*self._window()[:2], width, height)


def _cell(columns: int, rows: int, width: int, height: int) -> tuple[int, int] | None:
    """Return the size of a cell in a window of this size, None where something is not known."""
    return believed_cell(width // columns, height // rows) if min(columns, rows) > 0 else None
