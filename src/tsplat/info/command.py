"""`tsplat info`: its arguments; everything else is imported when it runs."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import rich_click as click

from tsplat.arguments import scene_path
from tsplat.errors import LoadWarning
from tsplat.options import READING, load_scene, reading, shared


@click.command("info")
@click.argument("scene")
@click.option("--json", "as_json", is_flag=True, help="As JSON, for programs; docs/info.md describes it.")
@shared(*READING)
def info(scene: str, as_json: bool, **options: Any) -> None:
    """Print what SCENE, or `demo`, holds, how its values are spread, and what looks wrong in it."""
    from tsplat.info.document import document

    how = reading(options)
    with _load_warnings() as problems:
        gaussians = load_scene(scene, how)
    chosen = {name: how[name] for name in ("raw_opacity", "max_splats")}
    found = document(scene, scene_path(scene), gaussians, problems, **chosen)
    if as_json:
        import json

        print(json.dumps(found, indent=2, allow_nan=False), flush=True)
        return
    from rich.console import Console

    from tsplat.info.report import report

    console = Console(highlight=False)
    console.print(report(found, console.width, blocks=not console.options.ascii_only))
    sys.stdout.flush()


@contextmanager
def _load_warnings() -> Iterator[list[str]]:
    """Give a list that gets the texts of what readers warn of; other warnings are shown as ever."""
    texts: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", LoadWarning)
        yield texts
    for each in caught:
        if issubclass(each.category, LoadWarning):
            texts.append(str(each.message))
        else:
            warnings.showwarning(each.message, each.category, each.filename, each.lineno)
