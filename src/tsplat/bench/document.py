"""Results for programs: one JSON document with everything that the tables show, and what lies behind it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from tsplat.bench.results import Ceilings, SceneResult, Spread, ThreadRun, ViewTimes


def document(results: Sequence[SceneResult], ceilings: Ceilings, machine: dict[str, str | int]) -> dict[str, Any]:
    """Return the results as what `json.dumps` takes; what is not known is None.

    Notes
    -----
    Times are milliseconds, sizes pixels, shares 1 for all of it. ``frame_ms`` is `ThreadRun.frame_ms`;
    ``stages`` has the spread of each stage and of the whole ``frame``. Keys may be added, never renamed.
    """
    return {
        "machine": machine,
        "ceilings": asdict(ceilings),
        "results": [_scene(result, ceilings) for result in results],
    }


def _scene(result: SceneResult, ceilings: Ceilings) -> dict[str, Any]:
    return {
        "scene": result.scene,
        "splats": result.splats,
        "sh_degree": result.sh_degree,
        "width": result.width,
        "height": result.height,
        "frames": result.frames,
        "runs": [_run(run, result.one_thread, ceilings) for run in result.runs],
    }


def _run(run: ThreadRun, one: ThreadRun | None, ceilings: Ceilings) -> dict[str, Any]:
    return {
        "threads": run.threads,
        "frame_ms": run.frame_ms,
        "speedup": run.speedup(one),
        "blends_per_second": run.blends_per_second,
        "micro_kernel_share": run.micro_kernel_share(ceilings),
        "copy_share": run.copy_share(ceilings),
        "stages": {stage: asdict(spread) for stage, spread in run.spreads.items()},
        "views": [_view(view) for view in run.views],
    }


def _view(view: ViewTimes) -> dict[str, Any]:
    stages = {stage: asdict(Spread.of(times)) for stage, times in view.milliseconds.items()}
    counts = {name: getattr(view, name) for name in ("visible", "pairs", "blends", "project_bytes")}
    return {"name": view.name, **counts, "stages": stages}
