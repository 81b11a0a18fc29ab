"""`tsplat info`: its arguments; everything else is imported when it runs."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import rich_click as click

from tsplat.arguments import scene_source
from tsplat.errors import LoadWarning
from tsplat.options import READING, is_spz, loaded_scene, reading, shared


@click.command("info")
@click.argument("scene")
@click.option("--json", "as_json", is_flag=True, help="As JSON, for programs; docs/info.md describes it.")
@shared(*READING)
def info(scene: str, as_json: bool, **options: Any) -> None:
    """Print what SCENE, or `demo`, holds, how its values are spread, and what looks wrong in it."""
    from tsplat.info.document import document
    from tsplat.io import training_beside
    from tsplat.io.sources import called, settled

    name, how, source = called(scene), reading(options), scene_source(scene)
    found_in, _ = settled(source)
    if found_in != source:  # it is a folder: the file that was found is the news
        name = called(found_in)
    with _load_warnings() as warned, loaded_scene(scene, how) as (gaussians, path):
        views = training_beside(found_in, gaussians.origin).views
        problems = [text.removeprefix(f"{name}: ") for text in warned]
        shaping = ("raw_opacity", "raw_scales", "max_splats", "spz_frame", "format")
        chosen = {each: how[each] for each in shaping}
        found = document(name, path, gaussians, problems, **chosen, views=views, spz=is_spz(scene, how))
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
    with warnings.catch_warnings():
        show = warnings.showwarning

        def hear(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
            if issubclass(category, LoadWarning):
                texts.append(str(message))
            else:
                show(message, category, *where, **more)

        warnings.simplefilter("always", LoadWarning)
        warnings.showwarning = hear
        yield texts
