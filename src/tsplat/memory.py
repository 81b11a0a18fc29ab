"""How much memory this process may still take, as far as the system says."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

UNKNOWN = 2 << 30
"""Bytes that are taken to be free where the system does not say."""

CONTROL_GROUPS = Path("/sys/fs/cgroup")

RECLAIMABLE = "inactive_file", "active_file"
"""What a control group counts as used though it is given up when memory is short: pages of files."""

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
    """Give what is left in this process's control groups, version 2, from the innermost outwards."""
    yield UNLIMITED
    with suppress(OSError, ValueError):
        inside = next(
            line[3:] for line in Path("/proc/self/cgroup").read_text().splitlines() if line.startswith("0::")
        )
        group = CONTROL_GROUPS / inside.lstrip("/")
        for folder in (group, *group.parents):
            if CONTROL_GROUPS not in (folder, *folder.parents):
                return
            with suppress(OSError, ValueError):  # the outermost has no limit of its own, and says "max" is a limit
                yield _left_in(folder)


def _left_in(group: Path) -> int:
    most = int((group / "memory.max").read_text())
    used = int((group / "memory.current").read_text())
    rows = (line.split() for line in (group / "memory.stat").read_text().splitlines())
    return most - used + sum(int(value) for name, value in rows if name in RECLAIMABLE)


def _free_within_limits() -> int:
    """Return what is left of the addresses that ``ulimit -v`` allows."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        most, _ = resource.getrlimit(resource.RLIMIT_AS)
        if 0 <= most < UNLIMITED:
            pages = int(Path("/proc/self/statm").read_text().split()[0])
            return most - pages * resource.getpagesize()
    return UNLIMITED
