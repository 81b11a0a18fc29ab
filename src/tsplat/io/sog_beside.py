"""The files that the JSON of a SOG scene names, fetched to where the reader will look for them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Protocol

from tsplat.io import sog
from tsplat.io.gsplat_png import files_of
from tsplat.io.json_kinds import json_kind
from tsplat.io.sog_files import ZIP_MAGICS, Folder
from tsplat.io.sog_json import Fields, read_fields
from tsplat.io.sog_lod import is_streamed, pieces_of_level
from tsplat.io.sog_meta import parse_meta

Progress = Callable[[float], None]


class Fetch(Protocol):
    """Brings the file at an address to a place."""

    def __call__(self, url: str, place: Path, progress: Progress) -> None: ...


def is_json(path: Path) -> bool:
    """Tell whether a file begins as the JSON of a scene does."""
    with path.open("rb") as file:
        head = file.read(64)
    return sog.matches(head) and not head.startswith(ZIP_MAGICS)


def fetch_beside(
    meta: Path, address: Callable[[str], str], fetch: Fetch, lod: int | None, progress: Progress
) -> None:
    """Fetch what a meta.json or a lod-meta.json names, and what the pieces of a streamed scene name in turn.

    Parameters
    ----------
    meta : Path
        The JSON at its place; the rest comes into the same folder, whatever a name says.
    address : callable
        Gives the address of a file by the name that the JSON has for it.
    fetch : Fetch
        Brings a file.
    lod : int or None
        Of a streamed scene only the files of this level are fetched; None for all.
    progress : callable
        Hears the fraction done.

    Raises
    ------
    LoadError
        A file cannot be fetched; `CorruptFileError` where the JSON is broken.
    OptionError
        The scene has no such level.
    """
    beside = Beside(meta.parent, address, fetch)
    fields = read_fields(Folder(meta), meta.name)
    if not is_streamed(fields):
        return beside.bring_planes(meta.name, progress)
    pieces = pieces_of_level(fields, lod)
    for piece, share in zip(pieces, _shares(progress, len(pieces)), strict=True):
        beside.bring_scene(piece.name, share)
    return None


@dataclass(frozen=True, slots=True)
class Beside:
    """A folder that fills with files of the same names from elsewhere."""

    folder: Path
    address: Callable[[str], str]
    fetch: Fetch

    def bring(self, name: str, progress: Progress) -> Path:
        """Fetch a file, unless another one named it before; return its place."""
        place = self.folder / name
        if not place.exists():
            place.parent.mkdir(parents=True, exist_ok=True)
            try:
                self.fetch(self.address(name), place, progress)
            except BaseException:
                place.unlink(missing_ok=True)  # half of it is not it, when somebody asks again
                raise
        return place

    def bring_scene(self, name: str, progress: Progress) -> None:
        """Fetch a zip, or a meta.json and its planes."""
        if is_json(self.bring(name, _silent)):
            self.bring_planes(name, progress)
        progress(1.0)

    def bring_planes(self, name: str, progress: Progress) -> None:
        """Fetch the planes of a meta.json that is here."""
        place = self.folder / name
        fields = read_fields(Folder(place), place.name)
        if not fields.has("means"):
            return  # the reader says what it is instead
        planes = _planes(fields)
        for plane, share in zip(planes, _shares(progress, len(planes)), strict=True):
            self.bring(str(PurePosixPath(name).parent / plane), share)


def _planes(fields: Fields) -> list[str]:
    if json_kind(fields.values) == "gsplat":
        return files_of(fields.values)
    meta = parse_meta(fields)
    planes = [meta.means_l, meta.means_u, meta.quats, meta.scales, meta.sh0]
    return planes + ([meta.palette.centroids, meta.palette.labels] if meta.palette else [])


def _shares(progress: Progress, count: int) -> Iterator[Progress]:
    """Yield so many callables that each hear of an equal part of the whole."""
    for number in range(count):

        def share(fraction: float, number: int = number) -> None:
            progress((number + fraction) / count)

        yield share


def _silent(_: float) -> None:
    pass
