"""Pins in the tab Pose: what holds the rest of the hand, which pins a frame has, and buttons to drop and copy them."""

from __future__ import annotations

import html
from dataclasses import dataclass

from handtrack_app.page.html import table, text
from handtrack_app.page.page import Page, put
from handtrack_app.page.panels.pose_words import group_of
from handtrack_app.page.pins.grips import Grips, near_joint_m
from handtrack_app.protocol.snapshots import PinCard, PoseSnapshot, ScoreSnapshot, SessionSnapshot

IMAGES, LEAST = "fit to images", "keep"
_NONE = (
    "<div class='handtrack-text handtrack-faint'>Open a camera view (key 1, 2 …) and drag a "
    "joint or a segment to where the picture has it. The same joint in a second camera fixes the point.</div>"
)


@dataclass
class PinPanel:
    """Handles of the folder."""

    page: Page
    grips: Grips
    pins: tuple[PinCard, ...] = ()
    near_m: float = 0.0
    """a pin that is missed by more is not at its joint any more"""
    _before: tuple[int, float] | None = None
    """a frame, and the cost of its pose before the pins"""

    def __post_init__(self) -> None:
        """Add the folder where the page builds now."""
        gui, page = self.page.gui, self.page
        with gui.add_folder("Pins"):
            self.held = page.choice(
                "Other joints", (IMAGES, LEAST), self._hold,
                "While a joint is dragged, the other joints are fitted to the images; or they stay as they are, as far as they can.",
            )  # fmt: skip
            self.list = gui.add_html(_NONE)
            self.drop = page.button(
                "Drop the last pin", self._drop_last, "pin",
                "The place that was pinned last is free again. Ctrl-Z goes back a drag.", visible=False,
            )  # fmt: skip
            self.drop_all = page.button(
                "Drop all pins of this frame", lambda: self._drop(None), "pinned-off",
                "The tracked pose shows again.", visible=False,
            )  # fmt: skip
            self.copy = page.buttons(
                "Copy to frames", ("5 before", "5 behind", "both"), self._copy,
                "The same correction beside, moved as what was tracked moves.", visible=False,
            )  # fmt: skip
        page.key("Drop the last pin", "Backspace", lambda _: self._drop_last())
        fit_or_keep = "Pins: fit other joints to the images, or keep them"
        page.key(fit_or_keep, "X", lambda _: self._switch(), "shift")

    def fit(self, session: SessionSnapshot) -> None:
        """Take the size of a session's model."""
        self.near_m = near_joint_m(session)

    def show(self, pose: PoseSnapshot, score: ScoreSnapshot | None) -> None:
        """Show the pins of a frame. score: of this pose, or None while it is not known."""
        cost = None if score is None or not score.energy else sum(score.energy.values())
        if not pose.pins and cost is not None:
            self._before = pose.frame, cost
        gain = None
        if cost is not None and self._before is not None and self._before[0] == pose.frame:
            gain = cost - self._before[1]
        self.pins = pose.pins
        put(self.list, content=pin_list(pose.pins, self.near_m, gain) if pose.pins else _NONE)
        for button in (self.drop, self.drop_all, self.copy):
            put(button, visible=bool(pose.pins))

    def _hold(self, choice: str) -> None:
        self.grips.by_images = choice == IMAGES

    def _switch(self) -> None:
        self.held.value = LEAST if self.grips.by_images else IMAGES
        self._hold(self.held.value)

    def _drop_last(self) -> None:
        if self.pins:
            self._drop(len(self.pins) - 1)

    def _drop(self, which: int | None) -> None:
        state = self.page.state
        version = state.begin_edit()
        self.page.engine.drop_pins(state.frame, which, version, self.grips.by_images)

    def _copy(self, choice: str) -> None:
        state = self.page.state
        before, behind = {"5 before": (5, 0), "5 behind": (0, 5)}.get(choice, (5, 5))
        self.page.engine.copy_pins(state.frame, before, behind, state.begin_edit())


def pin_list(pins: tuple[PinCard, ...], near_m: float, gain: float | None = None) -> str:
    """Return the pins of a frame as a table: what, where, and by how much the pose misses it. near_m: a pin that is missed by more
    contradicts something; gain: of the cost, by the pins, where it is known.
    """
    rows = "".join(
        f"<tr class='{'handtrack-error' if pin.off_m > near_m else ''}'><td>{html.escape(pin.words)}</td>"
        f"<td>{html.escape(pin.camera)}</td><td style='text-align:right'>{pin.off_px:.1f} px</td></tr>"
        for pin in pins
    )
    mean = sum(pin.off_px for pin in pins) / len(pins)
    parts = dict.fromkeys(group_of(pin.words.replace(" ", "_")).lower() for pin in pins)
    head = f"{', '.join(parts)}: {len(pins)} pin{'' if len(pins) == 1 else 's'}, {mean:.1f} px"
    head += "" if gain is None else f", cost {gain:+.0f}".replace("-", "−")
    if any(pin.off_m > near_m for pin in pins):
        head += ". The red ones contradict the others or the joint limits."
    return text(head, faint=False) + table(rows)
