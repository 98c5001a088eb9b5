"""A frame as a search sees it that knows little of where the hand is: silhouettes and cloud, asked coarsely.

Candidates descend with wide arms first (12 mm), are compared with short ones (4 mm), and the best are fitted as the
tracker fits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from handtrack.arrays import D3, Floats, M, P
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.size import SizeParameters
from handtrack.observation.observation import Observation
from handtrack.parallel import in_parallel
from handtrack.sampling.hypotheses import apart
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import Problem
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.frame_result import Solved
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.frame.terms.priors import SEARCH_REST_RAD, pose_priors
from handtrack.tracking.search.engine import Candidate, Fit
from handtrack.tracking.search.evidence.cloud_evidence import cloud_evidence
from handtrack.tracking.search.evidence.hand_shapes import HandShape, palm_middle, shape_of
from handtrack.tracking.search.evidence.silhouette_evidence import silhouette_evidence
from handtrack.tracking.search.evidence.source import EvidenceSource
from handtrack.tracking.search.proposers.depth_flips import depth_flips
from handtrack.tracking.search.proposers.finger_bends import finger_bends, finger_swaps
from handtrack.tracking.search.proposers.rigid_grid import rigid_grid, spread_over_places
from handtrack.tracking.search.start_confidence import BASIN_M
from handtrack.tracking.size.estimate import fit_size
from handtrack.tracking.size.person import SIZE_BANDS_MM

Resize = Callable[[ArticulatedModel, HandScale], ArticulatedModel]
"""makes the same hand in another size"""
WIDE_M, NARROW_M = 0.012, 0.004
_PROMISING = 3.0  # times the least cost, beyond which another place is not worth a look
_WAYS = 2  # of bending a pose's fingers otherwise that are proposed


@dataclass(frozen=True, eq=False)
class EvidenceLandscape:
    """One frame's evidence; see engine.Landscape."""

    sources: Sequence[EvidenceSource]
    seen: Observation
    shapes: Sequence[HandShape] = ()
    """rigid hands that the grid proposes"""
    solve: Callable[[ArticulatedModel, Floats[P], bool], Solved] | None = None
    """fits the frame from solver parameters as the tracker does; the flag: also looks for lost fingers"""
    looks_for_fingers: bool = False
    resize: Resize | None = None
    """makes the hand in another size, where its size is not known"""
    within: tuple[Floats[D3], float] | None = None
    """a point and a distance from it [m] beyond which no palm is looked for"""
    palms: Floats[M, D3] | None = None
    """around which points and pixels count; around each pose's own unless given"""
    control: Control = Control()

    @classmethod
    def of(cls, seen: Observation, settings: TrackerSettings) -> EvidenceLandscape | None:
        """Return what a frame's cloud and silhouettes say, as far as settings use them; None where they say nothing."""
        sources: list[EvidenceSource] = []
        if seen.cloud is not None and settings.cloud.weight > 0:
            cloud = cloud_evidence(seen.cloud.points, seen.cloud_views, settings.tracker.seed)
            if cloud is not None:
                sources.append(cloud)
        if seen.silhouettes and settings.silhouettes.weight > 0:
            outlines = silhouette_evidence(seen.silhouettes)
            if outlines is not None:
                sources.append(outlines)
        return cls(tuple(sources), seen) if sources else None

    def propose(self, proposer: str, found: Sequence[Candidate], most: int) -> list[Candidate]:
        stop = self.control.should_stop
        if proposer == "rigid grid":
            return rigid_grid(self.sources, self.shapes, most, stop)
        if proposer == "rigid grid nearby":
            nearby = rigid_grid(self.sources, self.shapes, most, stop, self.within)
            return [replace(c, cost=0.0) for c in nearby]  # all of them descend
        if proposer == "best of unknown size":
            return self.distinct(found, most) if self.resize else []
        if proposer == "finger bends":
            return self._bent(self.distinct(found, len(found)), most)
        if not found:
            return []
        best = min(found, key=lambda c: c.cost)
        if proposer == "standing pose":
            return [replace(best, cost=0.0)]
        if proposer == "best again":
            again = replace(best, origin=f"{best.origin}, fingers looked for")
            return [again] if self.looks_for_fingers else []
        moved = {"depth flips": self._flipped, "finger swaps": self._swapped}[proposer](best)
        return [replace(best, params=x, origin=proposer, cost=0.0) for x in moved]

    def _flipped(self, best: Candidate) -> list[Floats]:
        cameras = [silhouette.camera for silhouette in self.seen.silhouettes]
        return depth_flips(best.model, cameras, best.params)

    def _swapped(self, best: Candidate) -> list[Floats]:
        return finger_swaps(best.model, best.params)

    def _bent(self, found: Sequence[Candidate], most: int) -> list[Candidate]:
        """Return the most promising of the poses with fingers stretched or bent otherwise, of each pose two ways."""
        ways = []
        for candidate in found:
            problem = self._problem(candidate, WIDE_M)
            tried = [
                replace(candidate, params=x, cost=problem.cost(x), origin=f"{candidate.origin}, fingers bent otherwise")
                for x in finger_bends(candidate.model, candidate.params)
            ]  # fmt: skip
            ways += sorted(tried, key=lambda c: c.cost)[:_WAYS]
        return self.distinct(ways, most)

    def fit(self, fit: Fit, candidates: Sequence[Candidate], control: Control) -> list[Candidate]:
        found = in_parallel(
            lambda c: None if control.should_stop() else self._fitted(fit, c), candidates
        )
        return [c for c in found if c is not None]

    def _fitted(self, fit: Fit, candidate: Candidate) -> Candidate:
        if fit.kind in ("wide", "narrow"):
            band = WIDE_M if fit.kind == "wide" else NARROW_M
            settings = SolverSettings(iterations=fit.iterations)
            found = solve(self._problem(candidate, band), candidate.params, settings).params
            moved = replace(candidate, params=found)
            if fit.kind == "narrow":
                return self.measured(moved)
            return replace(moved, cost=self._problem(moved, band).cost(found))
        if fit.kind == "size":
            assert self.resize is not None
            exact = [
                partial(self._problem, band_m=1e-3 * mm, unbiased=True) for mm in SIZE_BANDS_MM
            ]
            problems = [partial(self._problem, band_m=WIDE_M), *exact]
            return self.measured(_sized(candidate, problems, self.resize))
        assert self.solve is not None
        solved = self.solve(
            candidate.model, candidate.params, fit.kind == "tracker with lost fingers"
        )
        params = candidate.model.transform.solver_params(solved.result.parameters)
        return self.measured(replace(candidate, params=params, solved=solved))

    def measured(self, candidate: Candidate) -> Candidate:
        """Return a candidate with the cost by which finished ones are compared: short arms, the same for all; with its forearm or
        without, whichever explains more. One that nothing shows would speak against the right pose, and for one that lays it over the fingers.
        """
        shape, model = candidate.shape, candidate.model
        cost = self.narrow_problem(candidate).cost(candidate.params)
        if model.has_forearm and shape is not None:
            bare = replace(candidate, shape=replace(shape, model=_without_arm(model)))
            cost = min(cost, self.narrow_problem(bare).cost(candidate.params))
        return replace(candidate, cost=cost)

    def compared(self, candidates: Sequence[Candidate]) -> list[Candidate]:
        """Return candidates with costs by the same points and pixels, those around any of them: where each counts those around itself
        alone, a hand that is upside down leaves out the fingers that it does not explain, and one elsewhere the hand that is not there.
        """
        palms = np.array([palm_middle(c.model, c.params) for c in candidates])
        alike = replace(self, palms=palms)
        return [alike.measured(c) for c in candidates]

    def narrow_problem(self, candidate: Candidate) -> Problem:
        """Return the problem around a pose by which finished ones are compared; of several sizes it favours none."""
        return self._problem(candidate, NARROW_M, unbiased=self.resize is not None)

    def _problem(self, candidate: Candidate, band_m: float, unbiased: bool = False) -> Problem:
        shape, model = candidate.shape, candidate.model
        assert shape is not None, "a candidate of evidence starts from a shape"
        terms = [
            term
            for source in self.sources
            for term in source.terms(shape, candidate.params, band_m, unbiased, self.palms)
        ]
        return Problem(model, terms, pose_priors(model, SEARCH_REST_RAD))

    def distinct(self, candidates: Sequence[Candidate], most: int) -> list[Candidate]:
        """Return the best, at most `most`, each pose once.

        No place takes more than half of them while another is promising: the end of an arm fits a fist in many variants,
        each a little better than the hand, whose fingers are not in place yet.
        """
        ordered = sorted(candidates, key=lambda c: c.cost)
        joints = np.array([c.joints for c in ordered])
        rows = list(apart(
            range(len(ordered)),
            lambda a, rest: np.linalg.norm(joints[rest] - joints[a], axis=2).mean(axis=1) > BASIN_M,
        ))  # fmt: skip
        palms = np.array([palm_middle(c.model, c.params) for c in ordered])
        promising = [n for n in rows if ordered[n].cost <= _PROMISING * ordered[0].cost]
        kept = [*spread_over_places(promising, palms, most), *rows[len(promising) :]]
        return sorted((ordered[n] for n in kept[:most]), key=lambda c: c.cost)


