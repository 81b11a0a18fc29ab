"""What may come of opening a file, whoever made it: a sound scene, or one line that says what is wrong."""

from __future__ import annotations

import resource
import tracemalloc
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from tsplat import io
from tsplat.errors import LoadError, LoadWarning
from tsplat.scene import Gaussians

T = TypeVar("T")

LINE_CHARS = 600
"""Longer lines are no message any more; only the names of all formats take so much."""

SPARE_BYTES = 8 << 20
"""Buffers and tables of fixed size that a reader has beside what it reads."""

OPTIONS: tuple[dict[str, Any], ...] = (
    *({}, {"max_splats": 2}, {"raw_opacity": True}),
    {"max_splats": 1000, "spz_frame": "rdf", "lod": None, "extra": True},
)
"""What may be asked of `load` for any file."""


@contextmanager
def limited_growth(most: int) -> Iterator[None]:
    """Let the process grow by so many bytes at most, where the system says how large it is."""
    statm = Path("/proc/self/statm")
    limits = resource.getrlimit(resource.RLIMIT_AS)
    if statm.exists():
        pages = int(statm.read_text().split()[0])
        resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + most, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)


def outcome(path: Path, **options: Any) -> Gaussians | None:
    """Return the scene of a file, or None where it is refused; anything else fails."""
    gaussians = read_or_refused(path, lambda: io.load(path, **options))
    if gaussians is not None:
        # `Gaussians` checks shapes and ranges itself; that quats are unit is its readers' word.
        lengths = np.linalg.norm(gaussians.quats.astype(np.float64), axis=1)
        assert np.all(np.abs(lengths - 1.0) < 1e-4), lengths
    return gaussians


def read_or_refused(path: Path, read: Callable[[], T]) -> T | None:
    """Return what was read from a file, or None where one printable line says why not; anything else fails."""
    found, lines = None, []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            found = read()
        except LoadError as error:
            lines.append(str(error))
    assert {warning.category for warning in caught} <= {LoadWarning}, [str(each.message) for each in caught]
    for line in lines + [str(warning.message) for warning in caught]:
        assert line.isprintable(), line
        assert path.name in line or path.parent.name in line, line
        assert len(line) < LINE_CHARS + len(str(path)), line
        assert "more memory than there is" not in line, "memory was asked for before the file was checked"
    return found


def within_memory(path: Path, honest_bytes: int, **options: Any) -> Gaussians | None:
    """Do the same, and require that it takes no more memory than four times an honest scene.

    `tracemalloc` sees what Python and NumPy allocate, used or not, but nothing in Pillow.
    """
    tracemalloc.start()
    try:
        gaussians = outcome(path, **options)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    largest = max(honest_bytes, gaussians.nbytes if gaussians else 0)
    assert peak <= 4 * largest + SPARE_BYTES, f"{peak} bytes for a scene of {largest}"
    return gaussians
