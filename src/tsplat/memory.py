"""How much memory this process may still take, as far as the system says."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

UNKNOWN = 2 << 30
"""Bytes that are taken to be free where the system does not say."""

CONTROL_GROUPS = Path("/sys/fs/cgroup")


class Version(NamedTuple):
    """Where a version of control groups keeps its numbers."""

    folder: str
    most: str
    used: str
    reclaimable: tuple[str, ...]
    """What counts as used though it is given up when memory is short: pages of files."""


VERSIONS = {
    "": Version("", "memory.max", "memory.current", ("inactive_file", "active_file")),
    "memory": Version(
        "memory", "memory.limit_in_bytes", "memory.usage_in_bytes", ("total_inactive_file", "total_active_file")
    ),
}
"""By the controllers that a line of /proc/self/cgroup names: the second version is one for all."""

UNLIMITED = 1 << 60
"""Bytes from which on a limit is none."""


def free_memory() -> int:
    """Return how many bytes this process may still take, in its control groups and within its limits."""
    return max(0, min(_free_on_the_machine(), *_free_in_groups(), _free_within_limits()))


def _free_on_the_machine() -> int:
    with suppress(OSError, ValueError):
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
    with suppress(OSError, ValueError, AttributeError):
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return UNKNOWN


def _free_in_groups() -> Iterator[int]:
    """Give what is left in this process's control groups, from the innermost outwards."""
    yield UNLIMITED
    with suppress(OSError, ValueError):
        for line in Path("/proc/self/cgroup").read_text().splitlines():
            _, controllers, inside = line.split(":", 2)
            for name in {*controllers.split(",")} & VERSIONS.keys():
                root = CONTROL_GROUPS / VERSIONS[name].folder
                group = root / inside.lstrip("/")
                yield from _left_in(group, root, VERSIONS[name])


def _left_in(group: Path, root: Path, version: Version) -> Iterator[int]:
    # In a container the folder may lie elsewhere, and only its root be there.
    for folder in (group, *group.parents):
        if not folder.is_relative_to(root):
            return
        with suppress(OSError, ValueError):  # the outermost has no limit of its own, and says "max" is a limit
            most, used = (int((folder / name).read_text()) for name in (version.most, version.used))
            rows = (line.split() for line in (folder / "memory.stat").read_text().splitlines())
            yield most - used + sum(int(value) for name, value in rows if name in version.reclaimable)


def _free_within_limits() -> int:
    """Return what is left of the addresses that ``ulimit -v`` allows."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        most, _ = resource.getrlimit(resource.RLIMIT_AS)
        if 0 <= most < UNLIMITED:
            pages = int(Path("/proc/self/statm").read_text().split()[0])
            return most - pages * resource.getpagesize()
    return UNLIMITED
