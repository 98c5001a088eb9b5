"""One frame to be solved: what was seen, where the hand is expected, and what came before."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import Floats, P, S, array_dataclass
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.pose_changes import changes
from handtrack.observation.observation import Observation
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.descent import stage_problem
from handtrack.tracking.frame.frame_result import Solved, manual_result, unseen_result
from handtrack.tracking.frame.frame_terms import FrameTerms, at_camera_times, frame_terms
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.frame.terms.appearance_terms import Before
from handtrack.tracking.frame.terms.forearm import aimed_forearm


@array_dataclass
class FrameTask:
    """One frame to be solved, and all that is known before."""

    model: ArticulatedModel
    settings: TrackerSettings
    observation: Observation
    start: Floats[P]
    """where to begin, within limits"""
    previous: tuple[FrameResult, ...] = ()
    """results in the order of tracking; they tell what is usual. Empty: `start` is a first pose"""
    expected: Floats[S] | None = None
    """predicted joint parameters"""
    belief: Floats[P, P] | None = None
    """covariance of the pose before"""
    texture: Before | None = None
    control: Control = Control()

    @property
    def ahead(self) -> int:
        """How many frames after the last one."""
        return abs(self.observation.frame - self.previous[-1].frame) if self.previous else 1

    def terms(self, params: Floats[P]) -> FrameTerms:
        """Return what the frame costs, seen from solver parameters."""
        bones = self.model.bones(params)
        terms = frame_terms(
            self.model,
            self.settings,
            self.observation,
            bones,
            self.expected,
            self.ahead,
            self.texture,
        )
        if not self.previous or self.expected is None:
            return terms
        last = self.previous[-1]
        ends = [self.model.transform.solver_params(x) for x in (last.parameters, self.expected)]
        velocity = changes(np.array(ends))[0] / (self.observation.frame - last.frame)
        seen = self.observation
        return at_camera_times(terms, seen.frames_later, params, velocity, seen.cloud_later)

    def opened(self) -> tuple[Floats[P], FrameTerms]:
        """Return where to begin and the frame's terms there; the forearm of a first pose is aimed first."""
        params, terms = self.start, self.terms(self.start)
        if terms.has_seen and not self.previous and self.model.has_forearm:
            params = aimed_forearm(stage_problem(self.model, terms, 0, params), params)
            terms = self.terms(params)
        return params, terms

    def unseen(self, terms: FrameTerms) -> Solved:
        """Return a frame in which nothing was seen: what moved on unseen is not known, the last estimate is held."""
        if self.previous:
            last = self.model.transform.solver_params(self.previous[-1].parameters)
            return Solved(unseen_result(terms, self.observation, last))
        kind = manual_result if self.observation.images else unseen_result
        return Solved(kind(terms, self.observation, self.start))
