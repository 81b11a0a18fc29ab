"""What a PLY holds beside the splats themselves: carried along, so that a PLY made of it has it as well."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

NORMALS = "nx", "ny", "nz"

_PLACE = re.compile(rb"epsg|\bcrs\b|proj|utm\b|wgs|offset|shift|georef|vertical", re.IGNORECASE)
"""Comments that may say where a scene lies, or how."""


@dataclass(frozen=True, slots=True)
class Table:
    """An element of a PLY that is not the splats.

    Attributes
    ----------
    name : str
        Of the element.
    count : int
        Rows.
    properties : tuple of str
        Lines of the header, without the word ``property``.
    rows : bytes
        Little-endian.
    about_splats : bool
        Whether its rows name splats by their numbers, or seem to be one for each.
    """

    name: str
    count: int
    properties: tuple[str, ...]
    rows: bytes
    about_splats: bool


@dataclass(frozen=True, eq=False, slots=True)
class Extra:
    """What else a PLY holds.

    Attributes
    ----------
    columns : structured ndarray, [N]
        A value for each splat of every column that is not of the format.
    comments : tuple of bytes
        Lines of the header that begin with ``comment`` or ``obj_info``, as they were.
    tables : tuple of Table
        Other elements.
    lost : tuple of str
        What had to be left behind on the way to this scene, or may no longer be true of it.
    """

    columns: npt.NDArray[Any]
    comments: tuple[bytes, ...] = ()
    tables: tuple[Table, ...] = ()
    lost: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """The columns by name."""
        return self.columns.dtype.names or ()

    def take(self, source_from_kept: npt.NDArray[np.intp]) -> Extra:
        """Return it for the chosen splats; what names splats by their numbers is left behind if these change."""
        taken = replace(self, columns=self.columns[source_from_kept])
        if np.array_equal(source_from_kept, np.arange(len(self.columns))):
            return taken
        return taken._without_tables_of_splats()

    def of_others(self, count: int, why: str) -> Extra:
        """Return it for ``count`` splats that are not those of the file: without what is about these."""
        lost = (f"{described(self.names, 'column')} left out: {why}",) if self.names else ()
        without = replace(self, columns=np.zeros(count, []), lost=(*self.lost, *lost))
        return without._without_tables_of_splats()

    def turned(self, rotation: npt.NDArray[np.float64]) -> Extra:
        """Return it after the scene was turned: normals are turned along."""
        if not set(NORMALS) <= set(self.names):
            return self.moved()
        columns = self.columns.copy()
        normals = np.stack([columns[name].astype(np.float64) for name in NORMALS], axis=1) @ rotation.T
        for name, values in zip(NORMALS, normals.T, strict=True):
            columns[name] = values
        return replace(self, columns=columns).moved()

    def moved(self) -> Extra:
        """Return it after the scene was moved: what comments say of its place may no longer be true."""
        text = "comments that say where the scene lies were kept as they are, and it was moved"
        stale = any(_PLACE.search(comment) for comment in self.comments) and text not in self.lost
        return replace(self, lost=(*self.lost, text)) if stale else self

    def _without_tables_of_splats(self) -> Extra:
        dropped = [table.name for table in self.tables if table.about_splats]
        if not dropped:
            return self
        text = f"{described(dropped, 'element')} left out: they count splats that are no longer those of the file"
        kept = tuple(table for table in self.tables if not table.about_splats)
        return replace(self, tables=kept, lost=(*self.lost, text))


def joined(extras: Sequence[Extra | None], counts: Sequence[int]) -> Extra | None:
    """Return what scenes of so many splats have together: columns that all have, and what stands for itself."""
    known = [extra for extra in extras if extra]
    if not known:
        return None
    lost = [text for extra in known for text in extra.lost]
    if len(known) == len(extras) and len({extra.columns.dtype for extra in known}) == 1:
        columns = np.concatenate([extra.columns for extra in known])
    else:
        columns = np.zeros(sum(counts), [])
        if names := dict.fromkeys(name for extra in known for name in extra.names):
            lost.append(f"{described(list(names), 'column')} left out: not all joined scenes have them alike")
    comments = dict.fromkeys(line for extra in known for line in extra.comments)
    tables = {table.name: table for extra in known for table in extra.tables if not table.about_splats}
    others = [table.name for extra in known for table in extra.tables if tables.get(table.name) != table]
    if others:
        lost.append(
            f"{described([*dict.fromkeys(others)], 'element')} left out: not all joined scenes have them alike"
        )
    return Extra(columns, tuple(comments), tuple(tables.values()), tuple(lost))


def described(names: Sequence[str], kind: str) -> str:
    """Return names in words, at most a few: 'columns a, b, c, d and 3 more'."""
    shown = [ascii(name)[1:-1][:30] for name in names[:4]]
    more = f" and {len(names) - 4} more" if len(names) > 4 else ""
    return f"{kind}{'s' if len(names) > 1 else ''} {', '.join(shown)}{more}"
