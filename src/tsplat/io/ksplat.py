"""``.ksplat``, the format of the GaussianSplats3D viewer: sections of splats, whole or packed into buckets.

Source: mkkellogg/GaussianSplats3D, ``SplatBuffer``. At levels 1 and 2 a position is 16 bits about the centre of a
bucket, scales and quats are half floats. Colours and opacities are bytes at every level, as in a ``.splat``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from tsplat.errors import CorruptFileError
from tsplat.io.finish import finish
from tsplat.io.ksplat_header import Header, Section, read_header
from tsplat.io.options import LoadOptions
from tsplat.io.splat import check_scales, decode_rgba
from tsplat.scene import SH_COEFFICIENTS, Gaussians

F32 = npt.NDArray[np.float32]
Records = npt.NDArray[np.void]

CHUNK = 1 << 16
"""Splats decoded at a time: few enough to stay in the cache, enough for NumPy."""


def matches(head: bytes) -> bool:  # noqa: ARG001
    """Say that the first bytes tell nothing, those of a font are the same: the suffix has to."""
    return False


def read(path: Path, options: LoadOptions, progress: Callable[[float], None]) -> Gaussians:
    """Read a ``.ksplat`` of any compression level; see `tsplat.io.load` for the parameters.

    Raises
    ------
    LoadError
        It is of a version that is not read here.
    CorruptFileError
        Its headers contradict each other or the size of the file, or a scale is negative.
    """
    # What overflows or is nan is dropped in the end.
    with path.open("rb") as file, np.errstate(over="ignore", invalid="ignore"):
        header = read_header(file, path)
        degree = max((section.sh_degree for section in header.sections), default=0)
        means, quats, scales = (np.empty((header.count, width), np.float32) for width in (3, 4, 3))
        opacities = np.empty(header.count, np.float32)
        sh = np.zeros((header.count, SH_COEFFICIENTS[degree], 3), np.float32)
        done = 0
        for section in header.sections:
            columns = harmonics_columns(section.sh_degree, by_channel=header.by_channel)
            for records, positions in _chunks(file, path, header, section):
                part = slice(done, done + len(records))
                means[part], scales[part], quats[part] = positions, records["scales"], records["quats"]
                opacities[part], sh[part, 0] = decode_rgba(records["rgba"])
                if len(columns):
                    rest = _harmonics(header, records["sh"])[:, columns]
                    sh[part, 1 : 1 + len(columns) // 3] = rest.reshape(len(records), -1, 3)
                done = part.stop
                progress(done / header.count)
        return finish(path, means, quats, scales, opacities, sh, max_splats=options.max_splats)


def harmonics_columns(sh_degree: int, *, by_channel: bool) -> npt.NDArray[np.intp]:
    """Return where a record has the harmonics above degree 0.

    Parameters
    ----------
    sh_degree : int
        0 to 3.
    by_channel : bool
        A record has all of red, then green, then blue; else it has all of degree 1, by channel, then degree 2.

    Returns
    -------
    ndarray of intp, [3 * (K - 1)]
        Columns in the order of `Gaussians`, coefficient by coefficient.
    """
    if by_channel:
        return np.arange(3 * (SH_COEFFICIENTS[sh_degree] - 1)).reshape(3, -1).T.ravel()
    bands = [np.zeros(0, np.intp)]
    for degree in range(1, sh_degree + 1):
        first, last = (3 * (SH_COEFFICIENTS[each] - 1) for each in (degree - 1, degree))
        bands.append(np.arange(first, last).reshape(3, -1).T.ravel())
    return np.concatenate(bands)


def _harmonics(header: Header, values: npt.NDArray[np.generic]) -> F32:
    if header.level < 2:
        return values.astype(np.float32)
    low, high = header.sh_range
    return np.float32(low) + values.astype(np.float32) * np.float32((high - low) / 255.0)


def _chunks(file: BinaryIO, path: Path, header: Header, section: Section) -> Iterator[tuple[Records, F32]]:
    # Yields records, their scales checked, and the means that they stand for.
    size = section.record.itemsize
    ends, centers = _buckets(file, path, section) if header.level else (np.zeros(0, np.int64), np.zeros((0, 3)))
    step = np.float32(section.block / 2.0 / section.steps)
    for first in range(0, section.count, CHUNK):
        offset = section.start + first * size
        records = _array(file, path, section.record, min(CHUNK, section.count - first), offset)
        check_scales(path, records["scales"], offset, section.record, first)
        means = records["means"].astype(np.float32)
        if header.level:
            bucket_from_splat = np.searchsorted(ends, np.arange(first, first + len(records)), side="right")
            means = (means - np.float32(section.steps)) * step + centers[bucket_from_splat]
        yield records, means


def _buckets(file: BinaryIO, path: Path, section: Section) -> tuple[npt.NDArray[np.int64], F32]:
    # Returns the splat at which each bucket ends, and the centres. Full ones come first.
    partial = _array(file, path, np.dtype("<u4"), section.partial_buckets, section.buckets_start)
    offset = section.buckets_start + partial.nbytes
    centers = _array(file, path, np.dtype("<f4"), 3 * section.buckets, offset).reshape(-1, 3)
    full = np.full(section.full_buckets, section.bucket_size, np.int64)
    ends = np.cumsum(np.concatenate([full, partial.astype(np.int64)]))
    held = int(ends[-1]) if len(ends) else 0
    if held < section.count:
        problem = f"buckets: hold {held} splats, expected {section.count}; fetch it again"
        raise CorruptFileError(path, problem, section.buckets_start)
    return ends, centers


def _array(file: BinaryIO, path: Path, dtype: np.dtype[Any], count: int, offset: int) -> npt.NDArray[Any]:
    file.seek(offset)
    array = np.fromfile(file, dtype, count)
    if len(array) < count:  # the headers were checked, so it was cut just now
        problem = f"contents: end after {array.nbytes} bytes, expected {count * dtype.itemsize}; fetch it again"
        raise CorruptFileError(path, problem, offset)
    return array
