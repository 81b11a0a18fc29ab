"""Where someone who records a session stands: between the viewer and its terminal, and behind its painter."""

from __future__ import annotations

from tsplat.terminal import Profile, Session
from tsplat.viewer.picture import Painter
from tsplat.viewer.scenes import Scenes


class Recorder:
    """Records nothing; those that record something make their own session or painter."""

    def session(self) -> Session:
        """Return the session to enter."""
        return Session()

    def takes(self, output: str) -> bool:  # noqa: ARG002
        """Return whether pictures that are shown in this way can be recorded."""
        return True

    def painter(self, scenes: Scenes, profile: Profile) -> Painter:
        """Return what draws the scene for this terminal."""
        return Painter(scenes, profile)
