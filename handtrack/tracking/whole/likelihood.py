"""What each frame of a recording says of its own pose: the narrowest stage's terms, without the pull to a prediction."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from handtrack.arrays import F, Floats, P, array_dataclass, evenly_spread
from handtrack.geometry.camera import Camera
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import (
    CLOUD_NAME,
    ImageKeypoints,
    Keypoints,
    Observation,
    Silhouette,
)
from handtrack.observation.pins import ImagePins
from handtrack.solver.problem import Problem
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.priors import GaussianPrior
from handtrack.terms.term import JointSystem, ObservationTerm
from handtrack.tracking.frame.control import Control, Observe
from handtrack.tracking.frame.descent import only_camera, stage_problem
from handtrack.tracking.frame.frame_terms import FrameTerms, at_camera_times, by_camera, frame_terms
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.frame_solve import poor_cloud_settings
from handtrack.tracking.size.cameras import IN_STEP, WIDER, CameraChanges, velocities
from handtrack.tracking.size.estimate import FrameProblem, Shared, WholeEstimate, by_changes
from handtrack.tracking.size.motion import Motion
from handtrack.tracking.size.person import PersonChange, Subject
from handtrack.tracking.whole.refinement import CameraError

_HELD = 400
"""frames whose terms stay in memory, about 0.3 MB each, 1 MB with a cloud; of longer recordings they are read anew in each sweep"""
NEW_POSE_S = 0.5
"""[s] after which a hand has another pose, the length of one movement: what is known of poses beforehand counts once in that time,
for it says the same of each frame"""

_LARGEST = 3.0
"""sigmas from which a joint was mistaken, and its error is no detector's usual one: where the robust loss lets go"""
_OUTLINES = 16
"""frames in which outlines are measured: a median to some per cent"""
_LONGEST = 0.9
"""correlation above which few frames can't tell it from 1"""

_SET_RAD, _SET_M = np.deg2rad(3.0), 0.003
"""standard deviations of what a person sets: a finger's tip to some millimetres"""

MOSTLY_NEW = 0.5
"""share of a frame that is new from which its errors hardly last: those of joints are correlated by less than a third"""


@array_dataclass
class Recording:
    """What the estimate of a whole recording is told."""

    model: ArticulatedModel
    settings: TrackerSettings
    observe: Observe
    control: Control = Control()
    keyframes: Mapping[int, Floats[P]] = field(default_factory=dict)
    """solver parameters by frame of poses that a person set; what lies beside follows, unless they are among the tracked"""
    pinned: Mapping[int, Floats[P]] = field(default_factory=dict)
    """likewise of tracked frames to which a person's pins led: they are refined by their pins"""
    subject: Subject | None = None
    """what is found of the person: the frames are this person's then"""
    cameras: tuple[CameraError, ...] = ()
    """what an estimate of all frames found, by which frames beside new poses follow"""


def frame_seconds(tracked: Sequence[FrameResult]) -> float:
    """Return how long a frame lasts [s]; 1 where nobody knows."""
    lasted = abs(tracked[-1].time_s - tracked[0].time_s) if len(tracked) > 1 else 0.0
    return lasted / max(len(tracked) - 1, 1) or 1.0


@array_dataclass
class FrameLikelihood(FrameProblem):
    """A frame as it was seen, and what it costs; its images are not kept, which take ten times as much."""

    terms: FrameTerms
    around: BonePoses
    """where its bands are frozen"""

    @cached_property
    def problem(self) -> Problem:
        """All of it, through the cameras as they were calibrated."""
        seen = [term for view in self.views for term in view.observation_terms]
        return Problem(
            self.prior.model, [*seen, *self.others.observation_terms], self.prior.parameter_terms
        )

    def observed_by(self, found: WholeEstimate, n: int) -> tuple[FrameTerms, Problem]:
        """Return the terms and the whole problem at the n-th pose, where cameras are as they must have been and saw when they did, and
        masks are as wide as they are.
        """
        changes, pose = found.cameras, found.poses[n]
        wider = dict(zip(changes.names, changes.values[:, WIDER].tolist(), strict=True))
        cameras, detector = (
            {c.name: c for c in changes.corrected(by_joints)} for by_joints in (False, True)
        )
        terms = _through(self.terms, cameras, detector, wider)
        own = dict(zip((*changes.names, CLOUD_NAME), found.moments[:, n].tolist(), strict=True))
        terms = at_camera_times(terms, own, pose, found.speeds[n])
        return terms, stage_problem(terms, pose)

    def plain(self, pose: Floats[P]) -> JointSystem:
        """Return the system of the pose alone, through the cameras as they were calibrated."""
        return by_changes(self.problem.linearize(pose), pose)

    def at(self, pose: Floats[P]) -> JointSystem:
        """Return the same for a pose that may be elsewhere: it is asked what is in view there, also where the frame is silent."""
        model = self.terms.model
        terms = self.terms.coarser(self.share**-0.5).visible_at(model.bones(pose))
        seen = terms.stage(self.around)
        return by_changes(Problem(model, seen, terms.priors).linearize(pose), pose)


