"""Results for people: what was measured on, then stages, threads and views of each scene and size."""

from __future__ import annotations

from rich.box import ROUNDED
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from tsplat.bench.results import FRAME, Ceilings, SceneResult

UNKNOWN = "-"


def heading(machine: dict[str, str | int]) -> RenderableType:
    """Return what the figures were measured on."""
    versions = ", ".join(f"{name} {machine[name]}" for name in ("tsplat", "python", "numpy", "numba"))
    processor = f"{machine['processor']}, {machine['processors']} processors, {machine['system']}"
    return Group(Text(processor, "bold"), Text(versions, "dim"))


def footing(ceilings: Ceilings) -> RenderableType:
    """Return what the shares in the tables are shares of."""
    return Text(
        f"One thread of this machine: micro-kernel {ceilings.blends_per_second / 1e6:,.0f} million blends/s, "
        f"copy {ceilings.copy_bytes_per_second / 1e9:.1f} GB/s (read and written). A blend is a splat into 4 x 4 "
        "pixels. Rates are of the shortest frames.",
        "dim",
    )


def tables(result: SceneResult, ceilings: Ceilings) -> RenderableType:
    """Return the tables of one scene at one size."""
    title = Text(f"{result.scene}, {result.splats:,} splats, {result.width} x {result.height}", "bold cyan")
    views = len(result.runs[0].views)
    about = Text(f"SH degree {result.sh_degree}, {result.frames} frames of each of {views} views", "dim")
    return Group("", title, about, "", _stages(result), _threads(result, ceilings), _views(result))


def _stages(result: SceneResult) -> Table:
    table = _table("threads", "stage, ms", "mean", "min", "p50", "p95", "p99")
    for run in result.runs:
        for row, (stage, spread) in enumerate(run.spreads.items()):
            times = (spread.mean, spread.min, spread.p50, spread.p95, spread.p99)
            whole = stage == FRAME
            table.add_row(
                "" if row else str(run.threads),
                stage,
                *(f"{each:.2f}" for each in times),
                style="bold" if whole else "",
                end_section=whole,
            )
    return table


def _threads(result: SceneResult, ceilings: Ceilings) -> Table:
    table = _table("threads", "frame ms", "speed-up", "frames/s", "Mblends/s", "of kernel", "of copy")
    for run in result.runs:
        blends, speedup = run.blends_per_second, run.speedup(result.one_thread)
        table.add_row(
            str(run.threads),
            f"{run.frame_ms:.2f}",
            UNKNOWN if speedup is None else f"{speedup:.2f}x",
            f"{1e3 / run.frame_ms:.1f}",
            UNKNOWN if blends is None else f"{blends / 1e6:,.0f}",
            _percent(run.micro_kernel_share(ceilings)),
            _percent(run.copy_share(ceilings)),
        )
    return table


def _views(result: SceneResult) -> Table:
    """The work is the same on any number of threads, so the counts are shown once."""
    least = [f"{run.threads} thr. ms" for run in result.runs]
    table = _table("view", "visible", "pairs", "blends", *least)
    for index, view in enumerate(result.runs[0].views):
        times = (f"{run.views[index].of_shortest_frame(FRAME):.2f}" for run in result.runs)
        table.add_row(view.name, f"{view.visible:,}", f"{view.pairs:,}", f"{view.blends:,}", *times)
    return table


def _table(first: str, *others: str) -> Table:
    table = Table(box=ROUNDED, header_style="cyan", border_style="dim")
    table.add_column(first)
    for name in others:
        table.add_column(name, justify="left" if name.startswith("stage") else "right", overflow="fold")
    return table


def _percent(share: float | None) -> str:
    return UNKNOWN if share is None else f"{100.0 * share:.0f} %"
