"""What the command line says on stderr while it loads and compiles: only when it takes long, then gone."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from tsplat.errors import printable
from tsplat.traffic import Traffic
from tsplat.warmup import WarmUp

if TYPE_CHECKING:
    from rich.progress import Progress

BAR_AFTER = 1.0
"""Seconds of loading or drawing before a progress bar appears."""

WARM_UP_AFTER = 0.2
"""Seconds of loading before the kernels are made ready beside it: two threads that both want the interpreter
lock are slower than one after the other, so a small scene is loaded first."""

NOTICE_AFTER = 0.7
"""Seconds of compiling before a word is said about it."""

REDRAW_SECONDS = 0.1
ERASE_LINE = "\r\x1b[K"


@contextmanager
def loading(name: str, warm_up: WarmUp | None = None, *, doing: str = "loading") -> Iterator[Bar]:
    """Give what shows a bar on a terminal, and starts ``warm_up``, when loading takes long enough.

    ``doing`` says what else than loading takes long.
    """
    bar = Bar(name, warm_up, doing)
    try:
        yield bar
    finally:
        bar.end()


class Bar:
    """A line on stderr that says how far something is, and what comes over the network for it.

    Parameters
    ----------
    name : str
        What it is about.
    warm_up : WarmUp, optional
        Started after a while.
    doing : str
        What is done to it.
    """

    def __init__(self, name: str, warm_up: WarmUp | None, doing: str) -> None:
        self._name, self._warm_up, self._doing = printable(name), warm_up, doing
        self._start, self._terminal = time.perf_counter(), sys.stderr.isatty()
        self._fraction: float | None = 0.0
        self._traffic: Traffic | None = None
        self._heard_bytes = False
        self._shown: Progress | None = None
        self._over = False

    def __call__(self, fraction: float) -> None:
        """Show the fraction done."""
        if not self._heard_bytes:
            self._traffic = None  # none came since the last fraction, so they are read now
        self._fraction, self._heard_bytes = fraction, False
        self._show()

    def fetched(self, done: int, size: int | None) -> None:
        """Show how many bytes have come, and how fast they come."""
        if self._traffic is None:
            self._traffic = Traffic()
        self._traffic.add(done, size)
        self._heard_bytes = True
        self._fraction = self._fraction or None  # until the first fraction nobody knows
        self._show()

    def end(self) -> None:
        """Take the line away; what comes after that is not shown."""
        self._over = True
        if self._shown:
            self._shown.stop()

    def _show(self) -> None:
        seconds = time.perf_counter() - self._start
        if self._warm_up and seconds > WARM_UP_AFTER:
            self._warm_up.start()
        if not self._terminal or seconds < BAR_AFTER or self._over:
            return
        self._shown = self._shown or _on_screen()
        self._shown.tasks[0].total = None if self._fraction is None else 1.0
        self._shown.update(
            self._shown.task_ids[0],
            description=f"{'fetching' if self._traffic else self._doing} {self._name}",
            completed=self._fraction or 0.0,
            traffic=self._traffic or "",
        )


def _on_screen() -> Progress:
    """Return a bar that is drawn from now on; what it says of the traffic is as of when it is drawn."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[traffic]}", markup=False),
        TimeRemainingColumn(),
    )
    bar = Progress(*columns, console=Console(stderr=True), transient=True)
    bar.add_task("", total=1.0, traffic="")
    bar.start()
    return bar


def wait_for_kernels(warm_up: WarmUp) -> None:
    """Wait for the kernels; while they are compiled, say how far that is on a line that goes away again.

    Where stderr is no terminal the line is written once and stays.
    """
    terminal, shown = sys.stderr.isatty(), False
    warm_up.start()
    try:
        while not warm_up.done(REDRAW_SECONDS):
            if warm_up.compiling > NOTICE_AFTER and (terminal or not shown):
                shown = True
                line = (
                    f"{ERASE_LINE}{warm_up.notice()}"
                    if terminal
                    else "tsplat: compiling kernels, first run only\n"
                )
                print(line, end="", file=sys.stderr, flush=True)
    finally:
        if shown and terminal:
            print(ERASE_LINE, end="", file=sys.stderr, flush=True)
