"""A finger that may be lost: fingers are put elsewhere, the frame is solved from there, the better pose is taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from handtrack.arrays import Floats, P
from handtrack.model.kinematics import BonePoses
from handtrack.parallel import in_parallel
from handtrack.solver.problem import Problem
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.descent import descend, stage_problem
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.search.engine import Candidate, Fit, Search, improved
from handtrack.tracking.search.policy import LOST_FINGER
from handtrack.tracking.search.proposers.finger_moves import finger_grid, finger_shifts


@dataclass(frozen=True, eq=False)
class FingerLandscape:
    """One frame whose pose is nearly known; see engine.Landscape. The pull to the prediction is left out."""

    terms: FrameTerms
    far: Problem
    """the widest band where the pose stands: ranks the places that a finger is put to"""
    here: BonePoses
    """where the bands are frozen while poses are compared"""

    @classmethod
    def at(cls, terms: FrameTerms, params: Floats[P]) -> FingerLandscape:
        """Return the landscape around a pose that was found with these terms."""
        free = terms.without_motion()
        model = terms.model
        return cls(free, stage_problem(model, free, 0, params), model.bones(params))

    def propose(self, proposer: str, found: Sequence[Candidate], most: int) -> list[Candidate]:
        (standing,) = found
        if proposer.startswith("finger shift"):
            shifted = finger_shifts(standing.model, standing.params)
            shifted = shifted[1::2] if proposer == "finger shift as bent" else shifted
            return [replace(standing, params=x, origin=proposer, cost=np.inf) for x in shifted]
        moved = finger_grid(self.far, standing.params, most)
        return [
            replace(standing, params=x, origin=f"{proposer}, {finger}", cost=np.inf)
            for finger, x in moved
        ]

    def fit(self, fit: Fit, candidates: Sequence[Candidate], control: Control) -> list[Candidate]:
        found = in_parallel(lambda c: self._solved(c, control), candidates)
        return [c for c in found if c is not None]

    def _solved(self, candidate: Candidate, control: Control) -> Candidate | None:
        """Return where the frame's own schedule leads from a candidate, asking there what is in view."""
        if control.should_stop():
            return None
        model = self.terms.model
        terms = self.terms.as_seen_at(model.bones(candidate.params))
        settings = self.terms.settings.solver
        found = descend(model, settings, terms, candidate.params, control.should_stop)[0].params
        return self.measured(replace(candidate, params=found))

    def measured(self, candidate: Candidate) -> Candidate:
        """Return a candidate with its energy in the narrowest band."""
        terms = self.terms.as_seen_at(self.terms.model.bones(candidate.params))
        seen = terms.stage(terms.stages - 1, self.here)
        cost = Problem(terms.model, seen, terms.priors).cost(candidate.params)
        return replace(candidate, cost=cost)

    def distinct(self, candidates: Sequence[Candidate], most: int) -> list[Candidate]:
        return sorted(candidates, key=lambda c: c.cost)[:most]


def with_fingers_found(
    terms: FrameTerms,
    params: Floats[P],
    control: Control,
    frame: int,
    why: str,
    search: Search = LOST_FINGER,
) -> Floats[P]:
    """Return solver parameters with lost fingers found; the very same where none was lost."""
    landscape = FingerLandscape.at(terms, params)
    standing = landscape.measured(Candidate(terms.model, params, origin="standing pose"))
    return improved(search, landscape, standing, control, frame, why).params
