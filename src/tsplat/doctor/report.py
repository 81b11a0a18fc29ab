"""The examination for people: a few lines, then tables of questions and of outputs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.box import ROUNDED
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from tsplat.doctor.examination import is_late

Examination = Mapping[str, Any]

COLORS = {1 << 24: "24-bit", 256: "256", 16: "16", 0: "none, NO_COLOR is set"}
NOT_KNOWN = "not known"


def report(examination: Examination) -> RenderableType:
    """Return all of an examination."""
    chosen = examination["chosen"]
    choice = Text.assemble(
        ("chosen: ", "bold"), (chosen["output"] or "nothing", "bold green"), f", {chosen['why']}"
    )
    asked: list[RenderableType] = [_questions(examination), *_remarks(examination)] if examination["asked"] else []
    nothing = Text(f"nothing was asked: {examination['not_asked_because']}; this is what the environment tells")
    heading: list[RenderableType] = [] if examination["asked"] else [nothing, ""]
    return Group(*heading, _facts(examination), "", *asked, _outputs(examination), choice)


def _facts(examination: Examination) -> Table:
    terminal, machine = examination["terminal"], examination["machine"]
    rows = {
        "terminal": f"{terminal['program']} {terminal['version']}".strip() or NOT_KNOWN,
        "behind": terminal["multiplexer"] or "no multiplexer",
        "where": "another machine, over SSH" if terminal["remote"] else "this machine",
        "size": _size(terminal),
        "colours": COLORS[terminal["colors"]],
        **{words: "yes" if can else "no" for words, can in examination["abilities"].items()},
        "environment": ", ".join(f"{name}={value}" for name, value in examination["environment"].items()),
        "versions": ", ".join(f"{name} {machine[name]}" for name in ("tsplat", "python", "numpy", "numba")),
        "machine": f"{machine['processor']}, {machine['processors']} processors, {machine['system']}",
    }
    if examination["tmux"]:
        rows["tmux says"] = examination["tmux"]
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in rows.items():
        table.add_row(name, Text(value))
    return table


def _size(terminal: Mapping[str, Any]) -> str:
    if not terminal["columns"]:
        return NOT_KNOWN
    by_kernel = terminal["pixels_by_the_kernel"]
    pixels = terminal["pixels_by_the_terminal"] or (by_kernel if all(by_kernel) else None)
    area = f"{pixels[0]} x {pixels[1]} pixels" if pixels else "pixels not said"
    cell = f"a cell {terminal['cell'][0]} x {terminal['cell'][1]}" if terminal["cell"] else "a cell's not said"
    return f"{terminal['columns']} x {terminal['rows']} cells, {area}, {cell}"


def _questions(examination: Examination) -> Table:
    table = _table("question", "asked", "reply", "ms")
    for row in examination["questions"]:
        took = "" if row["milliseconds"] is None else f"{row['milliseconds']:.1f}"
        reply = Text("no answer", "dim") if row["reply"] is None else Text(row["reply"])
        table.add_row(row["name"], Text(row["asked"]), reply, took)
    return table


def _remarks(examination: Examination) -> list[RenderableType]:
    remarks = []
    if examination["also_came"]:
        remarks.append(f"also came, and answers nothing: {examination['also_came']}")
    if is_late(examination):
        remarks.append("the answers were late: the viewer starts without them and takes them up when they come")
    if examination["questions"][-1]["reply"] is None:
        remarks.append("the last question, which every terminal answers, was not answered")
    return [Text(remark, "yellow") for remark in remarks]


def _outputs(examination: Examination) -> Table:
    table = _table("output", "offered", "why")
    for row in examination["outputs"]:
        offered = Text("yes", "green") if row["offered"] else Text("no", "dim")
        table.add_row(row["name"], offered, Text(row["why"]))
    return table


def _table(*names: str) -> Table:
    table = Table(box=ROUNDED, header_style="cyan", border_style="dim")
    for name in names:
        table.add_column(name, overflow="fold", no_wrap=name in ("question", "output"))
    return table
