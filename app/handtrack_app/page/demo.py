"""The demo: the session tracks itself as soon as it is shown, then plays."""

from __future__ import annotations

from handtrack_app.page.page import Page
from handtrack_app.protocol.messages import ProgressSnapshot, SessionSnapshot, StripSnapshot, Track


class Demo:
    """Watches what the page shows, and presses the buttons that a new user would."""

    def __init__(self) -> None:
        self._begun = self._tracking = False

    def begin(self, strip: StripSnapshot, page: Page, session: SessionSnapshot | None) -> None:
        """Track all frames once the session is shown; play what was tracked the last time."""
        if self._begun or session is None:
            return
        self._begun = True
        if (strip.status >= 0).any():
            page.state.playing = True
            return
        page.state.follow = True
        page.send(Track(session.start, session.stop, session.first_frame, anew=True))

    def follow(self, progress: ProgressSnapshot, page: Page) -> None:
        """Play when tracking is done, unless the user looks at something else by then."""
        if progress.state == "tracking":
            self._tracking = True
        elif self._tracking and progress.state == "idle":
            self._tracking = False
            page.state.playing = page.state.follow
