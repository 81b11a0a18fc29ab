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
from tsplat.io.tsplat_map import Array, Mapped, matches, open_mapped
from tsplat.scene import Gaussians, Vector

__all__ = ["matches", "read", "write"]

F32 = npt.NDArray[np.float32]

CHUNK = 1 << 16
"""Splats whose harmonics are unpacked at a time, whole blocks."""

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
    mapped = open_mapped(path)
    whole, done = sum(section.nbytes for section in mapped.header.sections.values()), 0

    def heard(nbytes: int) -> None:
        nonlocal done
        done += nbytes
        progress(READING * done / whole)

    for name in mapped.arrays:
        mapped.check(name, heard)
    gaussians = _scene(mapped, lambda fraction: progress(READING + (1.0 - READING) * fraction))
    if options.max_splats is not None and options.max_splats < len(gaussians):
        scores = importance(gaussians.scales, gaussians.opacities)
        gaussians = gaussians.take(np.flatnonzero(most_important(scores, options.max_splats)))
    progress(1.0)
    return gaussians


def sample(mapped: Mapped) -> Gaussians:
    """Return some splats of a scene, without harmonics: what `tsplat.framing` needs to know of all of them.

    Raises
    ------
    CorruptFileError
        They are not what their checksums say, or form no scene.
    """
    names = ("sample_means", "sample_quats", "sample_scales", "sample_opacities")
    for name in names:
        mapped.check(name)
    means, quats, scales, opacities = (mapped.arrays[name].copy() for name in names)
    sh = np.zeros((len(opacities), 1, 3), np.float32)
    return _checked(mapped, means.reshape(-1, 3), quats.reshape(-1, 4), scales.reshape(-1, 3), opacities, sh)


def _scene(mapped: Mapped, progress: Callable[[float], None]) -> Gaussians:
    arrays, n = mapped.arrays, mapped.header.counts.splats
    return _checked(
        mapped,
        np.ascontiguousarray(arrays["means"].reshape(3, -1)[:, :n].T),
        arrays["quats"].reshape(-1, 4).copy(),
        arrays["scales"].reshape(-1, 3).copy(),
        arrays["opacities"].copy(),
        _harmonics(mapped, progress),
    )


def _harmonics(mapped: Mapped, progress: Callable[[float], None]) -> F32:
    """Return the harmonics of the finest level, which lie by eight splats, coefficient, channel, splat."""
    n, coefficients = mapped.header.counts.splats, mapped.header.counts.coefficients
    sh = np.empty((n, 1 + coefficients, 3), np.float32)
    sh[:, 0] = mapped.arrays["sh_first"].reshape(-1, 3)
    if coefficients:
        eights = mapped.arrays["sh_rest"].view(np.float16).reshape(-1, coefficients, 3, 8)
        for first in range(0, n, CHUNK):
            part = eights[first // 8 : (first + CHUNK) // 8].transpose(0, 3, 1, 2).reshape(-1, coefficients, 3)
            end = min(first + CHUNK, n)
            sh[first:end, 1:] = part[: end - first]
            progress(end / n)
    return sh


def _checked(mapped: Mapped, means: F32, quats: F32, scales: F32, opacities: F32, sh: F32) -> Gaussians:
    # The quats are of unit length; dividing by it once more would change their last bits, and the picture's.
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            about = mapped.header.antialiased, _vector(mapped, "up"), _vector(mapped, "origin")
            return Gaussians(means, quats, scales, opacities, sh, *about)
    except SceneError as error:
        raise CorruptFileError(mapped.path, f"{error}; make the file again with tsplat optimize") from error


def _vector(mapped: Mapped, name: str) -> Vector | None:
    if name not in mapped.arrays:
        return None
    mapped.check(name)
    x, y, z = mapped.arrays[name].tolist()
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
