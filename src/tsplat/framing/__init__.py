"""Where a scene is, which way is up in it, and where to stand to see it: the start view, as far as geometry tells.

`sample` takes some splats, `trim` leaves floaters and backdrop out of them, `bulk` measures what stays. `up` asks,
in this order, `cameras`, `ground` and, of formats whose writers disagree, `upside_down`. `start` frames the bulk,
and `tsplat.first_view` goes to another side where that shows more.

All of it looks at a sample of the splats and at weighted quantiles, never at extremes: a trained
scene has floaters far outside and a backdrop of few, huge splats.
"""

from tsplat.framing.bulk import Bulk, bulk
from tsplat.framing.cameras import poses_inside, was_seen
from tsplat.framing.sample import SAMPLE
from tsplat.framing.start import start_pose
from tsplat.framing.up import UP_DEFAULT, UPS, Up, axis_name, guess_up

__all__ = [
    "SAMPLE", "UPS", "UP_DEFAULT", "Bulk", "Up", "axis_name", "bulk", "guess_up", "poses_inside", "start_pose",
    "was_seen",
]  # fmt: skip
