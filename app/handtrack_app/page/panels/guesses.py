"""Guesses: find the hand without a first pose, and take one of the poses that explain a frame."""

from __future__ import annotations

import html
from dataclasses import dataclass

import viser

from handtrack.detector.weights import DOWNLOAD_MB, has_weights
from handtrack_app.page.page import Page, put
from handtrack_app.protocol.palette import GHOSTS
from handtrack_app.protocol.snapshots import (
    IMAGES,
    KEYPOINTS,
    GuessesSnapshot,
    ProgressSnapshot,
    SessionSnapshot,
)

_HERE, _ANYWHERE = "this frame", "best frame"
_HINTS = {
    "hand": "Looks for an open or half-open hand in silhouettes, clouds and a detector's joints, without any first pose.",
    "body": "Looks at the joints that a detector saw, without any first pose.",
}
_TITLES = {"found": "Poses found", "carried": "Poses carried along"}


@dataclass
class GuessesPanel:
    """Handles of the search and of the ranked list."""

    page: Page
    guesses: GuessesSnapshot | None = None
    folder: viser.GuiFolderHandle | None = None
    possible: bool = True
    """there is something to look at"""
    helps: bool = False
    """a hand detector would"""

    def build(self) -> None:
        """Add the widgets where the page builds now."""
        gui, page = self.page.gui, self.page
        self.find = gui.add_button_group(
            "Detect hand", (_HERE, _ANYWHERE), hint=_HINTS["hand"],
        )  # fmt: skip
        page.words.on(self.find, label="Detect {kind}")
        self.fetch = gui.add_button(
            f"Get the detector ({DOWNLOAD_MB} MB) and find", icon=viser.Icon.DOWNLOAD, color="gray", visible=False,
            hint="Two networks that find a hand in the images of two cameras, whatever its posture, are not installed yet. This fetches them "
            "by pip, once for all recordings. Google's, Apache License 2.0.",
        )  # fmt: skip
        self.cancel = gui.add_button(
            "Cancel the search", icon=viser.Icon.PLAYER_STOP, color="red", visible=False
        )
        page.on(self.find, lambda event: self.search(event.value == _ANYWHERE))
        page.on(self.fetch, lambda _: self.search(fetch=True))
        page.on(self.cancel, lambda _: page.engine.cancel())
        self.folder = gui.add_folder("Other poses", visible=False)
        with self.folder:
            self.list = gui.add_html("")
            self.takes = gui.add_button_group(
                "Take", ("1",), hint="Set this frame's pose to one of these."
            )
            self.ghosts = gui.add_checkbox(
                "Ghosts",
                True,
                hint="Draw these poses in the scene, each in the colour of its number.",
            )
        page.on(self.takes, lambda event: self._take(event.value))
        page.on(self.ghosts, lambda event: page.draw("ghosts", bool(event.value)))

    def search(self, anywhere: bool = False, fetch: bool = False) -> None:
        """Detect the model in the frame shown, or in the surest of several."""
        state = self.page.state
        state.playing = False
        self.page.engine.find_hand(None if anywhere else state.frame, fetch)

    def _take(self, pressed: object) -> None:
        words = str(pressed)
        if words.isdecimal() and int(words) > 0:
            self.take(int(words) - 1)

    def take(self, rank: int) -> None:
        """Take one of the list."""
        known, state = self.guesses, self.page.state
        if known is not None and rank < len(known.guesses):
            self.page.engine.take_guess(known.frame, rank, state.begin_edit())

    def show(self, guesses: GuessesSnapshot) -> None:
        """Show the list of a frame; take the surest of what was just found."""
        self.guesses = guesses
        if self.folder is None:
            return
        ranks = tuple(str(rank + 1) for rank in range(len(guesses.guesses)))
        if ranks and self.takes.options != ranks:
            self.takes.options = ranks
        self.list.content = _table(guesses)
        self.folder.visible = bool(guesses.guesses)
        if guesses.is_new:
            self.take(0)

    def show_progress(self, progress: ProgressSnapshot) -> None:
        """Show whether something can be cancelled, and nothing that cannot be pressed."""
        if self.folder is None:
            return
        busy = progress.state in ("tracking", "paused", "preparing")
        searching = busy and progress.state == "preparing" and progress.job == "finding"
        put(self.cancel, visible=searching)
        put(self.find, visible=self.possible and not busy)
        put(self.fetch, visible=self.helps and not busy and not has_weights())

    def fit(self, session: SessionSnapshot) -> None:
        """Offer the search where there is one."""
        self.possible = session.kind == "hand" or KEYPOINTS in session.seen
        self.helps = session.kind == "hand" and IMAGES in session.seen and len(session.cameras) > 1
        put(self.find, hint=_HINTS[session.kind])
        if not self.possible:
            self.find.visible = False


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.01 else "below 1 %"


def _table(guesses: GuessesSnapshot) -> str:
    """Return what is known of each pose of the list."""
    rows = "".join(
        f"<div style='display:flex;gap:.5em'><span style='flex:none;width:.7em;height:.7em;margin-top:.35em;"
        f"border-radius:50%;background:rgb{GHOSTS[rank]}'></span><span><b>{rank + 1}: "
        f"{_percent(guess.share)}</b> {html.escape(guess.words)}</span></div>"
        for rank, guess in enumerate(guesses.guesses)
    )
    title = _TITLES.get(guesses.kind, "")
    return (
        f"<div style='padding:.3em .9em;font-size:.8em;line-height:1.4'><b>{title}, frame {guesses.frame}</b>"
        f"{rows}</div>"
    )
