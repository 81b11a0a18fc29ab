"""What the command line says on stderr while it loads and compiles: only when it takes long, then gone."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tsplat.warmup import WarmUp

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
def loading(
    name: str, warm_up: WarmUp | None = None, *, doing: str = "loading"
) -> Iterator[Callable[[float], None]]:
    """Give a callback that shows a bar on a terminal, and starts ``warm_up``, when loading takes long enough.

    ``doing`` says what else than loading takes long.
    """
    start, bar, terminal = time.perf_counter(), None, sys.stderr.isatty()

    def show(fraction: float) -> None:
        nonlocal bar
        seconds = time.perf_counter() - start
        if warm_up and seconds > WARM_UP_AFTER:
            warm_up.start()
        if terminal and bar is None and seconds > BAR_AFTER:
            from rich.console import Console
            from rich.progress import Progress

            bar = Progress(console=Console(stderr=True), transient=True)
            bar.add_task(f"{doing} {Path(name).name}", total=1.0)
            bar.start()
        if bar is not None:
            bar.update(bar.task_ids[0], completed=fraction)

    try:
        yield show
    finally:
        if bar is not None:
            bar.stop()


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
