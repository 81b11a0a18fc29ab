"""What trainers keep becomes what is drawn: exp of log scales, the sigmoid of logits, in place.

Infinities go through where that makes them finite: an infinite logit is opaque or clear, a log scale of minus
infinity is flat. What stays nan or inf is for `tsplat.io.finish` to leave out.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from tsplat.errors import LoadWarning
from tsplat.io.arrays import F32
from tsplat.io.options import LoadOptions

RAW_TOLERANCE = 1e-3
"""Activated opacities may leave [0, 1] this far by rounding; beyond it they were something else."""


class Activation:
    """How the scales and opacities of a file become those of `Gaussians`; counts what it mends on the way.

    Parameters
    ----------
    options : LoadOptions
        Whether opacities and scales are activated already.
    """

    def __init__(self, options: LoadOptions) -> None:
        self._raw_opacity, self._raw_scales = options.raw_opacity, options.raw_scales
        self._clamped: list[int] = []
        self._negative: list[int] = []

    def scales(self, scales: F32) -> None:
        """Make standard deviations of log scales, or take away their signs, which mean nothing."""
        if self._raw_scales:
            self._negative.append(int(np.count_nonzero((scales < 0.0) & np.isfinite(scales))))
            np.abs(scales, out=scales)
        else:
            np.exp(scales, out=scales)

    def opacities(self, opacities: F32) -> None:
        """Make opacities of logits, or clamp them to 0 to 1."""
        if self._raw_opacity:
            opacities[np.isinf(opacities)] = np.nan
            outside = (opacities < -RAW_TOLERANCE) | (opacities > 1.0 + RAW_TOLERANCE)
            self._clamped.append(int(np.count_nonzero(outside)))
            np.clip(opacities, 0.0, 1.0, out=opacities)
        else:
            np.negative(opacities, out=opacities)
            np.exp(opacities, out=opacities)
            opacities += 1.0
            np.reciprocal(opacities, out=opacities)

    def warn(self, path: Path, count: int, stacklevel: int) -> None:
        """Say what was mended among so many splats, if anything."""
        problems = []
        if clamped := sum(self._clamped):
            problem = f"{clamped} of {count} opacities lay outside 0 to 1 and were clamped"
            problems.append(f"{problem}; logits should be read without raw_opacity")
        if negative := sum(self._negative):
            problem = f"{negative} of {3 * count} scales were negative and lost their sign"
            problems.append(f"{problem}; logarithms should be read without raw_scales")
        for problem in problems:
            warnings.warn(f"{path}: {problem}", LoadWarning, stacklevel=stacklevel)
