"""Arguments to calls; prints every error as one line.

Anything slow to import is imported by the command that needs it: ``--help`` and ``--version`` are quick.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import rich_click as click

from tsplat import __version__, numerals
from tsplat.arguments import DEMO, POINT, Number, Triples, ViewByDefault, Whole, scene_name
from tsplat.bench.command import bench
from tsplat.cache.command import cache
from tsplat.convert.command import convert
from tsplat.doctor.command import doctor
from tsplat.drawing import draw_all
from tsplat.encode import ENCODERS, FALLBACK_CELL, PICTURES
from tsplat.errors import LoadWarning, OptionError, SaveWarning, TsplatError, printable
from tsplat.files import tidy_end
from tsplat.info.command import info
from tsplat.optimize.command import optimize
from tsplat.options import READING, is_spz, open_scene, reading, render_options, shared, was_said
from tsplat.progress import wait_for_kernels
from tsplat.record.command import record
from tsplat.standard_streams import standard_streams
from tsplat.warmup import WarmUp

if TYPE_CHECKING:
    from tsplat.camera import Camera, Vector
    from tsplat.lod import Stored
    from tsplat.rendering import RenderOptions
    from tsplat.scene import Gaussians

SIZE = 1280, 720
PRINTED_COLUMNS, ROWS_PER_COLUMN = 80, 0.3


def main(args: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status: 0, 2 after an error, 130 after Ctrl-C."""
    numerals.drop_wrong_sizes(os.environ)
    click.rich_click.WIDTH = click.rich_click.MAX_WIDTH = None  # TERMINAL_WIDTH, as it was when this was imported
    with tidy_end(), standard_streams(), warnings.catch_warnings():
        for kind in (LoadWarning, SaveWarning):
            warnings.simplefilter("always", kind)
        warnings.showwarning = _show_warning
        try:
            status = command.main(args, prog_name="tsplat", standalone_mode=False) or 0
            sys.stdout.flush()
            return status
        except click.Abort:
            return 130
        except click.UsageError as error:
            context = error.ctx.command_path if error.ctx else "tsplat"
            return _fail(f"{error.format_message().rstrip('.')}; see '{context} --help'")
        except (click.ClickException, TsplatError) as error:
            return _fail(error.format_message() if isinstance(error, click.ClickException) else str(error))
        except MemoryError as error:
            wanted = f" ({error})" if str(error) else ""
            return _fail(
                f"there is not enough memory{wanted}; fewer splats (--max-splats) or a smaller picture need less"
            )
        except BrokenPipeError:
            return 1  # the reader has seen enough
        except Exception as error:
            if not _interrupted(error):
                raise
            return 130


def _interrupted(error: BaseException | None) -> bool:
    """Tell whether Ctrl-C is behind an error: code that it strikes while it cleans up may say something else."""
    while error and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None


def _fail(text: str) -> int:
    print(f"tsplat: {printable(' '.join(text.split()))}", file=sys.stderr, flush=True)
    return 2


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    print(f"tsplat: warning: {printable(' '.join(str(message).split()))}", file=sys.stderr)


@click.group(cls=ViewByDefault, context_settings={"help_option_names": ["-h", "--help"]}, options_metavar="",
             subcommand_metavar="[SCENE | COMMAND] [OPTIONS]")  # fmt: skip
@click.version_option(__version__, message="tsplat %(version)s")
def command() -> None:
    """Show 3D Gaussian splat scenes in this terminal, on the CPU.

    `tsplat` opens the demo, `tsplat SCENE` opens a scene, which is a file, a URL, or - for standard input: fly
    through it, press ? for the keys. Into a pipe it prints one picture as text. `tsplat view --help` lists the
    viewer's options.
    """


@command.command(cls=Triples)
@click.argument("scene", default=DEMO)
@click.option("--output", type=click.Choice(ENCODERS), help="How pictures are shown. [what the terminal can]")
@shared("up", "antialias", "sh-degree", "background", "fov-y", "train-focal", *READING, "threads", "memory")
@click.option(
    "--latency",
    type=Number(10, 10_000),
    default=100,
    show_default=True,
    metavar="MS",
    help="How long a frame may take on its way while the view moves.",
)
@click.option("--budget", type=Whole(0), metavar="N",
              help="Splats a frame gets while the view moves, merged where that shows least; 0: all. "
              "[2.5 a pixel]")  # fmt: skip
@click.option("--dither", is_flag=True, help="Mix the colours that sixel's palette lacks, in more bytes.")
@click.option("--width", type=Whole(1, 1000), metavar="COLUMNS",
              help="Columns of a printed picture. [COLUMNS, else 80]")  # fmt: skip
