"""`tsplat bench`: its arguments; everything else is imported when it runs."""

from __future__ import annotations

import math
import re
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import rich_click as click

from tsplat.arguments import DEMO, Whole, scene_name
from tsplat.options import load_scene, shared

if TYPE_CHECKING:
    from tsplat.bench.results import Ceilings, SceneResult

SIZES = (240, 160), (1280, 720)
"""A text terminal's picture, and a screen's."""

FRAMES = 9
WIDTH = 120
"""Columns of what is not written to a terminal."""

REDRAW_SECONDS = 0.1


class Size(click.ParamType):  # type: ignore[type-arg]
    """Width and height in pixels with an x between them."""

    name = "size"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return a tuple of two ints."""
        if isinstance(value, tuple):
            return value
        sides = re.fullmatch(r"([0-9]{1,5})x([0-9]{1,5})", value)
        if not sides or not all(1 <= int(side) <= 16384 for side in sides.groups()):
            self.fail(f"{value!r} is not a size WxH, each side 1 to 16384 pixels", param, ctx)
        return int(sides[1]), int(sides[2])


class ThreadCounts(click.ParamType):  # type: ignore[type-arg]
    """Numbers of threads with commas between them."""

    name = "threads"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return a tuple of ints without repeats, in the order given."""
        if isinstance(value, tuple):
            return value
        words = value.split(",")
        if not all(re.fullmatch(r"[0-9]{1,4}", word) and 1 <= int(word) <= 1024 for word in words):
            self.fail(f"{value!r} is not a list of thread counts like 1,2,4, each 1 to 1024", param, ctx)
        return tuple(dict.fromkeys(map(int, words)))


class Sizes(click.RichCommand):
    """A command whose ``--size`` takes several sizes in a row."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Turn ``--size 8x8 9x9`` into ``--size=8x8 --size=9x9``, then parse as usual."""
        spread: list[str] = []
        while args:
            word, *args = args
            if word == "--size" and args:
                word, args = f"--size={args[0]}", args[1:]
            elif spread and spread[-1].startswith("--size=") and re.fullmatch(r"[0-9]+x[0-9]+", word):
                word = f"--size={word}"
            spread.append(word)
        return super().parse_args(ctx, spread)


@click.command("bench", cls=Sizes)
@click.argument("scene", nargs=-1)
@click.option("--size", "sizes", type=Size(), multiple=True, metavar="WxH ...", default=SIZES,
              help="Sizes of the picture in pixels. [240x160 1280x720]")  # fmt: skip
@click.option("--threads", "thread_counts", type=ThreadCounts(), metavar="1,2,4",
              help="Numbers of threads to compare. [one, and all]")  # fmt: skip
@click.option("--frames", type=Whole(1, 100_000), default=FRAMES, show_default=True, metavar="N",
              help="Frames to time of each view, after the first two.")  # fmt: skip
@shared("spz-frame", "lod", "format")
@click.option("--json", "as_json", is_flag=True, help="As JSON, for programs.")
def bench(scene: tuple[str, ...], sizes: Sequence[tuple[int, int]], thread_counts: tuple[int, ...] | None,
          frames: int, as_json: bool, **how: Any) -> None:  # fmt: skip
    """Time each stage of drawing SCENE, or the demo, from around and inside, against what this machine can do."""
    from tsplat.bench.measure import measure_all
    from tsplat.processors import available_processors
    from tsplat.progress import wait_for_kernels
    from tsplat.warmup import WarmUp

    names = scene or (DEMO,)
    # All are loaded before any is timed, so that a bad file does not cost the minutes before it.
    scenes = [(scene_name(name), load_scene(name, how)) for name in names]
    counts = thread_counts or tuple(dict.fromkeys((1, available_processors())))
    wait_for_kernels(WarmUp())
    with _progress() as show:
        results, ceilings = measure_all(scenes, sizes, counts, frames, show)
    (_print_json if as_json else _print_tables)(results, ceilings)


def _print_json(results: Sequence[SceneResult], ceilings: Ceilings) -> None:
    import json

    from tsplat.bench.document import document
    from tsplat.bench.machine import machine

    print(json.dumps(document(results, ceilings, machine()), indent=2), flush=True)


def _print_tables(results: Sequence[SceneResult], ceilings: Ceilings) -> None:
    from rich.console import Console

    from tsplat.bench.machine import machine
    from tsplat.bench.report import footing, heading, tables

    console = Console(highlight=False, width=None if sys.stdout.isatty() else WIDTH)
    console.print(heading(machine()))
    for result in results:
        console.print(tables(result, ceilings))
    console.print(footing(ceilings))
    sys.stdout.flush()


@contextmanager
def _progress() -> Iterator[Callable[[str, float], None]]:
    """Give a callback that shows a bar on stderr, where that is a terminal."""
    if not sys.stderr.isatty():
        yield lambda *_: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    # The bar is drawn between frames, never by a thread of its own, which would be timed along with them.
    columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True, auto_refresh=False) as bar:
        task, drawn = bar.add_task("", total=1.0), -math.inf

        def show(doing: str, fraction: float) -> None:
            nonlocal drawn
            changed = bar.tasks[0].description != doing
            bar.update(task, description=doing, completed=fraction)
            if changed or time.perf_counter() - drawn > REDRAW_SECONDS:
                drawn = time.perf_counter()
                bar.refresh()

        yield show
