"""``.splat``: 32 bytes a splat and nothing else: no header, no magic, no view-dependent colours.

Source: antimatter15/splat, whose ``convert.py`` set the record: position and linear scales in float32, then
red, green, blue and opacity, then ``wxyz`` of the quat, a byte each. 128 is a zero of the quat, one is 128 more.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from tsplat.errors import CorruptFileError
from tsplat.io.arrays import F32, Arrays, chunks
from tsplat.io.finish import finish
from tsplat.io.losses import colors_cut
from tsplat.io.options import LoadOptions
from tsplat.io.threads import on_threads
from tsplat.scene import SH_C0, Gaussians

U8 = npt.NDArray[np.uint8]
Records = npt.NDArray[np.void]

RECORD = np.dtype([("means", "<f4", 3), ("scales", "<f4", 3), ("rgba", "u1", 4), ("quats", "u1", 4)])


SAMPLES = 1024
LEAST, FARTHEST, UNIT = 1e-12, 1e7, 0.1
MOSTLY = 0.9
"""What `is_splat` asks of how many records: bytes of something else are hardly ever so."""

QUAT_STEPS = np.float32(128.0)

OPACITIES = np.arange(256, dtype=np.float32) / np.float32(255.0)
COLORS = (OPACITIES - np.float32(0.5)) / np.float32(SH_C0)
"""What a byte stands for."""


def matches(head: bytes) -> bool:  # noqa: ARG001
    """Say that the first bytes tell nothing: the suffix has to."""
    return False


def is_splat(path: Path) -> bool:
    """Tell whether a file of an unknown name holds records all through: finite, of sane sizes, with unit quats."""
    count, rest = divmod(path.stat().st_size, RECORD.itemsize)
    if rest or not count:
        return False
    return _are_sane(np.memmap(path, RECORD, "r", shape=(count,))[:: -(-count // SAMPLES)])


def may_be_splat(head: bytes) -> bool:
    """Tell the same of a file that begins with these bytes."""
    return _are_sane(np.frombuffer(head, RECORD, len(head) // RECORD.itemsize))


def _are_sane(records: Records) -> bool:
    with np.errstate(all="ignore"):
        means, scales = np.abs(records["means"]), records["scales"]
        lengths = np.linalg.norm((records["quats"] - QUAT_STEPS) / QUAT_STEPS, axis=1)
        good = np.all((means == 0.0) | ((means > LEAST) & (means < FARTHEST)), axis=1)
        good &= np.all((scales == 0.0) | ((scales > LEAST) & (scales < FARTHEST)), axis=1)
        good &= np.abs(lengths - 1.0) < UNIT
    return bool(np.count_nonzero(good) > MOSTLY * len(good))


def read(path: Path, options: LoadOptions, progress: Callable[[float], None]) -> Gaussians:
    """Read a ``.splat``; see `tsplat.io.load` for the parameters.

    Raises
    ------
    CorruptFileError
        It is no whole number of records, or a scale is negative.
    """
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        if size % RECORD.itemsize:
            problem = f"size: {size} bytes, expected a multiple of {RECORD.itemsize}; fetch it again"
            raise CorruptFileError(path, problem, size - size % RECORD.itemsize)
        count = size // RECORD.itemsize
        arrays = Arrays.empty(count, 1)

        def pieces() -> Iterator[tuple[slice, Records]]:
            for rows in chunks(count):
                records = np.fromfile(file, RECORD, rows.stop - rows.start)
                if len(records) < rows.stop - rows.start:
                    problem = f"records: ends after {rows.start + len(records)}, expected {count}; fetch it again"
                    raise CorruptFileError(path, problem, file.tell())
                check_scales(path, records["scales"], rows.start * RECORD.itemsize, RECORD, rows.start)
                yield rows, records
                progress(rows.stop / count)

        def decode(piece: tuple[slice, Records]) -> None:
            rows, records = piece
            out = arrays.part(rows)
            out.means[:], out.scales[:] = records["means"], records["scales"]
            np.subtract(records["quats"], QUAT_STEPS, out=out.quats)
            decode_rgba(records["rgba"], out)

        on_threads(decode, pieces())
    return finish(path, *arrays, max_splats=options.max_splats)


def write(file: BinaryIO, gaussians: Gaussians) -> list[str]:
    """Write a ``.splat`` in the order of the scene, each value rounded to the nearest that a byte can hold.

    What colours change with the view is left out, and a colour is cut to 0 to 1.
    """
    for part in chunks(len(gaussians)):
        records = np.empty(len(gaussians.means[part]), RECORD)
        records["means"], records["scales"] = gaussians.means[part], gaussians.scales[part]
        records["rgba"][:, :3] = _bytes((0.5 + SH_C0 * gaussians.sh[part, 0]) * 255.0)
        records["rgba"][:, 3] = _bytes(gaussians.opacities[part] * 255.0)
        records["quats"] = _bytes((gaussians.quats[part] + 1.0) * QUAT_STEPS)
        file.write(records.tobytes())
    return colors_cut(gaussians, slice(1), 0.5 / SH_C0, "colours outside of 0 to 1")


def decode_rgba(rgba: U8, out: Arrays) -> None:
    """Fill opacities and the first coefficient of the colours from uint8 [N, 4]."""
    np.take(OPACITIES, rgba[:, 3], out=out.opacities, mode="clip")
    out.sh[:, 0] = np.take(COLORS, rgba[:, :3], mode="clip")


def check_scales(path: Path, scales: F32, offset: int, record: np.dtype[np.void], index: int) -> None:
    """Refuse a negative scale, which no encoder writes: the bytes are something else.

    Parameters
    ----------
    path : Path
        The file, for the error.
    scales : ndarray of float32, [N, 3]
        As the file has them; nan is let through.
    offset : int
        Byte of the first of their records in the file.
    record : dtype
        Of one splat in the file.
    index : int
        Of the first of these splats.

    Raises
    ------
    CorruptFileError
        A scale is below zero.
    """
    negative = scales < 0.0
    if negative.any():
        row = int(negative.any(axis=1).argmax())
        problem = f"scale of splat {index + row}: {scales[row].min():.6g}, expected 0 or more; fetch it again"
        raise CorruptFileError(path, problem, offset + row * record.itemsize)


def _bytes(values: F32) -> U8:
    return np.rint(np.clip(values, 0.0, 255.0)).astype(np.uint8)
