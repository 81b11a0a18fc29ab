"""A conversion for people: one table, from what went in down to what came out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.box import ROUNDED
from rich.table import Table
from rich.text import Text

from tsplat.errors import printable

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
    for each in document["inputs"]:
        _add_scene(table, "in", each, str(each["sh_degree"]), "")
    table.add_section()
    for step in document["edits"]:
        removed = f"{step['removed']:,}" if step["removed"] else ""
        table.add_row(Text(step["edit"]), "", f"{step['splats']:,}", removed, str(step["sh_degree"]), "")
    table.add_section()
    output = document["output"]
    share = "" if output["ratio"] is None else f", {100.0 * output['ratio']:.3g} %"
    _add_scene(table, "out", output, "", share, style="bold")
    return table


def _add_scene(table: Table, way: str, about: Document, sh_degree: str, share: str, style: str = "") -> None:
    name = Text.assemble((f"{way} ", "dim"), printable(about["name"]))
    size = "" if about["bytes"] is None else f"{about['bytes'] / 1e6:,.2f} MB"
    table.add_row(name, about["format"], f"{about['splats']:,}", "", sh_degree, size + share, style=style)
