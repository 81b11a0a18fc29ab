"""`tsplat optimize`: its arguments; everything else is imported when it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import rich_click as click

from tsplat.options import READING, reading, shared


@click.command("optimize")
@click.argument("scene")
@click.option("-o", "--output", required=True, metavar="FILE", help="What to write: a .tsplat.")
@shared("strict", *READING, "threads")
def optimize(scene: str, output: str, strict: bool, threads: int, **options: Any) -> None:
    """Write SCENE, or `demo`, with its levels of detail: a file that opens at once, larger than memory or not."""
    from tsplat.errors import printable
    from tsplat.optimize.optimization import optimize

    print(printable(optimize(scene, Path(output), reading(options), threads, strict=strict)), flush=True)
