"""Everything that `tsplat info` says, as one plain document: for programs, and for the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tsplat.framing import bulk, guess_up
from tsplat.info.distribution import Axis, distribution
from tsplat.info.findings import finding_of_axes, finding_of_loading, findings
from tsplat.info.measures import Measures, measure
from tsplat.io.on_disk import look
from tsplat.io.options import LoadOptions
from tsplat.io.spz import find_frame
from tsplat.scene import Gaussians
from tsplat.train_views import TrainViews

F32 = npt.NDArray[np.float32]

VERSION = 1
"""Of the document: one more when a key goes away or means something else; keys may be added without."""


def document(
    scene: str,
    path: Path,
    gaussians: Gaussians,
    problems: Sequence[str] = (),
    *,
    raw_opacity: bool = False,
    raw_scales: bool = False,
    max_splats: int | None = None,
    spz_frame: str | None = None,
    format: str | None = None,
    views: TrainViews | None = None,
    spz: bool = False,
) -> dict[str, Any]:
    """Return a scene in numbers, as what `json.dumps` takes: lists, texts as keys, every number finite.

    Parameters
    ----------
    scene : str
        What to call it.
    path : Path
        The file that it was loaded from.
    gaussians : Gaussians
        What was loaded; it may be empty.
    problems : sequence of str
        Texts of the warnings while loading.
    raw_opacity, raw_scales, max_splats, spz_frame, format
        With what it was loaded.
    views : TrainViews, optional
        What its training cameras had in view.
    spz : bool
        Whether it is an SPZ read as specified.

    Notes
    -----
    docs/info.md describes the keys.
    """
    on_disk, box, up = look(path, format), bulk(gaussians), guess_up(gaussians, views, spz=spz)
    measures = measure(gaussians, box)
    # Levels of detail take space on disk that the splats of one level do not account for.
    whole = len(gaussians) > 0 and max_splats is None and on_disk.scenes == 1
    looks_wrong = [finding_of_loading(problem.removeprefix(f"{path}: ")) for problem in problems]
    looks_wrong += findings(measures, box.radius, raw_opacity=raw_opacity, raw_scales=raw_scales)
    looks_wrong += [finding_of_axes()] if up.spz_frame else []
    return {
        "version": VERSION,
        "scene": scene,
        "format": on_disk.format,
        "files": on_disk.files,
        "disk_bytes": on_disk.nbytes,
        "disk_bytes_per_splat": on_disk.nbytes / len(gaussians) if whole else None,
        "splats": len(gaussians),
        "sh_degree": gaussians.sh_degree,
        "antialiased": gaussians.antialiased,
        "origin": list(gaussians.origin) if gaussians.origin else None,
        "frame": find_frame(path, LoadOptions(spz_frame=spz_frame))._asdict() if on_disk.format == "SPZ" else None,
        "memory_bytes": gaussians.nbytes,
        "box": _box(gaussians.means) if len(gaussians) else None,
        "bulk": {
            "center": box.center.tolist(),
            "radius": box.radius,
            "low": box.low.tolist(),
            "high": box.high.tolist(),
        },
        "up": {"direction": list(up.direction), "cue": up.cue, "sureness": up.sureness, "text": up.text},
        "distributions": _distributions(measures) if len(gaussians) else {},
        "warnings": [asdict(finding) for finding in looks_wrong],
    }


def _box(means: F32) -> dict[str, list[float]]:
    x, y, z = means.T
    return {"low": [float(each.min()) for each in (x, y, z)], "high": [float(each.max()) for each in (x, y, z)]}


def _distributions(measures: Measures) -> dict[str, Any]:
    spread: dict[str, tuple[F32 | None, Axis]] = {
        "opacity": (measures.opacities, "unit"),
        "longest_sigma": (measures.longest, "log"),
        "flatness": (measures.flatness, "log"),
        "distance": (measures.distances, "linear"),
        "view_dependence": (measures.view_dependence, "linear"),
    }
    return {name: distribution(values, axis) for name, (values, axis) in spread.items() if values is not None}
