"""What is kept, for people: one table."""

from __future__ import annotations

import os
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from rich.box import ROUNDED
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from tsplat.errors import LoadError, printable
from tsplat.io.tsplat_header import MOST_SECTIONS, header_bytes, parse
from tsplat.kept import Entry


def report(folder: Path, bound: int, entries: Sequence[Entry]) -> RenderableType:
    """Return a line about all that is kept, and a table of it, the most recently used first.

    Parameters
    ----------
    folder : Path
        Where it is.
    bound : int
        Bytes that may be kept.
    entries : sequence of Entry
        From `tsplat.kept.entries`.
    """
    held = sum(entry.nbytes for entry in entries)
    line = Text(f"{printable(str(folder))}: {held / 1e9:.2f} GB of at most {bound / 1e9:.2f} GB", overflow="fold")
    if not entries:
        return line
    table = Table(box=ROUNDED, header_style="cyan", border_style="dim")
    table.add_column("scene", overflow="fold")
    for name in ("splats", "size", "last used"):
        table.add_column(name, justify="right", no_wrap=True)
    for entry in reversed(entries):
        used = f"{datetime.fromtimestamp(entry.used):%Y-%m-%d %H:%M}"
        table.add_row(printable(entry.path.stem), _splats(entry), f"{entry.nbytes / 1e6:,.2f} MB", used)
    return Group(line, table)


def _splats(entry: Entry) -> str:
    try:
        with entry.path.open("rb") as file:
            header = parse(entry.path, file.read(header_bytes(MOST_SECTIONS)), os.fstat(file.fileno()).st_size)
    except (OSError, LoadError):
        return "broken"
    return f"{header.counts.splats:,}"
