"""A scene that stays on disk: its levels of detail are read where they are drawn, see `tsplat.io.tsplat_map`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from tsplat import given
from tsplat.errors import CorruptFileError, LoadError
from tsplat.framing import SAMPLE
from tsplat.given import whole
from tsplat.io import tsplat_file
from tsplat.io.tsplat_header import Counts
from tsplat.io.tsplat_map import Array, Mapped, open_mapped
from tsplat.lod.hierarchy import Hierarchy, binary_tree, build, level_firsts
from tsplat.lod.kd import Order, kd_order
from tsplat.raster.buffers import Buffers
from tsplat.raster.prepare import Prepared
from tsplat.scene import SH_COEFFICIENTS, Gaussians, a_scene

CHUNK = 1 << 16
"""Splats brought into order at a time."""

BUILDING = 0.9
"""Of the time that storing takes, what passes before the file is written."""


@dataclass(frozen=True, eq=False, slots=True)
class Stored:
    """A scene with the levels of detail that its file has: an open .tsplat, or see `tsplat.lod.streamed`.

    Attributes
    ----------
    tree : Hierarchy
        All levels; those of a .tsplat in memory that is read from the file when it is looked at.
    sample : Gaussians
        Some splats without harmonics: enough to say where the scene is and which way is up in it.
    splats : int
        In the scene.
    antialiased : bool
        As in `Gaussians`.
    mapped : Mapped, optional
        The .tsplat.
    """

    tree: Hierarchy
    sample: Gaussians
    splats: int
    antialiased: bool
    mapped: Mapped | None

    def __len__(self) -> int:
        return self.splats

    @property
    def sh_degree(self) -> int:
        """Degree of the spherical harmonics that are stored, 0 to 4."""
        return SH_COEFFICIENTS.index(1 + self.tree.scene.coefficients)

    @property
    def sampled(self) -> int:
        """How many splats the sample is of."""
        return self.splats

    @property
    def finest(self) -> npt.NDArray[np.int32]:
        """The blocks that are the scene itself."""
        return self.tree.finest

    @property
    def complete(self) -> bool:
        """Whether all of it can be drawn, not only the coarser levels."""
        return True

    def read_rest(self, progress: Callable[[float], None] = lambda _: None) -> None:
        """Do nothing: all of it is there."""

    def let_go(self) -> None:
        """Hold neither what was read so far nor what frames share: the next one is slower, the process small."""
        assert self.mapped
        scene = self.tree.scene
        with scene.lock:
            scene.buffers, scene.last_frame, scene.last_size, scene.train_depths = Buffers(), None, (), None
        self.mapped.let_go()


def open_stored(path: str | Path) -> Stored:
    """Open a .tsplat file, in the same time whatever its size.

    Raises
    ------
    LoadError
        It cannot be read, or is of another version.
    CorruptFileError
        What its header says contradicts itself or the size of the file. What else is wrong in it is seen in the
        picture; `tsplat.load` and `tsplat info` compare all of it with its checksums.
    """
    path = given.path(path)
    try:
        # Pipes and devices would keep a reader waiting.
        if path.exists() and not path.is_file():
            raise LoadError(path, "is a folder or a device, expected a .tsplat; give the path of one")
        mapped = open_mapped(path)
    except OSError as error:
        raise LoadError(path, f"cannot be read: {error.strerror or error}; check the path") from error
    counts = mapped.header.counts
    return Stored(tree_of(mapped), tsplat_file.sample(mapped), counts.splats, mapped.header.antialiased, mapped)


def tree_of(mapped: Mapped) -> Hierarchy:
    """Return the hierarchy in an open file.

    Raises
    ------
    CorruptFileError
        Its blocks are no tree: kernels find their way by the number of splats alone.
    """
    counts, arrays = mapped.header.counts, mapped.arrays
    firsts = level_firsts(counts.splats)
    if firsts[-1] != counts.blocks:
        problem = f"has {counts.blocks} blocks of {counts.splats} splats, expected {firsts[-1]}; fetch it again"
        raise CorruptFileError(mapped.path, problem, 24)
    scene = Prepared(
        means=arrays["means"],
        covars=arrays["covars"],
        log2_opacities=arrays["log2_opacities"],
        base_colors=arrays["base_colors"],
        sh_rest=arrays["sh_rest"],
        coefficients=counts.coefficients,
        bounds=arrays["bounds"],
        blocks=np.arange(counts.blocks, dtype=np.int32),
        quats=arrays["quats"],
        scales=arrays["scales"],
    )
    tree = binary_tree(firsts, scene, arrays["sizes"], arrays["errors"], arrays["solidities"])
    tree.check = mapped.check_size
    return tree


def store(file: BinaryIO, gaussians: Gaussians, threads: int, progress: Callable[[float], None]) -> None:
    """Build the levels of detail of a scene and write them, and the scene itself, as a .tsplat.

    Parameters
    ----------
    file : binary file
        Open for writing, empty, one that can be gone back in.
    gaussians : Gaussians
        At least one splat.
    threads : int
        How many work at it.
    progress : callable
        Called with the fraction done.
    """
    threads = whole("threads", threads, 1, 1024)
    order = kd_order(a_scene(gaussians).means, threads)
    tree = build(gaussians, threads, lambda fraction: progress(BUILDING * fraction), order)
    write_tree(file, gaussians, tree, order)
    progress(1.0)


def counts_of(gaussians: Gaussians) -> Counts:
    """Return how much the .tsplat of a scene holds."""
    n = len(gaussians)
    sampled = -(-n // (1 + n // SAMPLE))
    return Counts(n, int(level_firsts(n)[-1]), gaussians.sh.shape[1] - 1, sampled)


def write_tree(file: BinaryIO, gaussians: Gaussians, tree: Hierarchy, order: Order) -> None:
    """Write a scene in this order, and its levels of detail, as a .tsplat; see `store`."""
    scene, sampled = tree.scene, slice(None, None, 1 + len(gaussians) // SAMPLE)

    def ordered(array: Array) -> Iterator[Array]:
        return (array[order[first : first + CHUNK]] for first in range(0, len(order), CHUNK))

    arrays: dict[str, Iterable[Array]] = {
        "sample_means": [gaussians.means[sampled]],
        "sample_quats": [gaussians.quats[sampled]],
        "sample_scales": [gaussians.scales[sampled]],
        "sample_opacities": [gaussians.opacities[sampled]],
        "bounds": [scene.bounds],
        "sizes": [tree.sizes],
        "errors": [tree.errors],
        "solidities": [tree.solidities],
        "means": [scene.means],
        "covars": [scene.covars],
        "log2_opacities": [scene.log2_opacities],
        "base_colors": [scene.base_colors],
        "sh_rest": [scene.sh_rest],
        "quats": ordered(gaussians.quats),
        "scales": ordered(gaussians.scales),
        "opacities": ordered(gaussians.opacities),
        "sh_first": ordered(gaussians.sh[:, 0]),
    }
    for name, vector in (("origin", gaussians.origin), ("up", gaussians.up)):
        if vector:
            arrays[name] = [np.array(vector)]
    tsplat_file.write(file, counts_of(gaussians), gaussians.antialiased, arrays)
