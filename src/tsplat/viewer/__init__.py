"""Front door: `view` shows a scene in this terminal until the person leaves."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from tsplat.processors import available_processors
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians
from tsplat.terminal.pacing import LATENCY, Pacer

if TYPE_CHECKING:
    from tsplat.lod import Stored
    from tsplat.viewer.recorder import Recorder

__all__ = ["view"]


def view(
    gaussians: Gaussians | Stored,
    options: RenderOptions,
    *,
    name: str = "view",
    output: str | None = None,
    up: tuple[float, float, float] | None = None,
    fov_y: float = 55.0,
    spz: bool = False,
    raw_opacity: bool = False,
    latency: float = LATENCY,
    dither: bool = False,
    budget: int | None = None,
    recorder: Recorder | None = None,
) -> None:
    """Open the viewer; it returns when the person quits, with the terminal as it was.

    Parameters
    ----------
    gaussians : Gaussians or Stored
        The scene, in memory or on disk.
    options : RenderOptions
        How to draw at first.
    name : str
        What saved pictures are called: ``tsplat-name-001.png`` in the current folder.
    output : str, optional
        A name in `tsplat.encode.ENCODERS`; by default the best this terminal announces.
    up : tuple of 3 floats, optional
        Direction in the world that stays upright; guessed by default.
    fov_y : float
        Vertical field of view in degrees.
    spz : bool
        Whether the scene is an SPZ read as specified: it may be upside down all the same.
    raw_opacity : bool
        Whether the scene was loaded with raw opacities.
    latency : float
        Seconds that a frame may take on its way while the view moves; what would take longer is sent coarser.
    dither : bool
        Whether sixel mixes colours that its palette lacks.
    budget : int, optional
        How many splats a frame gets while the view moves, merged where that shows least; by default some for each
        pixel, 0 for all.
    recorder : Recorder, optional
        Who records the session; outputs that it does not take are not offered.

    Raises
    ------
    TerminalError
        There is no terminal, or it went away.
    OptionError
        There is no such output.
    """
    from tsplat.terminal import choose_output, outputs
    from tsplat.viewer.detail import Detail
    from tsplat.viewer.loop import Viewer
    from tsplat.viewer.picture import screen_pixels
    from tsplat.viewer.recorder import Recorder
    from tsplat.viewer.scenes import scenes_of
    from tsplat.viewer.starts import Starts, greeting
    from tsplat.viewer.state import ViewerState

    recorder = recorder or Recorder()
    with recorder.session() as session:
        size = session.size()
        chosen = choose_output(output, os.environ, session.profile)
        known = tuple(name for name in outputs(session.profile) if recorder.takes(name))
        if not recorder.takes(chosen):
            chosen = known[0]
        width, height = screen_pixels(size, chosen)
        starts = Starts(gaussians, options, aspect=width / height, fov_y=fov_y, up=up, spz=spz)
        start = starts.first.pose
        state = ViewerState(
            pose=start,
            start=start,
            radius=0.5 * start.distance,
            size=size,
            options=options,
            output=chosen,
            outputs=known if chosen in known else (chosen, *known),
            total=len(gaussians),
            kept=len(gaussians),
            on_disk=not isinstance(gaussians, Gaussians),
            raw_opacity=raw_opacity,
            scene_degree=gaussians.sh_degree,
            threads=available_processors(),
            fov_y=fov_y,
            releases=session.profile.kitty_keyboard,
            message=greeting(starts.first.up),
        )
        painter = recorder.painter(scenes_of(gaussians, raw_opacity=raw_opacity), session.profile)
        painter.dither, painter.detail = dither, Detail(gaussians, budget)
        pacer = Pacer(latency, remote=session.profile.remote)
        Viewer(session, painter, state, f"tsplat-{name}", Path.cwd(), pacer, starts).run()
