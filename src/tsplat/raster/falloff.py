"""How a splat fades from its centre: ``2**x`` for x in [-8, 0], as the eighth power of a cubic.

``2**(x / 8)`` is a cubic to 7.5e-5. As any cubic is ``y^3 + LINEAR y + CONSTANT`` of some
``y = SCALE x + OFFSET``, records hold these *levels* in place of exponents, and five operations are left.
"""

from __future__ import annotations

import math

import numpy as np

from tsplat._jit import part
from tsplat._lanes import eighth_power, fma, splat

LOG2_E = math.log2(math.e)

SCALE, OFFSET = 0.042394585, 0.66671264
LINEAR, CONSTANT = 0.70395035, 0.23423506
"""The least relative error that the whole can have, 6e-4; below -8 it is off by up to 3e-5 in absolute terms."""


@part
def alpha_of(level):
    """Return ``2**x`` of eight levels ``SCALE * x + OFFSET``."""
    return eighth_power(fma(fma(level, level, splat(np.float32(LINEAR))), level, splat(np.float32(CONSTANT))))
