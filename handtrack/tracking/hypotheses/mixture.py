"""Several hypotheses carried over time: searched for, weighed, and those carried on that differ (2003 paper, §4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from handtrack.arrays import Floats, P, array_dataclass
from handtrack.errors import HandtrackError
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import Observation
from handtrack.sampling.chains import PreparedChain
from handtrack.sampling.suppression import apart
from handtrack.solver.covariance import covariance
from handtrack.tracking.frame.constants import APART_MM
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.descent import Descended, by_keypoints_alone, stage_problem
from handtrack.tracking.frame.frame_result import Solved, solved_result
from handtrack.tracking.frame.frame_task import FrameTask
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.frame.result import Alternative
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.frame.terms.posture import agility
from handtrack.tracking.hypotheses.mixture_search import (
    FIRST_HYPOTHESES,
    NEXT_HYPOTHESES,
    Component,
    FirstHypotheses,
    NextHypotheses,
    ReferenceCamera,
    Start,
)
from handtrack.tracking.hypotheses.motion_belief import (
    Hypothesis,
    MotionBelief,
    unknown_speed,
    with_wrapped_turn,
)
from handtrack.tracking.search.engine import Search, Tried, report, run_rounds


@array_dataclass
class Mixture:
    """The hypotheses of one frame, heaviest first, and which of the last frame's each continues."""

    hypotheses: tuple[Hypothesis, ...]
    parents: tuple[int, ...]
    """−1 in a first frame"""


@array_dataclass
class MixtureStep:
    """What is the same in every frame: model, settings, chains, and how fast parameters may change."""

    model: ArticulatedModel
    settings: TrackerSettings
    chains: Sequence[PreparedChain]

    def first(
        self,
        observation: Observation,
        terms: FrameTerms,
        start: Floats[P],
        control: Control = Control(),
    ) -> Mixture:
        """Return the hypotheses of a first frame that begins at start (P,)."""
        objective = FirstHypotheses(*self._seen(observation), terms, start)
        return self._searched(FIRST_HYPOTHESES, objective, observation, "a first frame", control)

    def next(
        self,
        observation: Observation,
        components: Sequence[Component],
        control: Control = Control(),
    ) -> Mixture:
        """Return the hypotheses of a frame from those of the last one."""
        objective = NextHypotheses(*self._seen(observation), components)
        why = f"carried on: {len(components)}"
        return self._searched(NEXT_HYPOTHESES, objective, observation, why, control)

    def _seen(
        self, observation: Observation
    ) -> tuple[
        ArticulatedModel,
        TrackerSettings,
        Sequence[PreparedChain],
        ReferenceCamera | None,
        np.random.Generator,
    ]:
        rng = np.random.default_rng([self.settings.tracker.seed, observation.frame])
        return (
            self.model,
            self.settings,
            self.chains,
            ReferenceCamera.of(self.model, observation),
            rng,
        )

    def _searched(
        self,
        search: Search,
        objective: FirstHypotheses | NextHypotheses,
        observation: Observation,
        why: str,
        control: Control,
    ) -> Mixture:
        """Return what a search finds: the heaviest of the distinct minima."""
        tried: Tried = []
        found = run_rounds(search, objective, (), control, tried=tried)
        found = [c for c in found if np.isfinite(c.cost)]
        if not found:
            raise HandtrackError(
                f"'{self.model.name}': every pose that was tried lies behind a camera. Look at the first pose and at the "
                "cameras' calibration."
            )
        kept = self._carried(objective.distinct(found, len(found)))
        report(search, control, observation.frame, why, tried, kept[0])
        cost = np.array([c.cost for c in kept])
        weights = np.exp(cost.min() - cost)
        weights /= weights.sum()
        hypotheses = (self._hypothesis(c, float(w)) for c, w in zip(kept, weights, strict=True))
        return Mixture(tuple(hypotheses), tuple(c.source.parent for c in kept))

    def _carried(self, found: Sequence[Start]) -> list[Start]:
        """Return those of the distinct minima, heaviest first, that are carried on.

        First come those to be shown, which differ in shape (the mean over the joints' distances, the root's place apart):
        what nearly looks like a heavier one is no alternative yet. Then the heaviest of the others: where a limb passes
        through the image plane, alternatives begin as small differences.
        """
        bones = [self.model.bones(c.params) for c in found]
        shapes = np.array([self.model.joint_positions(b) - b.reference for b in bones])
        own = self.settings.traits.apart_mm
        limit = 1e-3 * (APART_MM if own is None else own)
        differing = apart(
            range(len(found)),
            lambda a, rest: np.linalg.norm(shapes[rest] - shapes[a], axis=2).mean(axis=1) >= limit,
        )
        shown = list(islice(differing, self.settings.tracker.hypotheses))
        others = [n for n in range(len(found)) if n not in shown]
        quick = by_keypoints_alone(found[0].source.terms)
        more = max(self.settings.mixture.carried - len(shown), 0) if quick else 0
        return [found[n] for n in [*shown, *others[:more]]]

    def _hypothesis(self, found: Start, weight: float) -> Hypothesis:
        """Return a minimum with its motion."""
        params, source = found.params, found.source
        assert found.normal is not None
        spread = covariance(found.normal)[0]
        belief = (
            MotionBelief.at_rest(params, spread, unknown_speed(len(params)))
            if source.belief is None
            else source.belief.updated(params, spread)
        )
        return with_wrapped_turn(
            Hypothesis(params, found.energy, spread, weight, source.origin, belief)
        )

    def speed_of_change(self) -> Floats[P]:
        """Return (P,) the unknown acceleration a frame, a standard deviation [m, rad]."""
        prior, strength = self.settings.prior, self.settings.tracker.smoothing
        push = np.full(len(self.model.transform.names), np.deg2rad(prior.motion_sigma_deg))
        push[:3] = 1e-3 * prior.motion_sigma_mm
        share = agility(self.model)
        leaders = [np.flatnonzero(column)[:1] for column in self.model.transform.matrix.T]
        push *= [float(share[led[0]]) if len(led) else 1.0 for led in leaders]
        return push / np.sqrt(max(strength, 1e-6))


