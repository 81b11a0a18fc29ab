"""Colours of a glTF whose light is linear, and those of the points that stand in for splats.

Source: IEC 61966-2-1 for sRGB; KHR_gaussian_splatting, sections *Color Space* and *Fallback Behavior*.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tsplat.scene import SH_C0

F32 = npt.NDArray[np.float32]

KNEE = 0.0031308
SLOPE = 12.92


def show_linear(sh: F32) -> None:
    """Turn harmonics of linear light into those of sRGB, in place.

    What does not change with the view becomes exact, what does follows the slope of the curve there.
    """
    linear = 0.5 + SH_C0 * sh[:, 0]
    above = np.maximum(linear, KNEE)
    shown = np.where(linear > KNEE, 1.055 * above ** (1 / 2.4) - 0.055, SLOPE * linear)
    slope = np.where(linear > KNEE, 1.055 / 2.4 * above ** (1 / 2.4 - 1), SLOPE)
    sh[:, 1:] *= slope[:, None]
    sh[:, 0] = (shown - 0.5) / SH_C0


def to_linear(shown: F32) -> F32:
    """Return linear light, 0 to 1, of sRGB values from 0 to 1."""
    return np.where(shown > SLOPE * KNEE, ((shown + 0.055) / 1.055) ** 2.4, shown / SLOPE).astype(np.float32)
