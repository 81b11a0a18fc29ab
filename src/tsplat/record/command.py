"""`tsplat record`: its arguments; everything else is imported when it runs."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import rich_click as click

from tsplat.arguments import DEMO, Number, Triples, Whole, scene_name
from tsplat.encode import ENCODERS, FALLBACK_CELL
from tsplat.errors import OptionError, SaveError, printable
from tsplat.files import replacing
from tsplat.options import READING, is_spz, load_scene, reading, render_options, shared
from tsplat.progress import loading, wait_for_kernels
from tsplat.warmup import WarmUp

if TYPE_CHECKING:
    from tsplat.record.orbit import Orbit
    from tsplat.rendering import RenderOptions
    from tsplat.scene import Gaussians

CAST = ".cast"
DEFAULTS: dict[str, Any] = {
    "seconds": 6.0,
    "turns": 1,
    "fps": 20,
    "width": 640,
    "height": 360,
    "columns": 80,
    "rows": 24,
    "output": "half",
}
"""What an option says that fits the recording and is not given."""


@click.command("record", cls=Triples)
@click.argument("out", metavar="OUT.cast|.gif|.webp|.mp4", help="What to write, by its suffix.")
@click.argument("scene", default=DEMO)
@click.option("--live", is_flag=True, help="Open the viewer, and record what you do until you quit.")
@click.option("--seconds", type=Number(0, 3600, min_open=True), help="How long an orbit lasts. [6]")
@click.option("--turns", type=Whole(-100, 100), help="How often around; backwards below 0. [1]")
@click.option("--fps", type=Whole(1, 60), help="Frames a second. [20]")
@click.option("--width", type=Whole(2, 4096), help="Pixels across. [640]")
@click.option("--height", type=Whole(2, 4096), help="Pixels down. [360]")
@click.option("--columns", type=Whole(1, 1000), help="Columns of a .cast. [80]")
@click.option("--rows", type=Whole(1, 1000), help="Rows of a .cast. [24]")
@click.option("--output", type=click.Choice(ENCODERS),
              help="How a .cast or the viewer shows pictures. [half; --live: what the terminal can]")  # fmt: skip
@shared("up", "fov-y", "sh-degree", "antialias", "background", "train-focal", *READING, "threads", "memory")
def record(out: str, scene: str, live: bool, up: Any, fov_y: float, **options: Any) -> None:
    """Record an orbit around SCENE, or the demo, or a session with it, as an asciicast or a moving picture."""
    wanted = {name: options.pop(name) for name in DEFAULTS}
    path = Path(out)
    check(path, live, wanted)
    how = {name: DEFAULTS[name] if value is None else value for name, value in wanted.items()}
    with replacing(path) as file:
        warm_up = WarmUp()
        read = reading(options)
        gaussians = load_scene(scene, read, warm_up)
        chosen = render_options(scene, gaussians, options)
        if live:
            view = {"name": scene_name(scene), "output": wanted["output"], "up": up, "fov_y": fov_y,
                    "spz": is_spz(scene, read)}  # fmt: skip
            made = _record_session(file, path, gaussians, chosen, how, raw_opacity=read["raw_opacity"], **view)
        else:
            wait_for_kernels(warm_up)
            orbit = _orbit(path, gaussians, chosen, how, {"up": up, "fov_y": fov_y, "spz": is_spz(scene, read)})
            made = _record_orbit(file, path, orbit, how, scene_name(scene))
    print(f"{printable(out)}: {made}, {path.stat().st_size / 1e3:,.0f} kB", flush=True)


def check(path: Path, live: bool, wanted: dict[str, Any]) -> None:
    """Check that all options given mean something for this recording, and that its format can hold it.

    Raises
    ------
    SaveError
        The suffix names no format, or one whose library is not installed.
    OptionError
        An option does not fit.
    """
    suffix = path.suffix.lower()
    from tsplat import export

    if suffix not in (CAST, *export.SUFFIXES):
        known = ", ".join((CAST, *export.SUFFIXES))
        raise SaveError(f"{path}: suffix '{suffix}' is no recording; use one of {known}")
    taken = _taken(suffix, live)
    for name, value in wanted.items():
        if value is not None and name not in taken:
            kind = f"a {suffix} of {'a session' if live else 'an orbit'}"
            raise OptionError(f"--{name} says nothing about {kind}; it takes {', '.join('--' + n for n in taken)}")
    if suffix != CAST:
        numbers = [DEFAULTS[name] if wanted[name] is None else wanted[name] for name in ("fps", "width", "height")]
        export.check(path, *numbers)
        return
    from tsplat.record.cast import CELLS

    if not live and (wanted["output"] or CELLS[0]) not in CELLS:
        raise OptionError(f"--output {wanted['output']} is not drawn by players of .cast; use {', '.join(CELLS)}")


def _taken(suffix: str, live: bool) -> list[str]:
    """Return the options that say something about a recording."""
    if suffix == CAST:
        return ["output"] if live else ["seconds", "turns", "fps", "columns", "rows", "output"]
    return ["fps", "width", "height", "output"] if live else ["seconds", "turns", "fps", "width", "height"]


def _orbit(path: Path, gaussians: Gaussians, options: RenderOptions, how: dict[str, Any],
           view: dict[str, Any]) -> Orbit:  # fmt: skip
    from tsplat.encode import encoder
    from tsplat.first_view import first_view
    from tsplat.record.orbit import Orbit

    screen = size = how["width"], how["height"]
    if path.suffix.lower() == CAST:
        columns, rows = how["columns"], how["rows"]
        across, down = encoder(how["output"]).pixels_per_cell(*FALLBACK_CELL)
        screen, size = (columns * FALLBACK_CELL[0], rows * FALLBACK_CELL[1]), (columns * across, rows * down)
    start = first_view(gaussians, options, aspect=screen[0] / screen[1], **view).pose
    count = max(1, round(how["seconds"] * how["fps"]))
    return Orbit(gaussians, options, start, screen, size, view["fov_y"], count, how["turns"])


def _record_orbit(file: BinaryIO, path: Path, orbit: Orbit, how: dict[str, Any], title: str) -> str:
    """Write an orbit; return what it is, in a few words."""
    with loading(path.name, doing="recording") as progress:
        if path.suffix.lower() == CAST:
            from tsplat.encode import encoder
            from tsplat.record.cast import write_orbit

            size = how["columns"], how["rows"]
            write_orbit(file, orbit, encoder(how["output"]), size, how["fps"], title=title, progress=progress)
            return f"{len(orbit)} frames of {size[0]} x {size[1]} cells"
        from tsplat import export

        export.write(file, path.suffix.lower(), orbit, how["fps"], progress)
        return f"{len(orbit)} frames of {orbit.size[0]} x {orbit.size[1]}"


def _record_session(file: BinaryIO, path: Path, gaussians: Gaussians, options: RenderOptions, how: dict[str, Any],
                    **view: Any) -> str:  # fmt: skip
    """Open the viewer, write what happened in it; return what that is, in a few words."""
    from tsplat import export, viewer
    from tsplat.record.live import CastRecorder, Replay, ViewRecorder
    from tsplat.viewer.scenes import SceneVariants

    if path.suffix.lower() == CAST:
        viewer.view(gaussians, options, recorder=CastRecorder(file, view["name"]), **view)
        return "a session"
    seen = ViewRecorder()
    viewer.view(gaussians, options, recorder=seen, **view)
    scenes = SceneVariants(gaussians, raw_opacity=view["raw_opacity"])
    replay = Replay(seen, scenes, (how["width"], how["height"]), how["fps"], time.perf_counter())
    with loading(path.name, doing="recording") as progress:
        export.write(file, path.suffix.lower(), replay, how["fps"], progress)
    return f"{len(replay)} frames of {how['width']} x {how['height']}"
