"""The hand of the take that is compared: a yellow skeleton beside the one shown."""

from __future__ import annotations

import numpy as np

from handtrack_app.page.page import Page, put
from handtrack_app.page.scene.ghosts import add_ghosts, update_ghosts
from handtrack_app.protocol.comparing import ComparedSnapshot
from handtrack_app.protocol.snapshots import GuessesSnapshot

_YELLOW = 5  # of the ghosts' colours


class ComparedHand:
    """It is there for the frame that it is of, and for no other."""

    def __init__(self, page: Page) -> None:
        self.view = add_ghosts(page.server, "/compared", lambda rank: None)
        self.snapshot: ComparedSnapshot | None = None
        self._frame: int | None = None

    def show(self, compared: ComparedSnapshot) -> None:
        """Take the hand of a frame."""
        self.snapshot = compared
        if len(compared.length):
            owner = np.full(len(compared.length), _YELLOW)
            bones = GuessesSnapshot(
                compared.frame, "compared", (), owner, compared.position, compared.rotation, compared.length
            )  # fmt: skip
            update_ghosts(self.view, bones)
        self._place()

    def show_frame(self, frame: int) -> None:
        """Hide it where it is of another frame."""
        self._frame = frame
        self._place()

    def _place(self) -> None:
        known = self.snapshot
        there = known is not None and len(known.length) > 0 and known.frame == self._frame
        put(self.view.bones, visible=there)