def solve_mixture(
    step: MixtureStep, task: FrameTask, carried: Sequence[Hypothesis]
) -> tuple[Solved, tuple[Hypothesis, ...]]:
    """Return a frame at the heaviest of the hypotheses that explain it, and all that are carried on.

    carried: those of the frame before; none in a first frame. Where nothing is seen they stay as they are.
    """
    params, terms = task.opened()
    seen = task.observation
    if not terms.has_seen:
        parents = range(len(carried))
        return _with_alternatives(task.model, task.unseen(terms), carried, parents), tuple(carried)
    if carried:
        components = [_component(step, task, hypothesis) for hypothesis in carried]
        mixture = step.next(seen, components, task.control)
        terms = components[mixture.parents[0]].terms
    else:
        terms = terms.without_motion()
        mixture = step.first(seen, terms, params, task.control)
    best = mixture.hypotheses[0].params
    problem = stage_problem(task.model, terms, terms.stages - 1, best)
    found = Descended(best, problem, 0, problem.linearize(best))
    solved = solved_result(seen, terms, found, task.previous, task.belief)
    found = _with_alternatives(task.model, solved, mixture.hypotheses, mixture.parents)
    return found, mixture.hypotheses


def _component(step: MixtureStep, task: FrameTask, hypothesis: Hypothesis) -> Component:
    """Return a hypothesis of the last frame moved on to this one."""
    goes_on = task.settings.tracker.prediction == "constant_velocity"
    belief = hypothesis.belief.ahead(step.speed_of_change(), max(task.ahead, 1), goes_on)
    belief = replace(belief, mean=task.model.clipped(belief.mean))
    bones = task.model.bones(hypothesis.params)
    texture = task.texture and replace(task.texture, bones=bones)
    terms = replace(task, expected=None, texture=texture).terms(belief.mean)
    return Component(belief, terms, hypothesis.weight)


def _with_alternatives(
    model: ArticulatedModel,
    solved: Solved,
    carried: Sequence[Hypothesis],
    parents: Sequence[int],
) -> Solved:
    alternatives = tuple(
        Alternative(model.joint_params(h.params), h.cost, h.weight, parent, h.origin)
        for h, parent in zip(carried, parents, strict=True)
    )
    return replace(solved, result=replace(solved.result, alternatives=alternatives))
