"""What tracking carries from one frame to the next: everything that a step needs, and nothing else does."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from handtrack.arrays import Floats, P, array_dataclass
from handtrack.tracking.frame.motion_belief import MotionBelief
from handtrack.tracking.frame.result import FrameResult, Status, Step
from handtrack.tracking.frame.terms.appearance_terms import Before

REMEMBERED = 30
"""results that a step may look back on"""


@array_dataclass
class TrackerState:
    """Immutable: a state may be stepped from again, with other settings or another observation."""

    start: Floats[P] | None = None
    """where the first frame begins"""
    results: tuple[FrameResult, ...] = ()
    """the latest last, in the order of tracking; they predict, and tell what is usual and how long the hand is lost"""
    belief: Floats[P, P] | None = None
    """covariance of the latest pose that was not lost; None where nothing is said of it"""
    beliefs: tuple[MotionBelief, ...] = ()
    """how the last result's alternatives move, where `tracker.hypotheses` is above 1"""
    texture: Before | None = None
    """images of the latest frame that was not lost and the model in it, where images are looked at"""

    @classmethod
    def beginning_at(cls, start: Floats[P]) -> TrackerState:
        """Return the state before a first frame, whose pose is about `start`, solver parameters."""
        return cls(start=start)

    @classmethod
    def resumed(cls, results: Iterable[FrameResult]) -> TrackerState:
        """Return a state after results that were read back, in the order of tracking.

        Poses go on as they would have; only how sure the last one was is not saved, nor hypotheses and texture.
        """
        return cls(results=tuple(results)[-REMEMBERED:])

    @classmethod
    def after_steps(cls, steps: Sequence[Step], texture: Before | None = None) -> TrackerState:
        """Return the state after steps in the order of tracking, at least one; texture: of those it was."""
        results = tuple(step.result for step in steps[-REMEMBERED:])
        return cls(None, results, steps[-1].belief, steps[-1].beliefs, texture)

    @property
    def step(self) -> Step:
        """The latest frame, as `after_steps` takes it. There is one."""
        return Step(self.results[-1], self.belief, self.beliefs)

    @property
    def last(self) -> FrameResult | None:
        return self.results[-1] if self.results else None

    def after(self, solved: Step, texture: Before | None = None) -> TrackerState:
        """Return the state once a frame is solved. A lost frame changes neither belief nor texture."""
        result = solved.result
        results = (*self.results, result)[-REMEMBERED:]
        if result.status == Status.LOST and self.results:
            return replace(self, results=results, beliefs=solved.beliefs)
        if texture is not None and self.texture is not None:
            texture = replace(texture, first=self.texture.first or self.texture)
        lost = result.status == Status.LOST
        belief = self.belief if lost else solved.belief
        return TrackerState(None, results, belief, solved.beliefs, texture)