@click.option("--height", type=Whole(1, 1000), metavar="ROWS", help="Rows of a printed picture.")
@click.pass_context
def view(context: click.RichContext, /, scene: str, output: str | None, up: Vector | None, fov_y: float,
         latency: float, budget: int | None, dither: bool, width: int | None, height: int | None,
         **options: Any) -> None:  # fmt: skip
    """Open SCENE, or the demo, in the viewer: the default command; print one picture when piped."""
    printing = not sys.stdout.isatty()
    if printing and output in PICTURES:
        raise OptionError(f"--output {output} needs a terminal; a printed picture is text, half for example")
    warm_up = WarmUp()
    how = reading(options)
    gaussians = open_scene(scene, how, warm_up, levels=not printing and not was_said("lod", context))
    chosen = render_options(scene, gaussians, options)
    if printing:
        wait_for_kernels(warm_up)
        size = _printed_size(width, height)
        where: dict[str, Any] = {"fov_y": fov_y, "up": up, "spz": is_spz(scene, how)}
        return _print_frame(gaussians, chosen, output or "half", size, **where)
    from tsplat import viewer

    return viewer.view(
        gaussians, chosen, name=scene_name(scene), output=output, up=up, fov_y=fov_y, spz=is_spz(scene, how),
        raw_opacity=how["raw_opacity"], latency=1e-3 * latency, dither=dither, budget=budget,
    )  # fmt: skip


@command.command(cls=Triples)
@click.argument("scene")
@click.option(
    "-o", "--output", required=True, metavar="FILE", help=".png, .jpg, .webp, or .npy with float32 RGBA."
)
@click.option("--width", type=Whole(1, 16384), default=SIZE[0], show_default=True, help="Pixels across.")
@click.option("--height", type=Whole(1, 16384), default=SIZE[1], show_default=True, help="Pixels down.")
@click.option("--eye", type=POINT, metavar="X Y Z", help="Where the camera is. [where the scene is in view]")
@click.option("--target", type=POINT, metavar="X Y Z", help="What it looks at. [the scene's middle]")
@shared("up", "fov-y", "sh-degree", "antialias", "background", "train-focal", *READING, "threads", "memory")
def render(scene: str, output: str, width: int, height: int, **options: Any) -> None:
    """Render SCENE, or `demo`, to a picture."""
    from tsplat import images

    images.check_suffix(output)
    view = {name: options.pop(name) for name in ("eye", "target", "up", "fov_y")}
    warm_up = WarmUp()
    how = reading(options)
    gaussians = open_scene(scene, how, warm_up)
    chosen = render_options(scene, gaussians, options, "classic")
    wait_for_kernels(warm_up)
    camera = _camera(gaussians, chosen, width, height, **view, spz=is_spz(scene, how))
    rendering = draw_all(gaussians, camera, chosen)
    milliseconds = sum(rendering.stage_ms.values())
    path = rendering.save(output)
    splats = f"{min(rendering.visible, len(gaussians)):,} of {len(gaussians):,} splats"
    print(f"{printable(str(path))}: {width} x {height}, {splats}, rendered in {milliseconds:.0f} ms", flush=True)


command.add_command(info)
command.add_command(convert)
command.add_command(optimize)
command.add_command(cache)
command.add_command(bench)
command.add_command(doctor)
command.add_command(record)


def _camera(
    gaussians: Gaussians | Stored,
    options: RenderOptions,
    width: int,
    height: int,
    *,
    fov_y: float,
    spz: bool,
    eye: Vector | None = None,
    target: Vector | None = None,
    up: Vector | None = None,
) -> Camera:
    """Return the camera asked for; what was not said comes from the start view."""
    from tsplat.camera import Camera
    from tsplat.first_view import first_view, framed_by, where_to_stand
    from tsplat.origin import in_scene

    how: dict[str, Any] = {"aspect": width / height, "fov_y": fov_y, "up": up, "spz": spz}
    if target is None and eye is None:
        return first_view(gaussians, options, **how).pose.camera(width, height, fov_y)
    start, frame = where_to_stand(gaussians, options, **how).pose, framed_by(gaussians)
    eye, target = (None if point is None else tuple(in_scene(frame, point)) for point in (eye, target))
    target = target or tuple(start.target)
    eye = eye or tuple(target - start.distance * start.forward)
    return Camera.look_at(eye, target, up or start.up, width=width, height=height, fov_y=fov_y)


def _printed_size(columns: int | None, rows: int | None) -> tuple[int, int]:
    if columns is None:
        columns = numerals.columns(os.environ) or PRINTED_COLUMNS
    return columns, rows or max(1, round(ROWS_PER_COLUMN * columns))


def _print_frame(
    gaussians: Gaussians | Stored,
    options: RenderOptions,
    output: str,
    size: tuple[int, int],
    *,
    fov_y: float,
    up: Vector | None,
    spz: bool,
) -> None:
    from tsplat.encode.cells import Cells

    columns, rows = size
    cells = Cells(output, 0 if os.environ.get("NO_COLOR") else 1 << 24)
    across, down = cells.pixels_per_cell(*FALLBACK_CELL)
    camera = _camera(gaussians, options, columns, 2 * rows, fov_y=fov_y, up=up, spz=spz)
    frame = draw_all(gaussians, camera.resized(columns * across, rows * down), options).frame()
    sys.stdout.flush()
    sys.stdout.buffer.writelines(cells.lines(frame))
    sys.stdout.buffer.flush()