@dataclass(eq=False)
class RecordingLikelihood:
    """The frames of a recording, read when they are asked for.

    Bands, the forearm's cut and a cloud's sharpness are those of the pose `around` which a frame is looked at, so that its
    cost is one function throughout.
    """

    recording: Recording
    """whose keyframes are there as exactly as a hand sets them, and of whose `cameras` it is known what they are off by"""
    around: Mapping[int, Floats[P]]
    """solver parameters by frame"""
    seconds: float
    """from one frame to the next"""
    poor: frozenset[int] = frozenset()
    """frames whose cloud is poor: its depths are doubted"""
    silent: frozenset[int] = frozenset()
    """frames in which the hand is not where it was looked for: what was seen counts for nothing"""
    cameras: CameraChanges = field(default_factory=CameraChanges.of)
    """those that may change, and how they do"""
    person: PersonChange | None = None
    """where something of the person may change"""
    outline_mm: Mapping[str, float] = field(default_factory=dict)
    """by camera, what outlines are off by in this recording (`measured_outlines`); the usual where that is more"""
    follows: bool = True
    """whether frames follow one another; chosen ones, `seconds` apart, do not"""
    wide: bool = False
    """whether detected joints pull from however far: where cameras are corrected, whose errors look like the joints'"""
    new: float = 1.0
    """share of what one camera's joints say, where they are all that was seen, that earlier frames did not say: their errors
    last (`new_share`)"""
    frames_later: dict[int, Mapping[str, float]] = field(default_factory=dict)
    """of each frame that was read, by camera, and of its cloud"""
    _held: OrderedDict[int, FrameLikelihood] = field(init=False, default_factory=OrderedDict)

    def of(self, frame: int) -> FrameLikelihood:
        """Return what a frame says."""
        known = self._held.get(frame)
        if known is None:
            known = self._held[frame] = self._read(frame)
            if len(self._held) > _HELD:
                self._held.popitem(last=False)
        return known

    def sharing(self, shared: Shared) -> RecordingLikelihood:
        """Return the same frames, of a person and through cameras that have changed."""
        return self.knowing(cameras=shared.cameras, person=shared.person)

    def knowing(self, **found: Any) -> RecordingLikelihood:
        """Return the same frames, of which something else is known; they are read anew where that changes how."""
        changed = replace(self, **found)
        if changed._read_by == self._read_by:
            changed._held = self._held
        return changed

    def forget(self) -> None:
        """Keep no frame in memory: those asked for after all are read anew."""
        self._held.clear()

    @property
    def _read_by(self) -> tuple[Any, ...]:
        """What frames are read by, of what is found with them."""
        cameras, person = self.cameras, self.person
        has_long_arm = person is not None and person.with_long_arm is not person.parameters.model
        own = self.outline_mm, self.new, self.wide
        return cameras.names, cameras.ahead, has_long_arm, *own

    @property
    def model(self) -> ArticulatedModel:
        """The recording's."""
        return self.recording.model

    @property
    def settings(self) -> TrackerSettings:
        """The recording's."""
        return self.recording.settings

    @property
    def shared(self) -> Shared:
        """What all frames share."""
        return Shared(self.cameras, self.person or PersonChange.none(self.model))

    @property
    def usual(self) -> Motion | None:
        """How poses usually follow one another."""
        if not self.follows:
            return None
        return Motion.usual(self.settings.prior, self.model.transform.matrix.shape[1], self.seconds)

    @property
    def repeated(self) -> float:
        """How many frames show one pose."""
        return max(NEW_POSE_S / self.seconds, 1.0)

    def _observed(self, frame: int, bones: BonePoses) -> Observation:
        """Return what was seen beside a frame: of cameras that are late, later images."""
        observe, changes = self.recording.observe, self.cameras
        seen = observe(frame, bones)
        if self.recording.cameras:
            by_name = {name: round(late) for name, late in self._late(seen).items()}
        else:
            names, frames = (*changes.names, CLOUD_NAME), (*changes.ahead, changes.cloud_ahead)
            by_name = dict(zip(names, frames, strict=True))
        for name, ahead in by_name.items():
            if ahead:
                then = frame + ahead
                later = observe(then, bones) if then in self.around else Observation(then, 0.0)
                seen = _exchanged(seen, later, name)
        return seen

    def _late(self, seen: Observation) -> Mapping[str, float]:
        """Return how late cameras are that are known, and the cloud [frames]."""
        late = {one.name: one.late_frames for one in self.recording.cameras}
        return replace(seen, frames_later=late).later

    def elsewhere(
        self, poses: Mapping[int, Floats[P]], silent: frozenset[int], poor: frozenset[int]
    ) -> RecordingLikelihood:
        """Return the evidence around other poses of some frames, other frames being silent or poor; what is known of the rest
        stays.
        """
        moved = replace(self, around={**self.around, **poses}, silent=silent, poor=poor)
        anew = set(poses) | (silent ^ self.silent) | (poor ^ self.poor)
        if any(any(late.values()) for late in self.frames_later.values()):  # by their speeds
            anew |= {frame + way for frame in poses for way in (-1, 1)}
        moved._held.update({n: f for n, f in self._held.items() if n not in anew})
        return moved

    def _read(self, frame: int) -> FrameLikelihood:
        model, settings, pose = self.model, self.settings, self.around[frame]
        known, held = self.recording.cameras, self.recording.keyframes
        if frame in self.poor:
            settings = poor_cloud_settings(settings)
        once, prior = min(self.seconds / NEW_POSE_S, 1.0), settings.prior
        rest = prior.rest_sigma_deg / once**0.5
        prior = replace(prior, rest_sigma_deg=rest, posture=once * prior.posture)
        bones = model.bones(pose)
        long_arm = bones if self.person is None else self.person.with_long_arm.bones(pose)
        observation = self._observed(frame, bones)
        self.frames_later[frame] = later = observation.later
        terms = frame_terms(model, replace(settings, prior=prior), observation, long_arm)
        if self.follows:
            beside = [n for n in (frame - 1, frame, frame + 1) if n in self.around]
            speed = velocities(np.array([self.around[n] for n in beside]))[beside.index(frame)]
            own = {CLOUD_NAME: later[CLOUD_NAME]}
            if known:
                late = self._late(observation).items()
                own = {name: later.get(name, 0.0) + round(by) - by for name, by in late}
                # a camera at a time of its own takes twice as long
                own = {name: by for name, by in own.items() if abs(by) > IN_STEP}
            terms = at_camera_times(terms, own, pose, speed)
        terms = _corrected(terms, known)
        if frame in held:
            sigma = np.full(len(model.parameter_names), _SET_RAD)
            sigma[:3] = _SET_M
            pull = GaussianPrior(model.joint_params(held[frame]), sigma, "keyframe")
            terms = replace(terms, priors=(*terms.priors, pull))
        terms = terms.sharpened(bones)
        terms = terms.with_outlines(self.outline_mm)
        if self.wide:
            terms = terms.wide()
        share = 1.0 if only_camera(terms) is None else self.new
        clouds = (CLOUD_NAME,) if np.any(self.cameras.cloud) else ()
        at_once = replace(terms, motions={}) if clouds else terms
        told, others = by_camera(at_once.coarser(share**-0.5).stage(bones))
        if frame in self.silent:
            told, others = {}, []
        seen = [told.pop(name, []) for name in self.cameras.names]
        joints = [[term for term in own if _is_detected(term)] for own in seen]
        images = [[term for term in own if not _is_detected(term)] for own in seen]
        views = [*images, *joints, *(told.pop(name, []) for name in clouds)]
        others += [term for own in told.values() for term in own]
        return FrameLikelihood(
            Problem(model, others), Problem(model, (), terms.priors), tuple(Problem(model, own) for own in views), share,
            terms, bones,
        )  # fmt: skip


