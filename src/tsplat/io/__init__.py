"""Stage 1: files become `Gaussians`, every encoding undone.

`load` chooses the format by the first bytes, then by the suffix; `tsplat.io.formats` lists them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import BinaryIO

from tsplat import given
from tsplat.errors import OptionError, SaveError
from tsplat.files import replacing
from tsplat.io.cameras import TrainingCamera, load_cameras
from tsplat.io.finish import warn_faint
from tsplat.io.formats import FORMATS, Format, find_format
from tsplat.io.losses import refuse_lost, warn_lost
from tsplat.io.options import LoadOptions
from tsplat.io.recognition import recognized
from tsplat.io.sources import local_file
from tsplat.io.train_focal import train_focal_beside, training_beside
from tsplat.scene import Gaussians, a_scene

__all__ = [
    "TrainingCamera", "demo_path", "load", "load_cameras", "save", "saving", "train_focal_beside",
    "training_beside",
]  # fmt: skip


def load(
    path: str | Path,
    *,
    max_splats: int | None = None,
    raw_opacity: bool = False,
    raw_scales: bool = False,
    spz_frame: str | None = None,
    lod: int | None = 0,
    format: str | None = None,
    extra: bool = False,
    progress: Callable[[float], None] | None = None,
    fetched: Callable[[int, int | None], None] | None = None,
) -> Gaussians:
    """Read a scene.

    Parameters
    ----------
    path : str or Path
        A splat PLY (little-endian, big-endian, ASCII, or PlayCanvas' compressed PLY), .splat, .ksplat, SPZ, glTF,
        SOG (zipped, or a meta.json or lod-meta.json with its planes beside it), gsplat's PNG compression (by its
        meta.json), or an .npz of a gsplat or nerfstudio checkpoint; SH degree 0 to 4. Any of them may be packed
        with gzip, or be the one scene in a zip or a folder, such as that of a training. A str may also be ``-``,
        standard input, or an http, https or s3 URL, for which ``pip install "tsplat[remote]"``.
    max_splats : int, optional
        Keep at most this many, those with the largest opacity times area; by default all.
    raw_opacity : bool
        A PLY or .npz holds opacities from 0 to 1 where others hold logits.
    raw_scales : bool
        A PLY or .npz holds scales in world units where others hold their logarithms.
    spz_frame : str, optional
        The axes of an SPZ, one of `tsplat.io.options.SPZ_FRAMES`. By default those that it says, else ``rub``:
        right, up, back, as specified. Some writers keep a PLY's ``rdf`` and do not say so.
    lod : int, optional
        Which level of detail of a streamed scene, 0 the finest; None for all of them, one over the other.
    format : str, optional
        Read the file as one of `tsplat.io.options.FORMAT_NAMES`; by default as what its first bytes say, else its
        name.
    extra : bool
        Keep what else a PLY holds, as `Gaussians.extra`: columns and elements of its own, comments. They follow
        the splats through `tsplat.edit`, and a PLY that is saved has them.
    progress : callable, optional
        Called with the fraction done, growing from 0 to 1.
    fetched : callable, optional
        Called with the number of bytes that have come from standard input or a URL, and that of all, or None where
        it is not known.

    Returns
    -------
    Gaussians
        In file order. Splats with nan, inf or a zero quat are left out; points become balls.

    Raises
    ------
    LoadError
        No such file, or it is no splat scene of a known format; `CorruptFileError` where it is broken.
    OptionError
        An option is out of its range, or the scene has no such level.

    Warns
    -----
    LoadWarning
        Splats were left out or mended, and how many; or there is nothing to see; or points were made splats.
    """
    options = LoadOptions(
        max_splats, raw_opacity, spz_frame, lod, format=format, raw_scales=raw_scales, extra=extra
    )
    progress = given.function("progress", progress or (lambda _: None))
    fetched = given.function("fetched", fetched or (lambda *_: None))
    with local_file(path, options.lod, progress, fetched, options.format) as (local, reading):
        known = recognized(local, options.format)
        if options.lod and not known.levels:
            raise OptionError(f"lod must be 0 in a scene that is not streamed, got {lod}")
        gaussians = known.read(local, options, reading)
        warn_faint(local, gaussians, stacklevel=3)
        return gaussians


def save(path: str | Path, gaussians: Gaussians, *, strict: bool = False) -> Path:
    """Write a scene in the format that the suffix names; an existing file is replaced in one step.

    Parameters
    ----------
    path : str or Path
        The file.
    gaussians : Gaussians
        The scene.
    strict : bool
        Refuse to write what the format cannot hold.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    SaveError
        The suffix names no format that can be written, or the folder cannot be written; with ``strict``, something
        would be lost.
    SceneError
        The scene is none.

    Warns
    -----
    SaveWarning
        Something was lost, beyond the rounding of the format.
    """
    path = given.path(path)
    a_scene(gaussians)
    with saving(path, strict=strict) as write:
        losses = write(gaussians)
    warn_lost(path, losses, stacklevel=3)
    return path


@contextmanager
def saving(path: Path, *, strict: bool = False) -> Iterator[Callable[[Gaussians], list[str]]]:
    """Check that `save` can write there, and give what does so and says what is lost: for scenes that take long.

    Raises
    ------
    SaveError
        As `save`; before anything else is done.
    """
    known = find_format(b"", path.name)
    if known is None or known.write is None:
        if known is not None and known.suffixes == (".tsplat",):
            raise SaveError(f"{path}: a .tsplat takes levels of detail; tsplat optimize writes it")
        suffixes = ", ".join(suffix for known in FORMATS if known.write for suffix in known.suffixes)
        raise SaveError(f"{path}: suffix {path.suffix!r} is no format that can be written; use one of {suffixes}")
    with replacing(path) as file:
        yield partial(_write, path, known, file, strict)


def _write(path: Path, known: Format, file: BinaryIO, strict: bool, gaussians: Gaussians) -> list[str]:
    assert known.write
    losses = [*known.losses(gaussians), *known.write(file, gaussians)]
    if strict:
        refuse_lost(path, losses)
    return losses


def demo_path() -> Path:
    """Return where the demo scene is: PLAYBOT by Stephane Agullo, CC-BY-4.0; see ``demo.txt`` beside it."""
    return Path(__file__).resolve().parents[1] / "demo.ply"
