"""A conversion for people: one table, from what went in down to what came out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.box import ROUNDED
from rich.table import Table
from rich.text import Text

Document = Mapping[str, Any]


def report(document: Document) -> Table:
    """Return the table of a conversion.

    Parameters
    ----------
    document : mapping
        From `tsplat.convert.conversion.convert`.
    """
    table = Table(box=ROUNDED, header_style="cyan", border_style="dim")
    table.add_column(overflow="fold")
    table.add_column("format")
    for name in ("splats", "removed", "SH", "size"):
        table.add_column(name, justify="right", no_wrap=True)
    for about in document["inputs"]:
        table.add_row(*_scene("in", about), _size(about["bytes"]))
    table.add_section()
    for step in document["edits"]:
        removed = f"{step['removed']:,}" if step["removed"] else ""
        table.add_row(Text(step["edit"]), "", f"{step['splats']:,}", removed, str(step["sh_degree"]), "")
    table.add_section()
    output = document["output"]
    table.add_row(*_scene("out", output), _size(output["bytes"]) + _share(document), style="bold")
    return table


def _scene(way: str, about: Document) -> tuple[Text, str, str, str, str]:
    name = Text.assemble((f"{way} ", "dim"), about["name"])
    return name, about["format"] or "", f"{about['splats']:,}", "", str(about["sh_degree"])


def _size(size: int | None) -> str:
    return "" if size is None else f"{size / 1e6:,.2f} MB"


def _share(document: Document) -> str:
    """Return what came out as a share of what went in, where that is known."""
    sizes = [about["bytes"] for about in document["inputs"]]
    return "" if None in sizes else f", {100.0 * document['output']['bytes'] / sum(sizes):.3g} %"
