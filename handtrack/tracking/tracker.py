"""Tracker: a state and an observation in, the next state and the frame's result out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import takewhile
from typing import Any

from handtrack.arrays import Floats, S
from handtrack.errors import HandtrackError
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import Observation, check_kind
from handtrack.parallel import one_blas_thread
from handtrack.terms.term import ObservationTerm, ParameterTerm
from handtrack.tracking.find_pose import SURE
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.frame_task import FrameTask, TrackerState, predict
from handtrack.tracking.frame.result import FrameResult, Status, Step, unconfirmed
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.frame.terms.appearance_terms import Before
from handtrack.tracking.hypotheses.mixture import solve_mixture
from handtrack.tracking.search.frame_solve import solve_frame
from handtrack.tracking.search.global_search import searches_everywhere, with_hand_recovered
from handtrack.tracking.size.person import Subject
from handtrack.tracking.whole.refinement import CameraError

CONFIRMED_BY = 5
"""frames in a row, tracked by their own evidence, by which an unsure first pose is confirmed; chosen by hand"""


@dataclass(frozen=True)
class Tracker:
    """A model and settings; immutable. What happened before is in the state, so that any frame can be redone."""

    model: ArticulatedModel
    settings: TrackerSettings = TrackerSettings()
    terms: Sequence[ObservationTerm] = ()
    """costs of the caller's own, of bone poses: they count in every frame in which anything was seen"""
    priors: Sequence[ParameterTerm] = ()
    """the same, of joint parameters"""
    start_confidence: float = 1.0
    """0 to 1, how sure the pose is that a first frame begins with: no frame is called surer before some have confirmed it"""
    subject: Subject | None = None
    """what is found of the person when a recording is refined"""
    cameras: tuple[CameraError, ...] = ()
    """what refining a recording found of its cameras, by which frames beside new poses follow"""

    def __post_init__(self) -> None:
        """Take lists of terms, and one for several. Raises HandtrackError for what is of another kind."""
        check_kind(self.model, ArticulatedModel, "model", "load_model('hand26')")
        how = "TrackerSettings().with_values({'solver.iterations': 10, …})"
        check_kind(self.settings, TrackerSettings, "settings", how)
        for name, kind in (("terms", ObservationTerm), ("priors", ParameterTerm)):
            value = getattr(self, name)
            several = tuple(value) if isinstance(value, list | tuple) else (value,)
            for one in several:
                how = f"{kind.__name__}s (docs/contributing/adding_a_term.md)"
                check_kind(one, kind, name, how)
            object.__setattr__(self, name, several)

    def step(
        self, state: TrackerState, observation: Observation, control: Control = Control()
    ) -> tuple[TrackerState, FrameResult]:
        """Return the state after a frame, and the frame's result.

        Parameters
        ----------
        state
            `TrackerState.beginning_at(pose)` for a first frame, then the one that was returned
            last. A step that is stopped returns what it has; its state is not to be stepped from.
        """
        check_kind(state, TrackerState, "state", "TrackerState.beginning_at(params)")
        check_kind(observation, Observation, "observation", "Observation(frame, time_s, …)")
        after, solved = self._stepped(state, observation, control)
        return after, solved.result

    def step_without_search(
        self, state: TrackerState, observation: Observation, control: Control = Control()
    ) -> tuple[TrackerState, FrameResult, bool]:
        """Return what `step` does if its searches find nothing, without making them; and whether any is due."""
        control = replace(control, searches=False)
        after, solved = self._stepped(state, observation, control)
        return after, solved.result, solved.search_due

    @one_blas_thread
    def _stepped(
        self, state: TrackerState, observation: Observation, control: Control
    ) -> tuple[TrackerState, Step]:
        task = self._task(state, self._looked_at(state, observation), control)
        if self.settings.tracker.hypotheses > 1:
            solved = solve_mixture(task)
        else:
            solved = solve_frame(task)
            if self.settings.tracker.recovery:
                solved = with_hand_recovered(task, solved)
        solved = replace(solved, result=self._as_sure_as_the_start(state, solved.result))
        return state.after(solved, self.texture_from(observation, solved.result)), solved

    def _as_sure_as_the_start(self, state: TrackerState, result: FrameResult) -> FrameResult:
        """Return a frame as doubtful as an unsure start, unless frames in a row have confirmed it by their own evidence."""
        if self.start_confidence >= SURE or result.status != Status.TRACKED:
            return result
        if any(before.status == Status.TRACKED for before in state.results):
            return result
        row = list(takewhile(lambda before: before.reason_kind == "start", reversed(state.results)))
        return (
            result if len(row) >= CONFIRMED_BY - 1 else unconfirmed(result, self.start_confidence)
        )

    def expected_bones(self, state: TrackerState, frame: int) -> BonePoses | None:
        """Return the hand where `step` will look for it; None where it looks everywhere for one that was lost."""
        if state.start is not None:
            return self.model.bones(state.start)
        expected = self._expected(state, frame)
        if expected is None or searches_everywhere(state.results):
            return None
        return self.model.bones(self.model.solver_params(expected))

    def with_custom_terms(self, observation: Observation) -> Observation:
        """Return what was seen of a frame, together with the caller's own terms."""
        if observation.is_empty or not (self.terms or self.priors):
            return observation
        return replace(
            observation,
            terms=_joined(observation.terms, self.terms),
            priors=_joined(observation.priors, self.priors),
        )

    def _looked_at(self, state: TrackerState, observation: Observation) -> Observation:
        """Return what the method looks at in a frame: where joints only begin, joints alone or anything else."""
        if not (self.settings.traits.joints_begin and observation.keypoints):
            return observation
        if state.start is None:
            return replace(observation, keypoints=())
        return replace(observation, silhouettes=(), images=(), cloud=None)

    def _task(self, state: TrackerState, observation: Observation, control: Control) -> FrameTask:
        """Return the frame to be solved, from where the hand is expected."""
        observation = self.with_custom_terms(observation)
        expected, start = self._expected(state, observation.frame), state.start
        if start is None:
            if expected is None:
                raise HandtrackError(
                    f"frame {observation.frame}: the tracker has no pose to start from. Begin with "
                    "`TrackerState.beginning_at(params)`; `find_pose(model, observation)` finds params."
                )
            start = self.model.solver_params(expected)
        else:
            start = self.model.checked(start, "the pose to start from")
        if self.settings.solver.limits != "none":
            start = self.model.clipped(start)
        return FrameTask(self.model, self.settings, observation, start, state, expected, control)

    def _expected(self, state: TrackerState, frame: int) -> Floats | None:
        """Return joint parameters (S,) where the hand is expected; None in a first frame."""
        last = state.last
        if last is None:
            return None
        known = None
        # a velocity from poor poses is mostly their errors
        if self.settings.tracker.prediction == "constant_velocity" and not last.clutters:
            known = _predicted(self.model, state, frame)
        return last.parameters if known is None else known

    def texture_from(self, observation: Observation, result: FrameResult) -> Before | None:
        """Return a frame's images together with the model as it was found in them; None where images are not looked at."""
        if not self.settings.uses_images:
            return None
        params = self.model.solver_params(result.parameters)
        return Before(observation, self.model.bones(params))


@lru_cache(maxsize=4)
def _predicted(model: ArticulatedModel, state: TrackerState, frame: int) -> Floats[S] | None:
    """Return what `predict` does: of each frame it is asked where to look for the hand, and again where to begin."""
    return predict(model, state.results, frame)


def _joined(seen: Sequence[Any], own: Sequence[Any]) -> tuple[Any, ...]:
    """Return terms of both, each once: what was seen may have them already."""
    return (*seen, *(term for term in own if not any(term is other for other in seen)))
