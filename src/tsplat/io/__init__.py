"""Stage 1: files become `Gaussians`, every encoding undone.

`load` chooses the format by the first bytes, then by the suffix; `tsplat.io.formats` lists them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from tsplat.errors import OptionError, SaveError
from tsplat.files import replacing
from tsplat.io.cameras import TrainingCamera, load_cameras
from tsplat.io.formats import FORMATS, find_format
from tsplat.io.options import LoadOptions
from tsplat.io.recognition import recognized
from tsplat.io.sources import local_file
from tsplat.io.train_focal import train_focal_beside, training_beside
from tsplat.scene import Gaussians

__all__ = [
    "TrainingCamera", "demo_path", "load", "load_cameras", "save", "saving", "train_focal_beside",
    "training_beside",
]  # fmt: skip


def load(
    path: str | Path,
    *,
    max_splats: int | None = None,
    raw_opacity: bool = False,
    spz_frame: str | None = None,
    lod: int | None = 0,
    format: str | None = None,
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
        A PLY holds opacities from 0 to 1 where others hold logits.
    spz_frame : str, optional
        The axes of an SPZ, one of `tsplat.io.options.SPZ_FRAMES`. By default those that it says, else ``rub``:
        right, up, back, as specified. Some writers keep a PLY's ``rdf`` and do not say so.
    lod : int, optional
        Which level of detail of a streamed scene, 0 the finest; None for all of them, one over the other.
    format : str, optional
        Read the file as one of `tsplat.io.options.FORMAT_NAMES`; by default as what its first bytes say, else its
        name.
    progress : callable, optional
        Called with the fraction done, growing from 0 to 1.
    fetched : callable, optional
        Called with the number of bytes that have come from standard input or a URL, and that of all, or None where
        it is not known.

    Returns
    -------
    Gaussians
        In file order. Splats with nan, inf or a zero quat are left out.

    Raises
    ------
    LoadError
        No such file, or it is no splat scene of a known format; `CorruptFileError` where it is broken.
    OptionError
        An option is out of its range, or the scene has no such level.

    Warns
    -----
    LoadWarning
        Splats were left out or mended; the text says how many.
    """
    options = LoadOptions(max_splats, raw_opacity, spz_frame, lod, format)
    with local_file(path, lod, progress or (lambda _: None), fetched or (lambda *_: None)) as (local, reading):
        known = recognized(local, format)
        if options.lod and not known.levels:
            raise OptionError(f"lod must be 0 in a scene that is not streamed, got {lod}")
        return known.read(local, options, reading)


def save(path: str | Path, gaussians: Gaussians) -> Path:
    """Write a scene in the format that the suffix names; an existing file is replaced in one step.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    SaveError
        The suffix names no format that can be written, or the folder cannot be written.
    """
    path = Path(path)
    with saving(path) as write:
        write(gaussians)
    return path


@contextmanager
def saving(path: Path) -> Iterator[Callable[[Gaussians], None]]:
    """Check that `save` can write there, and give what does so, for scenes that take long to make.

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
        yield partial(known.write, file)


def demo_path() -> Path:
    """Return where the demo scene is: PLAYBOT by Stephane Agullo, CC-BY-4.0; see ``demo.txt`` beside it."""
    return Path(__file__).resolve().parents[1] / "demo.ply"
