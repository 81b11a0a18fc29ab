"""Notices that the file of a scene that is drawn where it lies is no longer what was opened."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tsplat.io.tsplat_map import Mapped

LOOK_SECONDS = 1.0
"""Between looks: each takes microseconds, but on another machine's disk may take far longer."""

CHANGED = "the file changed; Ctrl-R loads it again"


class FileWatch:
    """Looks at the name of a file from time to time.

    Parameters
    ----------
    mapped : Mapped, optional
        The file; without one there is nothing to look at.
    """

    def __init__(self, mapped: Mapped | None) -> None:
        self._mapped, self._next = mapped, 0.0
        self._known = mapped.stamp if mapped else None

    def left(self, now: float) -> float:
        """Return how many seconds nobody needs to look."""
        return max(0.0, self._next - now) if self._mapped else float("inf")

    def changed(self, now: float) -> bool:
        """Look, if it is time; tell of each change once."""
        if self._mapped is None or now < self._next:
            return False
        self._next = now + LOOK_SECONDS
        before, self._known = self._known, self._mapped.stamp_now() or self._known
        return self._known != before
