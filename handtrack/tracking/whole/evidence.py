"""What each frame of a recording says of its own pose: the narrowest stage's terms, without the pull to a prediction."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from handtrack.arrays import Floats, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import Observation
from handtrack.solver.problem import Problem
from handtrack.terms.bone_system import JointSystem
from handtrack.tracking.frame.descent import stage_problem
from handtrack.tracking.frame.frame_terms import FrameTerms, frame_terms
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.poor_cloud import poor_cloud_settings
from handtrack.tracking.whole.motion import by_change

_HELD = 400
"""frames whose terms stay in memory, about 0.3 MB each; of longer recordings they are read anew in each sweep"""
_NEW_POSE_S = 0.5
"""[s] after which a hand has another pose, the length of one movement: what is known of poses beforehand counts once in that time,
for it says the same of each frame"""

Observe = Callable[[int, BonePoses | None], Observation]
"""what is seen of a frame; see tracking.pursuit.Observe"""


@dataclass(frozen=True, eq=False)
class FrameEvidence:
    """A frame as it was seen, and what it costs."""

    observation: Observation
    terms: FrameTerms
    problem: Problem
    around: BonePoses
    """where its bands are frozen"""

    def linearize(self, pose: Floats[P]) -> JointSystem:
        """Return the frame's system by changes of its pose as `motion.moved` makes them: small turns of the root."""
        return _by_changes(self.problem.linearize(pose), pose)

    def at(self, pose: Floats[P]) -> JointSystem:
        """Return the same for a pose that may be elsewhere: it is asked what is in view there, also where the frame is silent."""
        model = self.terms.model
        terms = self.terms.as_seen_at(model.bones(pose))
        seen = terms.stage(terms.stages - 1, self.around)
        return _by_changes(Problem(model, seen, terms.priors).linearize(pose), pose)

    def seen(self, pose: Floats[P]) -> Floats[P, P]:
        """Return the part of the system's matrix that is of what was seen, without what is known of poses beforehand."""
        alone = Problem(self.problem.model, self.problem.observation_terms)
        return _by_changes(alone.linearize(pose), pose).hessian


def _by_changes(system: JointSystem, pose: Floats[P]) -> JointSystem:
    change = by_change(pose)
    hessian = change.T @ system.hessian @ change
    return JointSystem(system.cost, change.T @ system.gradient, hessian)


@dataclass(eq=False)
class Evidence:
    """The frames of a recording, read when they are asked for.

    Bands, the forearm's cut and a cloud's sharpness are those of the pose `around` which a frame is looked at, so that its
    cost is one function throughout.
    """

    model: ArticulatedModel
    settings: TrackerSettings
    observe: Observe
    around: Mapping[int, Floats[P]]
    """solver parameters by frame"""
    seconds: float
    """from one frame to the next"""
    poor: frozenset[int] = frozenset()
    """frames whose cloud is poor: its depths are doubted"""
    silent: frozenset[int] = frozenset()
    """frames in which the hand is not where it was looked for: what was seen counts for nothing"""
    _held: OrderedDict[int, FrameEvidence] = field(init=False, default_factory=OrderedDict)

    def of(self, frame: int) -> FrameEvidence:
        """Return what a frame says."""
        known = self._held.get(frame)
        if known is None:
            known = self._held[frame] = self._read(frame)
            if len(self._held) > _HELD:
                self._held.popitem(last=False)
        return known

    def elsewhere(
        self, poses: Mapping[int, Floats[P]], silent: frozenset[int], poor: frozenset[int]
    ) -> Evidence:
        """Return the evidence around other poses of some frames, other frames being silent or poor; what is known of the rest
        stays.
        """
        moved = replace(self, around={**self.around, **poses}, silent=silent, poor=poor)
        anew = set(poses) | (silent ^ self.silent) | (poor ^ self.poor)
        moved._held.update({n: f for n, f in self._held.items() if n not in anew})
        return moved

    def _read(self, frame: int) -> FrameEvidence:
        model, settings, pose = self.model, self.settings, self.around[frame]
        if frame in self.poor:
            settings = poor_cloud_settings(settings)
        share, prior = min(self.seconds / _NEW_POSE_S, 1.0), settings.prior
        rest = prior.rest_sigma_deg / share**0.5
        prior = replace(prior, rest_sigma_deg=rest, posture=share * prior.posture)
        bones = model.bones(pose)
        observation = self.observe(frame, bones)
        terms = frame_terms(model, replace(settings, prior=prior), observation, bones, None)
        terms = terms.sharpened(bones)
        problem = stage_problem(model, terms, terms.stages - 1, pose)
        if frame in self.silent:
            problem = replace(problem, observation_terms=())
        return FrameEvidence(observation, terms, problem, bones)