def _is_detected(term: ObservationTerm) -> bool:
    return isinstance(term, KeypointTerm) and isinstance(term.observed, ImageKeypoints)


def measured_outlines(
    likelihood: RecordingLikelihood, frames: Sequence[int], poses: Floats[F, P]
) -> dict[str, float]:
    """Return by camera how far the hand's outline is from its masks, the median over some frames [mm].

    Masks that follow from a detector's joints, or from colour, are wrong by more than a hand of ellipsoids is; a camera whose masks show a
    shadow by much more.
    """
    found: dict[str, list[float]] = {}
    for n in evenly_spread(len(frames), _OUTLINES):
        terms = likelihood.of(frames[n]).terms
        for name, mm in terms.outline_errors_mm(likelihood.model.bones(poses[n])).items():
            found.setdefault(name, []).append(mm)
    return {name: float(np.median(mm)) for name, mm in found.items()}


def new_share(likelihood: RecordingLikelihood, frames: Sequence[int], poses: Floats[F, P]) -> float:
    """Return the share of a frame that is new, (1 − ρ)/(1 + ρ): ρ is the correlation of what is left over of joints in one camera's
    image, where they are all that was seen, between a frame and the next; 1 where there are none.

    Where a detector sees a joint beside the model's it does so again: all frames together then tell little more than one, and
    least of all the depth that follows from them. Errors that are new in each frame leave all of them their weight.
    """
    both, own = 0.0, 0.0
    before: dict[int, Floats] = {}
    for frame, pose in zip(frames, poses, strict=True):
        left: dict[int, Floats] = {}
        terms = likelihood.of(frame).terms
        for term in terms.keypoints if only_camera(terms) is not None else ():
            joints, off = term.residuals(likelihood.model.bones(pose))
            left |= dict(zip(joints.tolist(), off.clip(-_LARGEST, _LARGEST), strict=True))
        for joint in left.keys() & before.keys():
            both += float(left[joint] @ before[joint])
            own += 0.5 * float(left[joint] @ left[joint] + before[joint] @ before[joint])
        before = left
    lasts = min(max(both / own, 0.0), _LONGEST) if own > 0 else 0.0
    return (1.0 - lasts) / (1.0 + lasts)


