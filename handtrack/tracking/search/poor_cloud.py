"""When a cloud alone must hold the hand and is poor: its depths are doubted, and the frame says so.

Or a simpler hand takes its place, as in the 2004 paper, section 3.5.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from handtrack.arrays import Floats, P, S
from handtrack.geometry.rotation import closest_equivalent, wrapped
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.model_file import load_model
from handtrack.solver.covariance import joint_position_jacobian
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.frame_result import Solved
from handtrack.tracking.frame.frame_task import FrameTask
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.frame.terms.cloud_terms import Agreement, agreement
from handtrack.tracking.search.engine import Candidate, Fit, Tried, run_rounds, tell
from handtrack.tracking.search.initialize import carried_over
from handtrack.tracking.search.policy import GOOD, POOR, POOR_CLOUD


def may_doubt(terms: FrameTerms) -> bool:
    """Return whether a cloud alone holds the hand, and something may be done about it where it is poor."""
    chosen = terms.settings
    if terms.cloud is None or terms.views != 1 or terms.keypoints or chosen.cloud.doubt_depth:
        return False
    one = len(terms.cloud.views) == 1  # else lines of sight are not known
    useless = ("none",) if one else ("none", "auto")
    return terms.model.has_keypoints21 and chosen.model.fallback not in useless


def poor_agreement(terms: FrameTerms, params: Floats[P], below: float) -> Agreement | None:
    """Return what is wrong with a cloud that alone must hold the hand and agrees less than that with it at a pose;
    None where all is well.
    """
    if terms.cloud is None or not may_doubt(terms):
        return None
    found = agreement(terms.cloud, terms.model, terms.model.bones(params))
    # of a hand that was measured the depths are right, whatever else the cloud shows; nothing in view: nothing is wrong
    return found if max(found.share, found.measured) < below else None


@dataclass(frozen=True)
class Simplified:
    """A simpler hand in the place of a whole one."""

    model: ArticulatedModel
    start: Floats[P]
    """its solver parameters (P',) where the whole hand stands"""
    whole: Callable[[Floats[P]], Floats[P]]
    """its solver parameters → the whole hand's joint parameters (S,), fingers kept as they are"""


def simplified(model: ArticulatedModel, joint: Floats[S], kind: str) -> Simplified:
    """Return the simpler hand, `glove9` or `ball6`, that stands where the whole one stands with joint parameters.

    It is as large as the person's, with the same parts; a simpler hand has no internal proportions.
    """
    few = load_model(kind, model.side, HandScale(model.scale.overall, model.scale.parts))

    def whole(params: Floats) -> Floats:
        held = joint.copy()
        held[:6] = few.joint_params(params)[:6]
        return held

    start = carried_over(model, model.transform.solver_params(joint), few)
    return Simplified(few, start, whole)


def poor_cloud_settings(settings: TrackerSettings) -> TrackerSettings:
    """Return the settings for a poor cloud: doubted depths, and nothing extrapolated or looked for.

    A velocity from two poor poses would be mostly their errors; a lost finger cannot be looked for, nor a lost hand: among
    wrong points another pose often fits better.
    """
    cloud = replace(settings.cloud, doubt_depth=True)
    follow = replace(
        settings.tracker,
        prediction="none",
        escape=False,
        recovery=False,
    )
    calm = replace(settings.model, fallback="none")
    return replace(settings, model=calm, cloud=cloud, tracker=follow)


@dataclass(frozen=True, eq=False)
class PoorCloudLandscape:
    """One frame with a poor cloud; see engine.Landscape. It is solved from where the hand was last."""

    task: FrameTask
    calm: FrameTask
    """the same with the settings for a poor cloud, and nothing known but the last pose"""
    params: Floats[P]
    """(P,) where a first frame begins"""
    solve: Callable[[FrameTask], Solved]
    """solves a frame as it is described"""

    @classmethod
    def of(
        cls, task: FrameTask, params: Floats[P], solve: Callable[[FrameTask], Solved]
    ) -> PoorCloudLandscape:
        """Return the landscape of a frame; in a first frame from params (P,)."""
        settings, last = poor_cloud_settings(task.settings), task.previous[-1:]
        calm = replace(task, settings=settings, texture=None, previous=last)
        if last and last[0].status == Status.LOST:
            calm = replace(calm, belief=None)
        return cls(task, calm, params, solve)

    def propose(self, proposer: str, found: Sequence[Candidate], most: int) -> list[Candidate]:
        model, last, kind = self.task.model, self.calm.previous, self.task.settings.model.fallback
        if proposer == "depths doubted" and kind == "auto":
            place = model.transform.solver_params(last[0].parameters) if last else self.params
            return [Candidate(model, place, origin=proposer)]
        if proposer == kind:
            return [Candidate(self._few.model, self._few.start, origin=proposer)]
        return []

    def fit(self, fit: Fit, candidates: Sequence[Candidate], control: Control) -> list[Candidate]:
        return [self._fitted(c) for c in candidates]

    def _fitted(self, candidate: Candidate) -> Candidate:
        whole = self.task.model
        calm = self.calm if candidate.model is whole else self._simpler
        solved = self.solve(_started(calm, candidate.params))
        if candidate.model is not whole:
            solved = Solved(_in_whole(whole, solved.result, self._few))
        found = solved.result
        params = whole.transform.solver_params(found.parameters)
        return replace(candidate, model=whole, params=params, cost=found.energy, solved=solved)

    def distinct(self, candidates: Sequence[Candidate], most: int) -> list[Candidate]:
        return list(candidates)[:most]  # there is but one

    @cached_property
    def _few(self) -> Simplified:
        last, model = self.calm.previous, self.task.model
        joint = last[0].parameters if last else model.joint_params(self.params)
        return simplified(model, joint, self.task.settings.model.fallback)

    @property
    def _simpler(self) -> FrameTask:
        """The frame as the simpler hand sees it; whoever looks on is shown the whole one."""
        few, shown = self._few, self.task.control.on_iteration
        places = few.model.joint_params(few.start)
        previous = tuple(replace(result, parameters=places) for result in self.calm.previous)

        def watch(number: int, k: int, x: Floats, cost: float) -> None:
            if shown is not None:
                params = self.task.model.transform.solver_params(few.whole(x))
                shown(number, k, params, cost)

        control = replace(self.task.control, on_iteration=watch)
        return replace(self.calm, model=few.model, previous=previous, control=control)


def solve_doubted(
    task: FrameTask,
    terms: FrameTerms,
    params: Floats[P],
    solve: Callable[[FrameTask], Solved],
    poor: Agreement | None = None,
) -> tuple[Solved, bool]:
    """Return the frame by a poor cloud, and whether it is poor indeed; in a first frame from params (P,).

    poor: what is wrong with the cloud where the frame's own descent ended; None after a poor frame: then it is asked
    where this search ends.
    """
    tried: Tried = []
    landscape = PoorCloudLandscape.of(task, params, solve)
    (found,) = run_rounds(POOR_CLOUD, landscape, (), task.control, tried=tried)
    assert found.solved is not None
    least = GOOD if poor is None else POOR
    poor = poor or poor_agreement(terms, found.params, least)
    why = "cloud and hand agree again after a poor frame"
    if poor is not None:
        why = f"cloud and hand agree by {poor.share:.2f}, at least {least:g} is asked for"
    winner = found if poor is not None else None
    tell(POOR_CLOUD, task.control, task.observation.frame, why, tried, winner)
    if poor is None:
        return found.solved, False
    return _marked(found.solved, poor, task.settings.model.fallback), True


def _marked(solved: Solved, poor: Agreement, fallback: str) -> Solved:
    """Return a frame that was solved with doubted depths as one that is in doubt itself, and why."""
    simpler = "" if fallback == "auto" else fallback
    reason = Reason("poor cloud", simpler, number=poor.measured, other=poor.explained)
    status = max(solved.result.status, Status.DOUBTFUL)
    return replace(solved, result=replace(solved.result, status=status, reason=reason))


def _started(calm: FrameTask, params: Floats) -> FrameTask:
    """Return a frame that begins at params (P,) and expects the hand where it was last."""
    start = calm.model.clipped(params)
    if not calm.previous:
        return replace(calm, start=start, expected=None)
    expected = calm.previous[-1].parameters.copy()
    expected[3:6] = closest_equivalent(expected[3:6], calm.model.joint_params(start)[3:6])
    return replace(calm, start=start, expected=expected)


def _in_whole(model: ArticulatedModel, found: FrameResult, few: Simplified) -> FrameResult:
    """Return what a simpler hand found as a result of the whole one.

    Nothing is said of the fingers: their standard deviations are infinite, and their joints may be as far off as their
    limits let them.
    """
    joint = few.whole(few.model.transform.solver_params(found.parameters))
    joint[3:6] = wrapped(joint[3:6])
    std = np.full(len(joint), np.inf)
    std[:6] = found.parameter_std[:6]
    bones, jacobian, _ = model.linearize(model.transform.solver_params(joint))
    limits = model.limits.bounds(joint)
    spread = np.zeros(len(joint))
    spread[6:] = np.diff(limits[6:], axis=1)[:, 0] ** 2 / 12.0  # anywhere between them
    spread[:6] = np.where(np.isfinite(std[:6]), std[:6], 1.0) ** 2
    moves = joint_position_jacobian(model, bones, jacobian)
    return replace(
        found,
        parameters=joint,
        status=max(found.status, Status.DOUBTFUL),
        parameter_std=np.full_like(std, np.inf) if found.status == Status.LOST else std,
        joint_covariance=np.einsum("jas,s,jbs->jab", moves, spread, moves),
        T_world_bone=bones.T_world_bone,
        joint_positions=model.joint_positions(bones),
        keypoints21=model.keypoints21(bones) if model.has_keypoints21 else None,
    )
