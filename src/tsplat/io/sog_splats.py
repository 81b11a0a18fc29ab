"""One SOG scene becomes arrays: every plane read, every table looked up.

Source: the SOG specification on developer.playcanvas.com.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt

from tsplat.io.arrays import F32, Arrays, chunks
from tsplat.io.finish import make_unit
from tsplat.io.smallest_three import BY_COMPONENT, fill_quats
from tsplat.io.sog_files import Files
from tsplat.io.sog_meta import LEVELS, PALETTE_MAX, Meta, Palette
from tsplat.io.sog_planes import SPARE_PIXELS, U8, plane_size, read_plane
from tsplat.io.threads import on_threads

U16 = npt.NDArray[np.uint16]
Mask = npt.NDArray[np.bool_]
Fill = Callable[[slice], None]
"""Fills some rows of an array from planes that were read."""

ROW_CENTROIDS = 64
"""So many centroids lie side by side in their plane."""

COEFFICIENTS = (0, 3, 8, 15)
"""How many coefficients a centroid has for each SH degree."""

QUAT_TAG = 252
"""The fourth byte of a quat, less this, tells which of wxyz is the largest and left out."""

SPLATS_A_BYTE = 16
"""Means in disorder take about three bytes each; an image that holds so many more in one is a trap."""

# splat-transform cuts to whole steps where it could round, half a step down on average. Every viewer
# shows it so, and other writers round: the specification's value is taken.
SMALL = (np.arange(LEVELS, dtype=np.float32) / np.float32(255.0) - np.float32(0.5)) * np.float32(np.sqrt(2.0))
"""What a byte of a quat stands for."""


def check_count(files: Files, meta: Meta) -> int:
    """Return how many splats are more than honest means of so many bytes hold.

    Raises
    ------
    CorruptFileError
        There are too few bytes.
    """
    size = files.size(meta.means_l)
    unpaid = max(0, meta.count - SPLATS_A_BYTE * size)
    if unpaid > SPARE_PIXELS:
        problem = f"holds {size} bytes, expected at least {meta.count // SPLATS_A_BYTE} for {meta.count} splats"
        raise files.corrupt(meta.means_l, problem)
    return unpaid


def count_coefficients(files: Files, meta: Meta) -> int:
    """Return how many coefficients a colour has, the first one included.

    Raises
    ------
    CorruptFileError
        The plane of the palette has no width that is known.
    """
    return 1 + (_palette_width(files, meta.palette) if meta.palette else 0)


def read_splats(
    files: Files, meta: Meta, wanted: Mask | None, out: Arrays, progress: Callable[[float], None]
) -> bool:
    """Read the splats of a scene, with unit quats, and tell whether all can be drawn: no table holds nan or inf.

    Parameters
    ----------
    files : Files
        Where its planes are.
    meta : Meta
        What they mean.
    wanted : ndarray of bool, [meta.count], optional
        Which splats; all by default.
    out : Arrays
        Where to; coefficients beyond those of the scene become 0.
    progress : callable
        Called with the fraction done; what is left is for `tsplat.io.finish.finish`.

    Raises
    ------
    CorruptFileError
        A plane is broken, too small, or names what its table does not hold.
    """
    planes = _Planes(files, meta.count, wanted)
    parts = list(chunks(len(out.means)))
    fills: list[Fill] = []

    def read(step: Step) -> None:
        fills.append(step(planes, meta, out))

    def work() -> Iterator[tuple[Fill, slice]]:
        while fills:  # and their planes, which are not needed any more when they are done
            fill = fills.pop()
            for done, rows in enumerate(parts):
                yield fill, rows
                progress(1.0 - (len(fills) + 1 - done / len(parts)) / (len(STEPS) + 1))

    on_threads(read, STEPS)
    on_threads(lambda item: item[0](item[1]), work())
    return planes.finite


class _Planes:
    """The planes of which each pixel is a splat."""

    def __init__(self, files: Files, count: int, wanted: Mask | None) -> None:
        self.files, self._count, self._wanted = files, count, wanted
        self.finite = True
        """Whether all tables hold numbers that are neither nan nor inf."""

    def table(self, values: npt.NDArray[np.floating]) -> F32:
        """Return what the values of planes stand for, in float32."""
        with np.errstate(over="ignore"):
            table = values.astype(np.float32)
        if not np.isfinite(table).all():
            self.finite = False
        return table

    def read(self, name: str, check: Callable[[str, U8], None] = lambda *_: None) -> U8:
        """Return the pixels of wanted splats, uint8 [N, 4], after a check of all."""
        pixels = read_plane(self.files, name, self._count).reshape(-1, 4)[: self._count]
        check(name, pixels)
        return pixels if self._wanted is None else pixels[self._wanted]

    def check_entries(self, name: str, entries: npt.NDArray[np.integer], count: int) -> None:
        """Refuse what names an entry beyond those of its table."""
        if entries.size and (largest := int(entries.max())) >= count:
            raise self.files.corrupt(name, f"names entry {largest} of {count}, expected less")


def _means(planes: _Planes, meta: Meta, out: Arrays) -> Fill:
    low, high = planes.read(meta.means_l), planes.read(meta.means_u)
    steps = np.arange(1 << 16) / 0xFFFF
    tables = []
    with np.errstate(over="ignore", invalid="ignore"):
        for least, most in zip(meta.mins, meta.maxs, strict=True):
            logs = least * (1.0 - steps) + most * steps
            tables.append(planes.table(np.sign(logs) * np.expm1(np.abs(logs))))

    def fill(rows: slice) -> None:
        for axis, table in enumerate(tables):
            out.means[rows, axis] = np.take(table, _word(low[rows, axis], high[rows, axis]), mode="clip")

    return fill


def _quats(planes: _Planes, meta: Meta, out: Arrays) -> Fill:
    def check(name: str, pixels: U8) -> None:
        if len(pixels) and (least := int(pixels[:, 3].min())) < QUAT_TAG:
            raise planes.files.corrupt(name, f"has a fourth byte of {least}, expected {QUAT_TAG} to 255")

    pixels = planes.read(meta.quats, check)

    def fill(rows: slice) -> None:
        small = np.take(SMALL, pixels[rows, :3], mode="clip")
        fill_quats(small, pixels[rows, 3] - QUAT_TAG, BY_COMPONENT, out.quats[rows])
        make_unit(out.quats[rows])

    return fill


def _scales(planes: _Planes, meta: Meta, out: Arrays) -> Fill:
    with np.errstate(over="ignore"):
        table = planes.table(np.exp(meta.scale_values.astype(np.float32)))
    pixels = planes.read(meta.scales, _three_of(planes, table))
    return lambda rows: _look_up(table, pixels[rows], out.scales[rows])


def _colors(planes: _Planes, meta: Meta, out: Arrays) -> Fill:
    table, opacities = planes.table(meta.sh0_values), planes.table(meta.opacity_values)
    pixels = planes.read(meta.sh0, _three_of(planes, table))
    fill_rest = _rest(planes, meta.palette, out) if meta.palette else None

    def fill(rows: slice) -> None:
        if fill_rest:
            fill_rest(rows)
        else:
            out.sh[rows, 1:] = 0.0
        _look_up(table, pixels[rows], out.sh[rows, 0])
        np.take(opacities, pixels[rows, 3], out=out.opacities[rows], mode="clip")

    return fill


Step = Callable[[_Planes, Meta, Arrays], Fill]

STEPS: tuple[Step, ...] = _means, _colors, _quats, _scales
"""Those that take longest come first."""


def _three_of(planes: _Planes, table: F32) -> Callable[[str, U8], None]:
    return lambda name, pixels: planes.check_entries(name, pixels[:, :3], table.shape[1])


def _look_up(table: F32, pixels: U8, out: F32) -> None:
    for channel in range(3):
        out[:, channel] = np.take(table[channel], pixels[:, channel], mode="clip")


def _rest(planes: _Planes, palette: Palette, out: Arrays) -> Fill:
    centroids = _centroids(planes, palette, out.sh.shape[1])

    def check(name: str, pixels: U8) -> None:
        planes.check_entries(name, _word(pixels[:, 0], pixels[:, 1]), len(centroids))

    pixels = planes.read(palette.labels, check)

    def fill(rows: slice) -> None:
        labels = _word(pixels[rows, 0], pixels[rows, 1])
        np.take(centroids, labels, axis=0, out=out.sh[rows], mode="clip")

    return fill


def _word(low: U8, high: U8) -> U16:
    return low | high.astype(np.uint16) << np.uint16(8)


def _centroids(planes: _Planes, palette: Palette, k: int) -> F32:
    # The palette, [n, k, 3], with room for the first coefficient; others that it does not have are 0.
    name = palette.centroids
    plane = read_plane(planes.files, name, *_palette_pixels(palette))
    width = plane.shape[1] // ROW_CENTROIDS
    held = len(plane) * ROW_CENTROIDS
    count = min(held if palette.count is None else palette.count, PALETTE_MAX)
    entries = plane[..., :3].reshape(held, width, 3)[:count]
    planes.check_entries(name, entries, len(palette.values))
    centroids = np.zeros((count, k, 3), np.float32)
    values = planes.table(palette.values)
    for rows in chunks(count):
        centroids[rows, 1 : 1 + width] = np.take(values, entries[rows], mode="clip")
    return centroids


def _palette_pixels(palette: Palette) -> tuple[int, int]:
    # Without a count or bands in the file, the most that a label can name; the plane says how many there are.
    rows = -(-(PALETTE_MAX if palette.count is None else palette.count) // ROW_CENTROIDS)
    widest = ROW_CENTROIDS * COEFFICIENTS[3 if palette.bands is None else palette.bands]
    exact = palette.count is not None and palette.bands is not None
    return rows * widest if exact else 0, rows * widest


def _palette_width(files: Files, palette: Palette) -> int:
    width, _ = plane_size(files, palette.centroids, *_palette_pixels(palette))
    k, odd = divmod(width, ROW_CENTROIDS)
    known = COEFFICIENTS[1:] if palette.bands is None else (COEFFICIENTS[palette.bands],)
    if odd or k not in known:
        expected = " or ".join(str(ROW_CENTROIDS * each) for each in known)
        raise files.corrupt(palette.centroids, f"is {width} pixels wide, expected {expected}")
    return k