def _exchanged(seen: Observation, later: Observation, name: str) -> Observation:
    """Return an observation with what one camera saw in another, or with its cloud."""
    if name == CLOUD_NAME:
        return replace(seen, cloud=later.cloud, frames_later=later.frames_later)

    def of_camera(one: Silhouette | Keypoints | ImageKeypoints | ImagePins) -> bool:
        return not isinstance(one, Keypoints) and one.camera.name == name

    masks = [s for s in seen.silhouettes if not of_camera(s)]
    joints = [k for k in seen.keypoints if not of_camera(k)]
    pins = [p for p in seen.pins if not of_camera(p)]
    return replace(
        seen,
        silhouettes=(*masks, *filter(of_camera, later.silhouettes)),
        keypoints=(*joints, *filter(of_camera, later.keypoints)),
        pins=(*pins, *filter(of_camera, later.pins)),
    )


def _corrected(terms: FrameTerms, errors: Sequence[CameraError]) -> FrameTerms:
    """Return terms through cameras as an earlier estimate found them."""
    points = [term.observed for term in (*terms.keypoints, *terms.pins)]
    seen = [*terms.prepared, *(one for one in points if not isinstance(one, Keypoints))]
    calibrated = {one.camera.name: one.camera for one in seen}
    known = [one for one in errors if one.name in calibrated]
    cameras, detector = (
        {one.name: one.corrected(calibrated[one.name], by_joints) for one in known}
        for by_joints in (False, True)
    )
    return _through(terms, cameras, detector, {one.name: 1e-3 * one.wider_mm for one in known})


def _through(
    terms: FrameTerms,
    cameras: Mapping[str, Camera],
    detector: Mapping[str, Camera],
    wider_m: Mapping[str, float],
) -> FrameTerms:
    """Return terms through other cameras, by name, as they saw and as a detector saw in their images, whose masks are so much wider than
    the hand.
    """

    def through(term: KeypointTerm, cameras: Mapping[str, Camera]) -> KeypointTerm:
        seen = term.observed
        if isinstance(seen, Keypoints):
            return term
        camera = cameras.get(seen.camera.name, seen.camera)
        return replace(term, observed=replace(seen, camera=camera))

    prepared = [
        replace(
            one, camera=cameras.get(one.camera.name, one.camera), wider_m=wider_m.get(one.camera.name, one.wider_m)
        )
        for one in terms.prepared
    ]  # fmt: skip
    return replace(
        terms,
        prepared=tuple(prepared),
        keypoints=tuple(through(term, detector) for term in terms.keypoints),
        pins=tuple(through(term, cameras) for term in terms.pins),
    )
