"""Hierarchies that earlier runs built, kept in the user's cache under the content of their scenes."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from pathlib import Path

from tsplat import kept
from tsplat._kernel_cache import source_digest
from tsplat.errors import LoadError
from tsplat.io.tsplat_map import open_mapped
from tsplat.lod.hierarchy import Hierarchy
from tsplat.lod.kd import kd_order
from tsplat.lod.stored import counts_of, tree_of, write_tree
from tsplat.scene import Gaussians

KEPT_FROM = 500_000
"""Splats. Fewer are merged in about the time that it takes to wonder about it."""


def name_of(gaussians: Gaussians) -> str:
    """Return a name for the hierarchy of a scene: another for any other value in it, and when merging changes."""
    digest = hashlib.sha256(source_digest(Path(__file__).parent).encode())
    digest.update(f"{gaussians.sh.shape} {gaussians.antialiased}".encode())
    for array in gaussians.arrays:
        digest.update(array.data)
    return digest.hexdigest()[:32]


def recall(gaussians: Gaussians) -> Hierarchy | None:
    """Return the hierarchy of a scene as an earlier run kept it, in memory that is read when it is looked at."""
    path = kept.recalled(name_of(gaussians)) if len(gaussians) >= KEPT_FROM else None
    if path is None:
        return None
    with suppress(OSError, LoadError):
        mapped = open_mapped(path)
        if mapped.header.counts == counts_of(gaussians):
            return tree_of(mapped)
    return None


def keep(gaussians: Gaussians, tree: Hierarchy) -> None:
    """Keep the hierarchy of a scene for later runs, if it took long to build; where that cannot be, it is not."""
    if len(gaussians) >= KEPT_FROM:
        order = kd_order(gaussians.means, 1)
        nbytes = counts_of(gaussians).nbytes
        kept.keep(name_of(gaussians), nbytes, lambda file: write_tree(file, gaussians, tree, order))