def _sized(
    candidate: Candidate,
    problems_around: Sequence[Callable[[Candidate], Problem]],
    resize: Resize,
) -> Candidate:
    """Return a pose with the overall size that explains what was seen best with it.

    The parts keep their shares: one frame, seen with a pose still wrong, would blame a bent finger on its length. What is
    looked at stays the same, so that costs can be compared. problems_around: what pulls a candidate, from far first.
    """
    for problem_around in problems_around:
        model, before = candidate.model, candidate.shape
        assert before is not None, "a candidate of evidence starts from a shape"
        free = np.array([name == "overall" for name in SizeParameters(model).names])
        problem = problem_around(candidate)
        scale, (params,) = fit_size([problem], [candidate.params], free)
        model = resize(model, scale)
        shape = shape_of(model, model.joint_params(params), before.posture)
        shape = replace(shape, reach=before.reach)
        candidate = replace(candidate, model=model, shape=shape, params=params)
    return replace(candidate, origin=f"{candidate.origin}, of another size")


@lru_cache(maxsize=8)
def _without_arm(model: ArticulatedModel) -> ArticulatedModel:
    """Return the model with a forearm that covers nothing."""
    flesh = {n: one.subset(~model.is_forearm(one.bone)) for n, one in model.flesh.items()}
    return replace(model, flesh=flesh)
