"""Nudges: move and turn the hand by small steps as the user sees it, by button or key."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import viser

from handtrack.arrays import D3, D6, Floats
from handtrack_app.page.page import Keys, Page
from handtrack_app.page.panels.pose_words import length_unit
from handtrack_app.page.pins.whole_hand import moved_root
from handtrack_app.protocol.snapshots import SessionSnapshot

if TYPE_CHECKING:
    from handtrack_app.viser_internals import KeyModifier


class Nudge(NamedTuple):
    """A step along a view's axes: to the right, down, away from the viewer; moved by a length or turned by an angle."""

    move: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)


NUDGES: dict[str, Nudge] = {
    "left": Nudge(move=(-1, 0, 0)),
    "right": Nudge(move=(1, 0, 0)),
    "up": Nudge(move=(0, -1, 0)),
    "down": Nudge(move=(0, 1, 0)),
    "nearer": Nudge(move=(0, 0, -1)),
    "farther": Nudge(move=(0, 0, 1)),
    "roll left": Nudge(turn=(0, 0, -1)),
    "roll right": Nudge(turn=(0, 0, 1)),
    "tilt up": Nudge(turn=(-1, 0, 0)),
    "tilt down": Nudge(turn=(1, 0, 0)),
    "turn left": Nudge(turn=(0, 1, 0)),
    "turn right": Nudge(turn=(0, -1, 0)),
}


def nudged(
    root: Floats[D6],
    nudge: Nudge,
    view: Floats[D3, D3],
    pivot: Floats[D3],
    step_m: float,
    step_rad: float,
) -> dict[str, float]:
    """Return root parameters by name after a nudge.

    root: [m, rad]. view: rotation from the view's axes (x right, y down, z away) to the world.
    pivot: world [m], the point that stays when the hand turns.
    """
    turn = view @ np.array(nudge.turn, dtype=float) * step_rad
    return moved_root(root, pivot, turn, view @ np.array(nudge.move, dtype=float) * step_m)


_STEPS = (0.5, 0.5), (2.0, 2.0), (10.0, 10.0), (50.0, 10.0)
"""in the unit in which the model is placed, and degrees"""
_USUAL = 1
_ROWS: dict[str, dict[str, str]] = {
    "Move": {"←": "left", "→": "right", "↑": "up", "↓": "down"},
    "Depth": {"nearer": "nearer", "farther": "farther"},
    "Turn": {
        "↺": "roll left", "↻": "roll right", "⤒": "tilt up", "⤓": "tilt down",
        "⇤": "turn left", "⇥": "turn right",
    },
}  # fmt: skip
_HINTS = {
    "Move": "Across the view. Keys J L I K.",
    "Depth": "Along the line of sight: the place in this camera's image stays. Keys Y N.",
    "Turn": "Roll, tilt and turn about the middle, as seen. Keys U P; with Shift I K J L.",
}
_KEYS: tuple[tuple[str, KeyModifier | None, str], ...] = (
    ("J", None, "left"), ("L", None, "right"), ("I", None, "up"), ("K", None, "down"),
    ("Y", None, "nearer"), ("N", None, "farther"), ("U", None, "roll left"), ("P", None, "roll right"),
    ("I", "shift", "tilt up"), ("K", "shift", "tilt down"), ("J", "shift", "turn left"), ("L", "shift", "turn right"),
)  # fmt: skip


def _steps(unit: str, metres: float) -> dict[str, tuple[float, float]]:
    return {f"{length:g} {unit}, {turn:g}°": (length * metres, turn) for length, turn in _STEPS}


@dataclass
class NudgePanel:
    """Handles of the nudges."""

    page: Page
    pivot: Callable[[], Floats[D3] | None]
    """the hand's middle world [m]"""
    axes: Callable[[viser.ClientHandle | None], Floats[D3, D3] | None]
    """the axes of a page's view, view (x right, y down, z ahead) → world"""
    keys: Keys
    steps: dict[str, tuple[float, float]] = field(default_factory=lambda: _steps("mm", 1e-3))
    """by their words [m, °]"""

    def fit(self, session: SessionSnapshot) -> None:
        """Step by what the model is placed by."""
        steps = _steps(*length_unit(session.reach_m))
        if steps != self.steps:
            self.steps = steps
            self.step.options = tuple(steps)
            self.step.value = tuple(steps)[_USUAL]

    def build(self) -> None:
        """Add the buttons where the page builds now, and the keys."""
        gui, page = self.page.gui, self.page
        with gui.add_folder("Nudge as you see it", expand_by_default=False):
            for label, words in _ROWS.items():
                row = gui.add_button_group(label, tuple(words), hint=_HINTS[label])
                page.on(row, lambda e, words=words: self.nudge(words.get(e.value), e.client))
            words = tuple(self.steps)
            self.step = gui.add_dropdown(
                "Step", words, initial_value=words[_USUAL],
                hint="Keys: J L I K move, Y N nearer and farther, U P roll, Shift with I K J L tilts and turns.",
            )  # fmt: skip
        for key, modifier, name in _KEYS:
            act = page.from_user(lambda e, name=name: self.nudge(name, e.client))
            self.keys.add(f"Nudge: {name}", key, act, modifier)

    def nudge(self, name: str | None, client: viser.ClientHandle | None) -> None:
        """Move or turn the hand by one step along the axes of the camera looked through, or of the client's view."""
        state, pivot = self.page.state, self.pivot()
        nudge, view = NUDGES.get(name or ""), self.axes(client)
        if nudge is None or view is None or pivot is None or len(state.values) < 6:
            return
        step_m, step_deg = self.steps.get(str(self.step.value), tuple(self.steps.values())[_USUAL])
        root = np.array(state.values[:6])
        step_rad = float(np.deg2rad(step_deg))
        edit = nudged(root, nudge, np.asarray(view), pivot, step_m, step_rad)
        self.page.edit_pose(edit, f"Nudge {name}", f"nudge {name}")
