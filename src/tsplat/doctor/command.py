"""`tsplat doctor`: its arguments; everything else is imported when it runs."""

from __future__ import annotations

import os
import sys

import rich_click as click

WIDTH = 115
"""Columns of what is not written to a terminal."""


@click.command("doctor")
@click.option("--json", "as_json", is_flag=True, help="As JSON, for programs.")
def doctor(as_json: bool) -> None:
    """Print what this terminal was asked, what it answered, what was chosen and why: put it into bug reports."""
    from tsplat.doctor.examination import examine

    examination = examine(os.environ)
    if as_json:
        import json

        print(json.dumps(examination, indent=2), flush=True)
        return
    from rich.console import Console

    from tsplat.doctor.report import report

    console = Console(highlight=False, width=None if sys.stdout.isatty() else WIDTH)
    console.print(report(examination))
    sys.stdout.flush()
