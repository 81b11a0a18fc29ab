"""On what the figures were measured: without it, they mean nothing on another day."""

from __future__ import annotations

import importlib.metadata
import platform
import subprocess
from pathlib import Path

from tsplat import __version__
from tsplat.processors import available_processors

SYSCTL = "/usr/sbin/sysctl"
"""By its place, as some systems look into the current folder first."""


def machine() -> dict[str, str | int]:
    """Return the processor's name, how many processors there are, and the versions that matter to speed."""
    return {
        "processor": _processor(),
        "processors": available_processors(),
        "system": platform.platform(terse=True),
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in ("numpy", "numba", "llvmlite")},
        "tsplat": __version__,
    }


def _processor() -> str:
    # Python's own answer is the architecture on Linux and a family number on Windows.
    try:
        for line in Path("/proc/cpuinfo").read_text(errors="replace").splitlines():
            if line.startswith(("model name", "Model")):
                return line.partition(":")[2].strip()
        asked = subprocess.run(
            [SYSCTL, "-n", "machdep.cpu.brand_string"],
            capture_output=True,
            text=True,
            timeout=5,
            check=True,
        )
        return asked.stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return platform.processor() or platform.machine()
