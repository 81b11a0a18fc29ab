"""`tsplat cache`: its arguments; everything else is imported when it runs."""

from __future__ import annotations

import sys

import rich_click as click


@click.command("cache")
@click.option("--clear", is_flag=True, help="Remove all of it.")
def cache(clear: bool) -> None:
    """Say which levels of detail are kept between runs, and where: those of large scenes that the viewer opened.

    TSPLAT_CACHE_GB says how many gigabytes may be kept, 0 for none; at most 8, and a fifth of what is free. Those
    that were not used for longest go first.
    """
    from tsplat import kept

    if clear:
        removed = kept.clear()
        size = sum(entry.nbytes for entry in removed) / 1e9
        print(f"removed {len(removed)} file{'' if len(removed) == 1 else 's'}, {size:.2f} GB", flush=True)
        return
    from rich.console import Console

    from tsplat.cache.report import report

    console = Console(highlight=False)
    console.print(report(kept.folder(), kept.bound(), kept.entries()))
    sys.stdout.flush()
