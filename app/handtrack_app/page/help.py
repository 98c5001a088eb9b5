"""One page of help, and a tour of five things to do for who comes for the first time; both for one page alone, and left at once."""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import viser

from handtrack_app.page.html import text
from handtrack_app.page.page import Client, Page, Part, put, remembered
from handtrack_app.page.panels.tracking import TrackingPanel

_KEPT_AS = "handtrack.toured"  # in the browser's storage
_LEAVE = "Leave"
_GESTURES = (
    ("Drag", "Turns the orbit view; moves the image of a camera view"),
    ("Wheel", "Zooms"),
    (
        "Drag the {kind}",
        "In a camera view: pins a joint or segment; the {middle} moves the whole {kind}",
    ),
    (
        "Shift drag",
        "On the {kind}: in a camera view turns it, as the right button does; in the orbit view pulls a joint or segment",
    ),
    ("Arrows, arcs", "On the handle: move and turn the {kind}"),
    ("Shift Tab", "Goes to the buttons, the last first; from there Tab goes on, Esc leaves them"),
)
TOUR = (
    (
        "Move a {part}",
        "In the tab Pose, move a slider. The numbers above it follow, and Ctrl Z takes it back.",
    ),
    (
        "Pin a joint",
        "Press 1 for a camera view, then drag a joint to its place in the image.",
    ),
    (
        "Review",
        "Shift Z shows the interval of lowest confidence. <b>Accept and next</b>, in the tab Review, accepts it.",
    ),
    ("Plot", "Review, then Plots: choose what to see over time."),
    ("Export", "More, then Export: download joint angles and positions."),
)
"""what is to be done, and how"""


@dataclass
class Help(Part):
    """Help and tour of the pages."""

    leave: Callable[[Client], None]
    """leaves a camera's view"""
    marks: tuple[Callable[[], object], ...]
    """for each step of the tour what differs once it is done"""
    offers_tour: bool = False
    """to who comes for the first time"""

    def build(self) -> None:
        self.page.watch(self._go_on)
        key = self.page.key
        key("Help: all keys", "shift+H", self.show, by_page=True)
        key("Tour: five things to do", "", self.tour, by_page=True)
        key("Close the dialog, or leave the camera", "escape", self.escape, by_page=True)

    def escape(self, client: Client) -> None:
        """Close the dialog; where none is open, leave the camera that is looked through."""
        if not self.page.close_dialog(client):
            self.leave(client)

    def welcome(self, client: Client) -> None:
        """Offer the tour to a page whose browser knows of none."""
        if self.offers_tour:
            remembered(client.handle, _KEPT_AS, lambda kept: kept is None and self.tour(client))

    def show(self, client: Client) -> None:
        """Show all keys."""
        with self.page.dialog(client, "Keys and gestures"):
            search = client.handle.gui.add_text("Search", "")
            listed = client.handle.gui.add_html(self.table())

        @search.on_update
        def _(event: viser.GuiEvent[viser.GuiTextHandle]) -> None:
            if client.dialog is not None:  # what was typed last may come after its end
                put(listed, content=self.table(event.target.value))

    def table(self, wanted: str = "") -> str:
        """Return gestures and keys, or those of them that hold some words."""
        phrase = self.page.phrase
        known = (*_GESTURES, *self.page.keys, ("Ctrl K", "All commands, by name"))
        rows = "".join(
            f"<div><kbd>{html.escape(phrase(how))}</kbd><span>{html.escape(phrase(what))}</span></div>"
            for how, what in known
            if wanted.strip().lower() in f"{phrase(how)} {phrase(what)}".lower()
        )
        return f"<div class='handtrack-keys' tabindex='0'>{rows or 'No match.'}</div>"

    def tour(self, client: Client) -> None:
        """Begin the tour."""
        self._step(client, 0)

    def _step(self, client: Client, number: int) -> None:
        before, client.tour = client.tour, None
        if before is not None:
            before[0].remove()
        gui = client.handle.gui
        if number >= len(TOUR):
            client.handle.local_storage.set_item(_KEPT_AS, "yes")
            return
        title, words = (self.page.phrase(one) for one in TOUR[number])
        with gui.add_folder(f"{number + 1} of {len(TOUR)}: {title}", order=0.2) as folder:
            gui.add_html(text(words, faint=False))
            go_on = gui.add_button_group("Tour", ("Skip", _LEAVE))
        go_on.on_click(
            lambda event: self._step(
                client, len(TOUR) if event.target.value == _LEAVE else number + 1
            )
        )
        client.tour = folder, number, self.marks[number]()

    def _go_on(self) -> None:
        """Go on where a step of the tour was done."""
        for client in self.page.clients:
            if (tour := client.tour) is not None and self.marks[tour[1]]() != tour[2]:
                self._step(client, tour[1] + 1)


# ---- Keys, and entries of the palette, for the work itself: frames, tracking, keyframes, saving, export


_TEN = 10


def add_work_keys(page: Page, tracking: TrackingPanel) -> None:
    """Add them; each does what a button of the page does. Not W, A, S, D, Q, E, with whatever else: viser walks by them."""
    state = page.state
    for words, keys, act in (
        ("Undo", "cmd/ctrl+Z", partial(page.travel, back=True)),
        ("Redo", "cmd/ctrl+shift+Z", partial(page.travel, back=False)),
        ("Redo", "cmd/ctrl+Y", partial(page.travel, back=False)),
        ("Before/after: the pose before the last step", "tab", page.flip),
        ("Play or pause", "space", lambda: page.play(not state.playing)),
        ("Next frame", "arrowright", lambda: page.go_to(state.frame + 1)),
        ("Previous frame", "arrowleft", lambda: page.go_to(state.frame - 1)),
        (
            "Hide or show the model",
            "H",
            lambda: page.draw("hidden", not state.display.hidden),
        ),
        ("Ten frames on", "shift+arrowright", lambda: page.go_to(state.frame + _TEN)),
        ("Ten frames back", "shift+arrowleft", lambda: page.go_to(state.frame - _TEN)),
        ("First frame", "home", lambda: page.go_to(state.strip.start)),
        ("Last frame", "end", lambda: page.go_to(state.strip.stop - 1)),
        (
            "Set keyframe: this pose",
            "M",
            lambda: page.engine.take_pose(state.frame, "shown", state.begin_edit()),
        ),
        (
            "Remove keyframe: the tracked pose again",
            "shift+M",
            lambda: page.engine.forget_pose(state.frame, state.begin_edit()),
        ),
        ("Track: from here on", "shift+T", partial(tracking.start, "forward ▶")),
        ("Track: from here back", "shift+B", partial(tracking.start, "◀ backward")),
        ("Track: all frames", "", partial(tracking.start, "all")),
        ("Track: pause or resume", "shift+P", tracking.pause_or_go_on),
        ("Track: cancel", "shift+C", page.engine.cancel),
        ("Refine all frames together", "shift+R", page.engine.refine),
        ("Save the track", "shift+V", page.engine.save_track),
        ("Save this pose as the first frame's", "", page.engine.save_pose),
    ):
        page.key(words, keys, act)
