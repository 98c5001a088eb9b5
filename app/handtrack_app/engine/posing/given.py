"""Poses that a person gave: keyframes stay as they are, pins and refits lead; and with which of them frames were refined."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from handtrack.arrays import Floats, P
from handtrack.observation.pins import Pin
from handtrack.store.history import Value
from handtrack_app.engine.document import Document
from handtrack_app.engine.run import Run
from handtrack_app.engine.store import keys


@dataclass(frozen=True, eq=False)
class Given:
    """Poses that a person gave, solver parameters by frame."""

    held: Mapping[int, Floats[P]] = field(default_factory=dict)
    """they stay as they are"""
    led: Mapping[int, Floats[P]] = field(default_factory=dict)
    """where the solver led while somebody pulled or tuned: tracking goes on from there, and solves these frames anew"""

    def without(self, frame: int) -> Given:
        """Return the others."""
        held = {f: pose for f, pose in self.held.items() if f != frame}
        return Given(held, {f: pose for f, pose in self.led.items() if f != frame})


@dataclass(frozen=True, eq=False)
class RefinedWith:
    """What frames were refined with."""

    run: Run
    spans: Value
    """of the current track, once they lay in it"""
    held: Mapping[int, Floats[P]]
    """keyframes"""
    pins: Mapping[int, tuple[Pin, ...]]

    @classmethod
    def of(cls, document: Document) -> RefinedWith:
        """Return what frames would be refined with now."""
        pins = document.run.session.pins
        return cls(
            document.run,
            document.state.get(keys.SPANS),
            document.keyframes(document.frames),
            {frame: pins.of(frame) for frame in pins.frames},
        )

    def changed(self, now: RefinedWith) -> list[int] | None:
        """Return at which frames keyframes or pins are new or moved; None where none is, where one was let go, or anything else may
        have changed.
        """
        gone = (self.held.keys() - now.held.keys()) | (self.pins.keys() - now.pins.keys())
        if gone or now.run is not self.run or now.spans != self.spans:
            return None
        before, after = self.held, now.held
        same = {f for f in before.keys() & after.keys() if np.array_equal(before[f], after[f])}
        posed = after.keys() - same
        pinned = {f for f, pins in now.pins.items() if self.pins.get(f, ()) != pins}
        return sorted(posed | pinned) or None
