"""Tracker: one observation in, one frame's pose out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from handtrack.arrays import Floats
from handtrack.geometry.rotation import closest_equivalent, wrapped
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import Observation
from handtrack.sampling.chains import chains_of, prepare
from handtrack.solver.covariance import uncertainty
from handtrack.solver.levenberg_marquardt import SolveSummary, solve
from handtrack.solver.problem import Problem
from handtrack.tracking.fallback import GOOD, POOR, Agreement, agreement, held
from handtrack.tracking.frame.appearance_terms import Before
from handtrack.tracking.frame.assessment import assess, is_suspicious, what_is_open
from handtrack.tracking.frame.constants import SEARCH_EVERY
from handtrack.tracking.frame.forearm import aimed_forearm
from handtrack.tracking.frame.frame_terms import FrameTerms, frame_terms
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.hypotheses.mixture import Component, MixtureStep
from handtrack.tracking.hypotheses.moving_hypothesis import MovingHypothesis
from handtrack.tracking.prediction import inheriting_doubt, predict
from handtrack.tracking.search.escape import escape
from handtrack.tracking.search.restart import recovered

Watch = Callable[[int, Floats, float], None]
"""called after each accepted solver step with its count, parameters (P,) and cost"""


@dataclass(frozen=True)
class Tracker:
    """A model and settings; immutable. What happened before is handed in, so that any frame can be redone."""

    model: ArticulatedModel
    settings: TrackerSettings = TrackerSettings()

    def step(
        self,
        observation: Observation,
        previous: Sequence[FrameResult] = (),
        start: Floats | None = None,
        should_stop: Callable[[], bool] | None = None,
        on_iteration: Watch | None = None,
        before: Observation | None = None,
        given: Before | None = None,
    ) -> FrameResult:
        """Return the pose of one frame.

        previous: results in the order they were tracked, the latest last; they give the start and the
        expected pose. start: solver parameters (P,) to begin from instead. At least one of the two.
        before: what was seen of one of those frames, the latest that was not lost; the model's texture is carried
        from it, and from `given`, the frame with which tracking started.
        """
        result = self._solved_step(
            observation, previous, start, should_stop, on_iteration, before, given
        )
        chosen = self.settings.tracker
        if not chosen.recovery or chosen.hypotheses > 1 or not previous:
            return result
        plain = replace(self.settings, tracker=replace(chosen, recovery=False))
        return recovered(
            self.model,
            plain,
            observation,
            result,
            previous,
            lambda x: Tracker(self.model, plain).step(observation, (), x, should_stop),
            should_stop,
        )

    def _solved_step(
        self,
        observation: Observation,
        previous: Sequence[FrameResult],
        start: Floats | None,
        should_stop: Callable[[], bool] | None,
        on_iteration: Watch | None,
        before: Observation | None,
        given: Before | None,
    ) -> FrameResult:
        """Return the pose that descent reaches from where the hand is expected, or from `start`."""
        expected = self._expected(observation.frame, previous)
        first = start is not None
        if start is None:
            assert expected is not None, "a first frame needs a start"
            start = self.model.transform.solver_params(expected)
        params = self.model.clipped(start)
        if expected is not None:
            expected[3:6] = closest_equivalent(expected[3:6], self.model.joint_params(params)[3:6])
        ahead = abs(observation.frame - previous[-1].frame) if previous else 1
        solved = self._solved(before, previous, given)
        terms = self._terms(observation, params, expected, ahead, solved)
        if not terms.has_seen:
            if previous:  # what moved on unseen is not known: the last estimate is held
                params = self.model.transform.solver_params(previous[-1].parameters)
            elif observation.images:
                return self._as_given(observation, params)
            unseen = self._unseen(observation, params)
            kept = previous[-1].hypotheses if previous else ()
            return replace(unseen, hypotheses=kept, parents=tuple(range(len(kept))))
        if first and self.model.has_forearm:
            params = aimed_forearm(self._problem(terms, 0, params), params)
            terms = self._terms(observation, params, expected, ahead, solved)
        if self.settings.tracker.hypotheses > 1:
            return self._mixed(observation, terms, params, previous, solved, should_stop)
        if previous and previous[-1].poor_cloud and self._may_doubt(terms):
            doubted = self._held(observation, params, previous, should_stop, on_iteration)
            params = self.model.transform.solver_params(doubted.parameters)
            poor = self._poor(terms, params, GOOD)
            if poor is not None:
                return poor.told(doubted)
        summary, problem, count = self._descend(terms, params, should_stop, on_iteration)
        due = self._is_due(observation.frame) or is_suspicious(summary.cost, terms.views, previous)
        if due and self.settings.tracker.escape:
            free = terms.without_motion()
            here = self.model.bones(summary.params)

            def measured(x: Floats) -> float:
                seen = free.looked_at(self.model.bones(x)).stage(free.stages - 1, here)
                return Problem(self.model, seen, free.priors).cost(x)

            def descended(x: Floats) -> Floats:
                there = free.looked_at(self.model.bones(x))
                return self._descend(there, x, should_stop, None)[0].params

            far = self._problem(free, 0, summary.params)
            found = escape(far, measured, summary.params, descended, should_stop)
            if found is not summary.params:
                free = free.looked_at(self.model.bones(found))
                summary, problem, more = self._descend(free, found, should_stop, on_iteration)
                count += more
        poor = self._poor(terms, summary.params, POOR)
        if poor is not None:
            return poor.told(self._held(observation, params, previous, should_stop, on_iteration))
        params, exact, more = self._refined(terms, summary.params, should_stop)
        return self._result(observation, terms, problem, params, count + more, previous, exact)

    def _refined(
        self, terms: FrameTerms, params: Floats, should_stop: Callable[[], bool] | None
    ) -> tuple[Floats, Problem | None, int]:
        """Return the pose that a cloud gives which lies nearer than usual, its problem, iterations; what is given elsewhere.

        Poses are compared before, as energies are: with the same spread for all of them.
        """
        fine = terms.sharpened(self.model.bones(params))
        if fine is terms:
            return params, None, 0
        exact = self._problem(fine, fine.stages - 1, params)
        share = max(self.settings.solver.iterations // fine.stages, 1)
        settings = replace(self.settings.solver, iterations=share)
        summary = solve(exact, params, settings, should_stop)
        return summary.params, exact, summary.iterations

    def _may_doubt(self, terms: FrameTerms) -> bool:
        """Return whether a cloud alone holds the hand, and something may be done about it where it is poor."""
        chosen = self.settings
        allowed = chosen.model.fallback != "none" and not chosen.cloud.doubt_depth
        allowed = allowed and self.model.has_keypoints21
        return allowed and terms.cloud is not None and terms.views == 1 and not terms.keypoints

    def _poor(self, terms: FrameTerms, params: Floats, below: float) -> Agreement | None:
        """Return what is wrong with a cloud that alone must hold the hand and agrees less than that with it, or None."""
        if terms.cloud is None or not self._may_doubt(terms):
            return None
        found = agreement(terms.cloud, self.model, self.model.bones(params))
        return found if found is not None and found.share < below else None

    def _held(
        self,
        observation: Observation,
        params: Floats,
        previous: Sequence[FrameResult],
        should_stop: Callable[[], bool] | None,
        on_iteration: Watch | None,
    ) -> FrameResult:
        """Return the frame by a poor cloud."""

        def step(
            model: ArticulatedModel,
            settings: TrackerSettings,
            last: Sequence[FrameResult],
            start: Floats | None,
            watch: Watch | None,
        ) -> FrameResult:
            return Tracker(model, settings).step(observation, last, start, should_stop, watch)

        return held(self.model, self.settings, params, previous[-1:], step, on_iteration)

    def expected_bones(self, frame: int, previous: Sequence[FrameResult]) -> BonePoses | None:
        """Return the hand where `step` will look for it; None where it was lost, or nothing came before."""
        expected = self._expected(frame, previous)
        if expected is None or previous[-1].status == Status.LOST:
            return None
        return self.model.bones(self.model.transform.solver_params(expected))

    def _is_due(self, frame: int) -> bool:
        """Return whether lost fingers are looked for in this frame anyway."""
        return frame % SEARCH_EVERY == SEARCH_EVERY - 1

    def _expected(self, frame: int, previous: Sequence[FrameResult]) -> Floats | None:
        if not previous:
            return None
        known = None
        steady = previous[-1].poor_cloud  # a velocity from poor poses is mostly their errors
        if self.settings.tracker.prediction == "constant_velocity" and not steady:
            known = predict(self.model, previous, frame)
        return previous[-1].parameters.copy() if known is None else known

    def _solved(
        self, before: Observation | None, previous: Sequence[FrameResult], given: Before | None
    ) -> Before | None:
        """Return what was seen together with where the model was then."""
        if before is None or not self.settings.looks_at_images:
            return None
        then = [result for result in previous if result.frame == before.frame]
        assert then, f"frame {before.frame} is not among the previous results"
        if given is not None and given.seen.frame == before.frame:
            given = None
        params = self.model.transform.solver_params(then[-1].parameters)
        return Before(before, self.model.bones(params), given)

    def _terms(
        self,
        observation: Observation,
        params: Floats,
        expected: Floats | None,
        ahead: int,
        before: Before | None,
    ) -> FrameTerms:
        bones = self.model.bones(params)
        return frame_terms(self.model, self.settings, observation, bones, expected, ahead, before)

    @cached_property
    def _mixture_step(self) -> MixtureStep:
        chains = [prepare(self.model, chain) for chain in chains_of(self.model)]
        return MixtureStep(self.model, self.settings, chains)

    def _mixed(
        self,
        observation: Observation,
        terms: FrameTerms,
        params: Floats,
        previous: Sequence[FrameResult],
        before: Before | None,
        should_stop: Callable[[], bool] | None,
    ) -> FrameResult:
        """Return the heaviest of the hypotheses that explain the frame, and the others with it."""
        step = self._mixture_step
        carried = previous[-1].hypotheses if previous else ()
        moving = [h for h in carried if isinstance(h, MovingHypothesis)]
        if moving:
            components = [self._component(observation, h, previous[-1], before) for h in moving]
            mixture = step.next(observation, components, should_stop)
            terms = components[mixture.parents[0]].terms
        else:
            terms = terms.without_motion()
            mixture = step.first(observation, terms, params, should_stop)
        best = mixture.hypotheses[0]
        problem = self._problem(terms, terms.stages - 1, best.params)
        result = self._result(observation, terms, problem, best.params, 0, previous)
        return replace(result, hypotheses=mixture.hypotheses, parents=mixture.parents)

    def _component(
        self,
        observation: Observation,
        hypothesis: MovingHypothesis,
        last: FrameResult,
        before: Before | None,
    ) -> Component:
        """Return a hypothesis of the last frame moved on to this one."""
        ahead = max(abs(observation.frame - last.frame), 1)
        goes_on = self.settings.tracker.prediction == "constant_velocity"
        belief = hypothesis.belief.ahead(self._mixture_step.speed_of_change(), ahead, goes_on)
        belief = replace(belief, mean=self.model.clipped(belief.mean))
        if before is not None:
            before = replace(before, bones=self.model.bones(hypothesis.params))
        terms = self._terms(observation, belief.mean, None, ahead, before)
        return Component(belief, terms, hypothesis.weight)

    def _problem(self, terms: FrameTerms, stage: int, params: Floats) -> Problem:
        seen = terms.stage(stage, self.model.bones(params))
        return Problem(self.model, seen, terms.priors)

    def _descend(
        self,
        terms: FrameTerms,
        params: Floats,
        should_stop: Callable[[], bool] | None,
        on_iteration: Watch | None,
    ) -> tuple[SolveSummary, Problem, int]:
        """Run the schedule: wide bands first, each from where the one before ended."""
        done, left = 0, self.settings.solver.iterations
        for stage in range(terms.stages):
            share = max(left // (terms.stages - stage), 1)
            problem = self._problem(terms, stage, params)
            settings = replace(self.settings.solver, iterations=share)
            offset = done

            def watch(k: int, x: Floats, cost: float, offset: int = offset) -> None:
                if on_iteration is not None:
                    on_iteration(offset + k, x, cost)

            summary = solve(problem, params, settings, should_stop, watch)
            params = summary.params
            done, left = done + summary.iterations, left - summary.iterations
            if summary.why == "stopped":
                break
        return summary, problem, done

    def _result(
        self,
        observation: Observation,
        terms: FrameTerms,
        problem: Problem,
        params: Floats,
        iterations: int,
        previous: Sequence[FrameResult],
        exact: Problem | None = None,
    ) -> FrameResult:
        params = params.copy()
        system = problem.linearize(params)
        known = system if exact is None else exact.linearize(params)
        last = exact or problem
        alone = Problem(self.model, last.observation_terms).linearize(params)
        sure = inheriting_doubt(last, params, known.hessian, previous)
        spread = uncertainty(self.model, params, sure, alone.hessian)
        status, note = assess(terms, self.model.bones(params), system.cost, previous)
        unknown = False
        if status == Status.TRACKED:
            most = self.settings.tracker.doubtful_mm
            note = what_is_open(self.model, spread.joint_covariance, most)
            unknown = note != ""
            status = Status.DOUBTFUL if unknown else status
        std = (
            np.full_like(spread.parameter_std, np.inf)
            if status == Status.LOST
            else spread.parameter_std
        )
        found = self._filled(
            observation, params, status, system.cost, iterations, std, spread.joint_covariance, note
        )
        parts = problem.costs(params)
        return replace(found, energies=parts, covariance=spread.covariance, unknown=unknown)

    def _as_given(self, observation: Observation, params: Floats) -> FrameResult:
        """Return a first frame that is only to be compared with those after it."""
        held = self._unseen(observation, params)
        note = "the pose is the given one; its texture is carried from here on"
        return replace(held, status=Status.DOUBTFUL, note=note)

    def _unseen(self, observation: Observation, params: Floats) -> FrameResult:
        joints = len(self.model.joint_names)
        unknown = np.full(len(self.model.parameter_names), np.inf)
        far = np.tile(np.eye(3), (joints, 1, 1))  # a metre: nothing is known
        note = "no camera saw anything in this frame"
        if observation.cloud is not None and self.settings.cloud.weight > 0:
            note = (
                f"the cloud has hardly any points within {self.settings.cloud.crop_mm:g} mm of where the hand was "
                "expected"
            )
        return self._filled(observation, params, Status.LOST, float("nan"), 0, unknown, far, note)

    def _filled(
        self,
        observation: Observation,
        params: Floats,
        status: Status,
        energy: float,
        iterations: int,
        std: Floats,
        joint_covariance: Floats,
        note: str,
    ) -> FrameResult:
        joint = self.model.joint_params(params)
        joint[3:6] = wrapped(joint[3:6])
        bones = self.model.bones(params)
        return FrameResult(
            frame=observation.frame,
            time_s=observation.time_s,
            parameters=joint,
            status=status,
            energy=energy,
            iterations=iterations,
            parameter_std=std,
            joint_covariance=joint_covariance,
            T_world_bone=bones.T_world_bone,
            joint_positions=self.model.joint_positions(bones),
            keypoints21=self.model.keypoints21(bones) if self.model.has_keypoints21 else None,
            note=note,
        )
