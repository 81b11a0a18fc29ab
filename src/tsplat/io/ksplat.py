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
from tsplat.io.arrays import F32, Arrays, chunks
from tsplat.io.finish import finish
from tsplat.io.ksplat_header import Header, Section, read_header
from tsplat.io.options import LoadOptions
from tsplat.io.splat import check_scales, decode_rgba
from tsplat.io.threads import on_threads
from tsplat.scene import SH_COEFFICIENTS, Gaussians

Records = npt.NDArray[np.void]
Piece = tuple[slice, Section, Records, F32]

NO_ENDS, ORIGIN = np.zeros(0, np.int64), np.zeros((1, 3), np.float32)
"""Where buckets end, and their centres, in a file without any."""


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
    with path.open("rb") as file:
        header = read_header(file, path)
        degree = max((section.sh_degree for section in header.sections), default=0)
        arrays = Arrays.empty(header.count, SH_COEFFICIENTS[degree])

        def decode(piece: Piece) -> None:
            rows, section, records, centers = piece
            _decode(header, section, records, centers, arrays.part(rows))

        on_threads(decode, _pieces(file, path, header, progress))
    return finish(path, *arrays, max_splats=options.max_splats)


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


def _pieces(file: BinaryIO, path: Path, header: Header, progress: Callable[[float], None]) -> Iterator[Piece]:
    # Yields where splats will be, their section, their records, and the centres of their buckets or zero.
    done = 0
    for section in header.sections:
        packed = header.level and section.count  # the buckets of no splats were not checked
        ends, centers = _buckets(file, path, section) if packed else (NO_ENDS, ORIGIN)
        for rows in chunks(section.count):
            offset = section.start + rows.start * section.record.itemsize
            records = _array(file, path, section.record, rows.stop - rows.start, offset)
            check_scales(path, records["scales"], offset, section.record, rows.start)
            buckets = np.searchsorted(ends, np.arange(rows.start, rows.stop), side="right")
            yield slice(done, done + len(records)), section, records, centers[buckets]
            done += len(records)
            progress(done / header.count)


def _decode(header: Header, section: Section, records: Records, centers: F32, out: Arrays) -> None:
    out.means[:], out.scales[:], out.quats[:] = records["means"], records["scales"], records["quats"]
    if header.level:
        np.subtract(out.means, np.float32(section.steps), out=out.means)
        np.multiply(out.means, np.float32(section.block / 2.0 / section.steps), out=out.means)
        np.add(out.means, centers, out=out.means)
    decode_rgba(records["rgba"], out)
    rest = out.sh.reshape(len(records), -1)[:, 3:]
    columns = harmonics_columns(section.sh_degree, by_channel=header.by_channel)
    rest[:, len(columns) :] = 0.0
    if len(columns):
        found = rest[:, : len(columns)]
        found[:] = np.take(records["sh"], columns, axis=1, mode="clip")
        if header.level == 2:
            low, high = header.sh_range
            np.multiply(found, np.float32((high - low) / 255.0), out=found)
            np.add(found, np.float32(low), out=found)


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
