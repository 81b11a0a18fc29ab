"""`tsplat convert`: its arguments; everything else is imported when it runs."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rich_click as click

from tsplat.arguments import InOrder, Number, Numbers, Whole
from tsplat.options import READING, reading, shared

WIDTH = 115
"""Columns of what is not written to a terminal."""

SIGMAS = 2.0
"""What `--remove-floaters` says when it is given no number."""

POINT = Numbers("point", 3, "three numbers X,Y,Z")
BOX = Numbers("box", 6, "six numbers X0,Y0,Z0,X1,Y1,Z1")
SPHERE = Numbers("sphere", 4, "four numbers X,Y,Z,R")
FLOATERS = Numbers("sigmas", 1, "a number of standard deviations", otherwise=(SIGMAS,))


class Amount(click.ParamType):  # type: ignore[type-arg]
    """A number of splats, or a percentage of those there are."""

    name = "amount"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the text."""
        known = re.fullmatch(r"([0-9]{1,12})|([0-9]{1,3}(?:\.[0-9]{1,20})?)%", value)
        if not known or not (int(known[1]) >= 1 if known[1] else 0 < float(known[2]) <= 100):
            self.fail(f"{value!r} is neither a number of splats, 1 or more, nor a percentage like 25%", param, ctx)
        return value


EDITS = (
    ("--crop-box", BOX, "X0,Y0,Z0,X1,Y1,Z1", "Keep splats whose centres are between two corners."),
    ("--crop-sphere", SPHERE, "X,Y,Z,R", "Keep splats whose centres are at most R from X,Y,Z."),
    ("--min-opacity", Number(0, 1), "A", "Remove splats of a lower opacity."),
    ("--max-scale", Number(0), "S",
     "Remove splats whose longest standard deviation is more, in world units."),
    ("--remove-floaters", FLOATERS, "[SIGMAS]",
     "Remove splats that are alone: farther from their 16 nearest, for their sizes, than the mean by so many "
     "standard deviations. Fewer remove more. [2]"),
    ("--decimate", Amount(), "N|N%",
     "Merge splats until so many are left, those first whose merging changes least."),
    ("--sh-degree", Whole(0, 4), "D", "Leave out spherical harmonics above this degree."),
    ("--rotate", POINT, "X,Y,Z", "Turn by degrees about the x axis, then about y, then about z."),
    ("--translate", POINT, "X,Y,Z", "Shift, in world units."),
    ("--scale", Number(0, min_open=True), "F", "Scale about the origin."),
)  # fmt: skip
"""Options that are edits: their names, kinds, placeholders and helps."""


def edit_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that are edits to a command."""
    for name, kind, placeholder, text in reversed(EDITS):
        function = click.option(name, type=kind, multiple=True, metavar=placeholder, help=text)(function)
    return function


@click.command("convert", cls=InOrder)
@click.argument("scenes", nargs=-1, required=True, metavar="IN...", help="What to read, or `demo`.")
@click.argument("out", metavar="OUT", help="What to write, by its suffix; it may be one of those that are read.")
@edit_options
@shared(*READING)
@shared("strict")
@click.option("--json", "as_json", is_flag=True, help="Say what was done as JSON, for programs.")
@click.pass_obj
def convert(
    given: list[str], /, scenes: tuple[str, ...], out: str, strict: bool, as_json: bool, **options: Any
) -> None:
    """Write the splats of IN, or of several joined, to OUT in the format of its suffix, replacing a file there.

    Options that change the scene are followed in the order in which they are given, and may be repeated.
    """
    from tsplat.convert import conversion
    from tsplat.convert.edits import Edit, in_order

    how = reading(options)
    edits = in_order(given, options)
    if how["max_splats"] and len(scenes) > 1:  # so many of each are read, and so many of all are kept
        edits.insert(0, Edit("max-splats", how["max_splats"]))
    document = conversion.convert(scenes, Path(out), edits, how, strict=strict)
    if as_json:
        import json

        print(json.dumps(document, indent=2), flush=True)
        return
    from rich.console import Console

    from tsplat.convert.report import report

    console = Console(highlight=False, width=None if sys.stdout.isatty() else WIDTH)
    console.print(report(document))
    sys.stdout.flush()
