"""The document for people: facts, a small chart of each distribution, and what looks wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.box import ROUNDED
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from tsplat.errors import printable
from tsplat.info.bars import bars

Document = Mapping[str, Any]

NAMES = {
    "opacity": "opacity",
    "longest_sigma": "longest sigma",
    "flatness": "flatness",
    "distance": "distance",
    "view_dependence": "view dependence",
}
NAME_WIDTH = max(len(word) for name in NAMES.values() for word in name.split())
SHOWN_PERCENTILES = "1", "50", "99"

FRAMED_FROM = 66
"""Columns of the output from which on the table has a frame, and numbers of three digits."""

CHART_WIDTHS = ((76, 24), (50, 12), (0, 6))
"""Columns of the output from which on a chart gets that many."""

AXES = {"l": "left", "r": "right", "u": "up", "d": "down", "f": "front", "b": "back"}
FRAME_SOURCES = {
    "option": "by --spz-frame",
    "record": "its own record says so",
    "format": "as specified, it says nothing itself",
}

LEGEND = (
    "Drawn: opacity from 0 to 1; sigma (world units) and flatness (shortest / longest) from p1 to p99 in equal "
    "ratios; distance (bulk radii) and view dependence (of colours) from 0 to p99; what lies beyond, at the ends."
)


def report(document: Document, width: int, *, blocks: bool) -> RenderableType:
    """Return all of a document.

    Parameters
    ----------
    document : mapping
        From `tsplat.info.document.document`.
    width : int
        Columns of the output.
    blocks : bool
        Whether it can show block characters.
    """
    parts: list[RenderableType] = [_facts(document), ""]
    if document["distributions"]:
        parts += [_charts(document["distributions"], width, blocks), Text(LEGEND, "dim"), ""]
    return Group(*parts, _warnings(document["warnings"]))


def _facts(document: Document) -> Table:
    bulk = document["bulk"]
    rows = {
        "scene": printable(document["scene"]),
        "format": document["format"],
        "on disk": _on_disk(document),
        "splats": f"{document['splats']:,}",
        "SH degree": str(document["sh_degree"]),
        "antialiased": "yes, drawn with --antialias mip" if document["antialiased"] else "no",
        **({"axes": _axes(document["frame"])} if document["frame"] else {}),
        "memory": _megabytes(document["memory_bytes"]),
    }
    if document["origin"]:
        rows["origin"] = f"({', '.join(map(repr, document['origin']))}), taken off all coordinates here"
    if document["box"]:
        rows["box"] = _corners(document["box"])
        rows["bulk"] = _corners(bulk)
        rows["bulk radius"] = f"{bulk['radius']:.4g} about {_point(bulk['center'])}"
        rows["up"] = document["up"]["text"]
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in rows.items():
        table.add_row(name, Text(value))
    return table


def _axes(frame: Mapping[str, Any]) -> str:
    said = FRAME_SOURCES[frame["source"]]
    return f"{frame['name']}: {', '.join(AXES[letter] for letter in frame['name'])}; {said}"


def _on_disk(document: Document) -> str:
    files, each = document["files"], document["disk_bytes_per_splat"]
    several = f" in {files:,} files" if files > 1 else ""
    per_splat = f", {each:.4g} bytes a splat" if each is not None else ""
    return f"{_megabytes(document['disk_bytes'])}{several}{per_splat}"


def _megabytes(nbytes: int) -> str:
    return f"{nbytes / 1e6:,.1f} MB" if nbytes >= 100_000 else f"{nbytes:,} bytes"


def _corners(box: Mapping[str, Any]) -> str:
    return f"{_point(box['low'])} to {_point(box['high'])}"


def _point(numbers: Sequence[float]) -> str:
    return f"({', '.join(f'{number + 0.0:.4g}' for number in numbers)})"


def _charts(distributions: Mapping[str, Any], width: int, blocks: bool) -> Table:
    chart_width = next(chart for enough, chart in CHART_WIDTHS if width >= enough)
    narrow = width < FRAMED_FROM
    table = Table(header_style="cyan", border_style="dim", box=None if narrow else ROUNDED, pad_edge=not narrow,
                  collapse_padding=narrow)  # fmt: skip
    table.add_column(
        "", overflow="fold", min_width=max(len(word) for name in NAMES.values() for word in name.split())
    )
    table.add_column("", style="green", no_wrap=True, min_width=chart_width)
    for percent in SHOWN_PERCENTILES:
        table.add_column(f"p{percent}", justify="right", overflow="fold")
    for name, spread in distributions.items():
        chart = bars(spread["histogram"]["counts"], chart_width, blocks=blocks)
        numbers = (f"{spread['percentiles'][percent]:.{2 if narrow else 3}g}" for percent in SHOWN_PERCENTILES)
        table.add_row(NAMES[name], Text(chart), *numbers)
    return table


def _warnings(warnings: Sequence[Mapping[str, Any]]) -> RenderableType:
    if not warnings:
        return Text("no warnings")
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="bold yellow", no_wrap=True)
    table.add_column(overflow="fold")
    for warning in warnings:
        text = Text.assemble((printable(warning["text"]), "yellow"), "\n", printable(warning["remedy"]))
        table.add_row("!", text)
    return Group(Text("warnings", "bold"), table)
