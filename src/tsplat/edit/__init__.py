"""Scenes made into others: what is left out, how the rest is moved, and several as one.

Each is a pure function from `Gaussians` to `Gaussians`; `tsplat convert` is made of them.
"""

from __future__ import annotations

from tsplat.edit.crop import crop_box, crop_sphere
from tsplat.edit.filters import drop_faint, drop_large
from tsplat.edit.floaters import remove_floaters
from tsplat.edit.harmonics import lower_sh_degree, with_sh_degree
from tsplat.edit.join import join
from tsplat.edit.limit import keep_most_important
from tsplat.edit.transform import rotate, scale, translate

__all__ = [
    "crop_box",
    "crop_sphere",
    "drop_faint",
    "drop_large",
    "join",
    "keep_most_important",
    "lower_sh_degree",
    "remove_floaters",
    "rotate",
    "scale",
    "translate",
    "with_sh_degree",
]
