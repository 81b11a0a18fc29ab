""".tsplat, a scene with its levels of detail, laid out as it is drawn: written, and read back whole.

docs/tsplat-format.md describes the layout, which is our own; `tsplat.lod.stored` draws such a file without reading
it whole.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from tsplat.errors import CorruptFileError, SceneError
from tsplat.importance import importance, most_important
from tsplat.io.options import LoadOptions
from tsplat.io.tsplat_header import (
    OPTIONAL,
    Counts,
    Header,
    Section,
    header_bytes,
    nbytes_of,
    next_section,
    packed,
)
from tsplat.io.tsplat_map import Array, Opened, matches, open_file
from tsplat.scene import Gaussians, Vector

__all__ = ["matches", "read", "write"]

F32 = npt.NDArray[np.float32]

CHUNK = 1 << 16
"""Splats whose harmonics are unpacked at a time, whole blocks."""

LENGTH_ERROR = 1e-4
"""By how much the squared length of a quat may differ from 1: a hundred times what float32 makes of it."""

READING = 0.7
"""The share that checking the file has in all there is to do: most of the time goes into fetching it."""


def read(path: Path, options: LoadOptions, progress: Callable[[float], None]) -> Gaussians:
    """Read the finest level of a .tsplat; see `tsplat.io.load` for the parameters.

    Raises
    ------
    LoadError
        It is of another version.
    CorruptFileError
        Header, checksums and contents contradict each other, or the file ends early.
    """
    opened = open_file(path)
    whole, done = sum(section.nbytes for section in opened.header.sections.values()), 0

    def heard(nbytes: int) -> None:
        nonlocal done
        done += nbytes
        progress(READING * done / whole)

    for name in opened.header.counts.arrays:
        opened.check(name, heard)
    gaussians = _scene(opened, lambda fraction: progress(READING + (1.0 - READING) * fraction))
    if options.max_splats is not None and options.max_splats < len(gaussians):
        scores = importance(gaussians.scales, gaussians.opacities)
        gaussians = gaussians.take(np.flatnonzero(most_important(scores, options.max_splats)))
    progress(1.0)
    return gaussians


def sample(opened: Opened) -> Gaussians:
    """Return some splats of a scene, without harmonics: what `tsplat.framing` needs to know of all of them.

    Raises
    ------
    CorruptFileError
        They are not what their checksums say, or form no scene.
    """
    names = ("sample_means", "sample_quats", "sample_scales", "sample_opacities")
    for name in names:
        opened.check(name)
    means, quats, scales, opacities = map(opened.part, names)
    sh = np.zeros((len(opacities), 1, 3), np.float32)
    return _checked(opened, means.reshape(-1, 3), quats.reshape(-1, 4), scales.reshape(-1, 3), opacities, sh)


def _scene(opened: Opened, progress: Callable[[float], None]) -> Gaussians:
    n, padded = opened.header.counts.splats, opened.header.counts.padded
    means = np.empty((n, 3), np.float32)
    for axis in range(3):
        means[:, axis] = opened.part("means", axis * padded, axis * padded + n)
    return _checked(
        opened,
        means,
        opened.part("quats").reshape(-1, 4),
        opened.part("scales").reshape(-1, 3),
        opened.part("opacities"),
        _harmonics(opened, progress),
    )


def _harmonics(opened: Opened, progress: Callable[[float], None]) -> F32:
    """Return the harmonics of the finest level, which lie by eight splats, coefficient, channel, splat."""
    n, coefficients = opened.header.counts.splats, opened.header.counts.coefficients
    sh = np.empty((n, 1 + coefficients, 3), np.float32)
    sh[:, 0] = opened.part("sh_first").reshape(-1, 3)
    if coefficients:
        values = 3 * coefficients
        for first in range(0, n, CHUNK):
            end = min(first + CHUNK, n)
            eights = opened.part("sh_rest", first * values, -(-end // 8) * 8 * values).view(np.float16)
            part = eights.reshape(-1, coefficients, 3, 8).transpose(0, 3, 1, 2).reshape(-1, coefficients, 3)
            sh[first:end, 1:] = part[: end - first]
            progress(end / n)
    return sh


def _checked(opened: Opened, means: F32, quats: F32, scales: F32, opacities: F32, sh: F32) -> Gaussians:
    # The quats are of unit length; dividing by it once more would change their last bits, and the picture's.
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            about = opened.header.antialiased, _vector(opened, "up"), _vector(opened, "origin")
            gaussians = Gaussians(means, quats, scales, opacities, sh, *about)
            if not (np.abs(np.einsum("ij,ij->i", quats, quats) - 1.0) < LENGTH_ERROR).all():
                raise SceneError("quats must be of unit length")
            return gaussians
    except SceneError as error:
        raise CorruptFileError(opened.path, f"{error}; make the file again with tsplat optimize") from error


def _vector(opened: Opened, name: str) -> Vector | None:
    if name not in opened.header.sections:
        return None
    opened.check(name)
    x, y, z = opened.part(name).tolist()
    return x, y, z


def write(file: BinaryIO, counts: Counts, antialiased: bool, arrays: Mapping[str, Iterable[Array]]) -> None:
    """Write a file, the header last: its checksum is right only when all is there.

    Parameters
    ----------
    file : binary file
        Open for writing, empty, one that can be gone back in.
    counts : Counts
        How much there is.
    antialiased : bool
        As in `Gaussians`.
    arrays : mapping of str to iterable of ndarray
        The pieces of each of ``counts.arrays``, and maybe some of `OPTIONAL`.
    """
    from isal import isal_zlib

    kinds = counts.arrays | {name: kind for name, kind in OPTIONAL.items() if name in arrays}
    sections, end = {}, header_bytes(len(kinds))
    for name, (dtype, length) in kinds.items():
        offset, checksum, nbytes = next_section(end), 0, 0
        file.seek(offset)
        for piece in arrays[name]:
            raw = np.ascontiguousarray(piece, dtype).reshape(-1).view(np.uint8).data
            checksum = isal_zlib.crc32(raw, checksum)
            nbytes += file.write(raw)
        assert nbytes == nbytes_of(dtype, length), f"{name}: {nbytes} bytes"
        sections[name], end = Section(offset, nbytes, checksum), offset + nbytes
    file.truncate(end)  # sections without anything at the end
    file.seek(0)
    file.write(packed(Header(counts, antialiased, sections)))
