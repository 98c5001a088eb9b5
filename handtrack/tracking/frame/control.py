"""What a caller may ask of a long computation: to stop, to be shown iterations, to be told what was searched."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from handtrack.arrays import Floats, P
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import Observation
from handtrack.tracking.frame.result import FrameResult, Step
from handtrack.tracking.frame.search_report import SearchReport

Observe = Callable[[int, BonePoses | None], Observation]
"""what is seen of a frame; the hand's bones where it is expected tell which points of a cloud are the hand's,
None where that is not known"""
Watch = Callable[[int, Floats[P], float], None]
"""called after each accepted solver step with its count, parameters and cost"""


class Observer:
    """Is told how tracking goes on; does nothing with it."""

    def search(self, report: SearchReport) -> None:
        """Take the report of a search that was made."""

    def step(self, step: Step) -> None:
        """Take a frame that is solved for good, in the order of tracking, before its result is yielded."""

    def provisional(self, result: FrameResult) -> None:
        """Take a frame's result as soon as it is solved; a search beside may still change it, and the frames after it. What holds is yielded later."""

    def progress(self, share: float) -> None:
        """Take the share that is done, 0 to 1, while all frames are refined together."""

    def shared(self, refinement: str) -> None:
        """Take, once, what all frames share, as they were refined: `whole.refinement.Refinement` as JSON."""


@dataclass(frozen=True)
class Control:
    """Handed down from whoever started the work."""

    should_stop: Callable[[], bool] = lambda: False
    """asked between solver steps"""
    observer: Observer = Observer()
    on_iteration: Callable[[int, int, Floats[P], float], None] | None = None
    """called as Watch is, with the frame's number before"""
    waits: bool = True
    """False: a search beside that isn't done `FRAMES_AHEAD` frames later is given up, as before a live camera, whose frames do not wait;
    one search is made at a time, and of the frames since only a few are solved anew"""
    refines: bool = True
    """False: frames stay as they come, and aren't refined together once all are tracked"""
    searches: bool = True
    """False: a search for what may be lost isn't made, only told to be due"""

    def watch(self, frame: int) -> Watch | None:
        """Return what the solver calls after each step in a frame; None where nobody looks."""
        shown = self.on_iteration
        if shown is None:
            return None
        return lambda count, params, cost: shown(frame, count, params, cost)
