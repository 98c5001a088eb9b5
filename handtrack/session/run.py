"""TrackingRun: a session with its model and tracker, the one engine of command line and workbench."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import D3, Floats, P, S, evenly_spread
from handtrack.capture.calibration.rig_file import rig_json
from handtrack.errors import HandtrackError
from handtrack.model.articulated import (
    UNNAMED_LANDMARKS,
    ArticulatedModel,
    HandScale,
    keypoint_names,
)
from handtrack.model.kinematics import BonePoses
from handtrack.model.model_file import SIMPLER_HANDS, load_model, read_scale
from handtrack.model.size import (
    FOREARM_END,
    hand_length_mm,
    is_unmeasured,
    scale_known_to,
    unmeasured_size,
    without_forearm_end,
)
from handtrack.observation.observation import Keypoints, Observation, check_kind
from handtrack.parallel import in_parallel, thread_count
from handtrack.session.first_pose import FirstPose, poses_from_images
from handtrack.session.session import Session
from handtrack.session.session_file import BODY_TRACKING, CloudSettings
from handtrack.session.sources.clouds import hand_region
from handtrack.session.sources.keypoint_files import of_model
from handtrack.session.sources.views import joint_sigma_px
from handtrack.tracking.find_pose import PoseEstimate, pose_in_space
from handtrack.tracking.frame.confidence import OutlineFit, assess, outline_fit
from handtrack.tracking.frame.control import Control, Observe, Observer
from handtrack.tracking.frame.frame_task import TrackerState, posed_result
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import FrameResult, Status, Step, TrackLabels, TrackResult
from handtrack.tracking.frame.settings import SETTINGS, TrackerSettings
from handtrack.tracking.frame.terms.cloud_terms import agreement
from handtrack.tracking.frame.terms.forearm import forearm_in_view
from handtrack.tracking.search.keypoint_start import carried_over, fit_keypoints, fit_scale
from handtrack.tracking.sequence import refine_recording, track_recording
from handtrack.tracking.size.person import FEWEST_BY_JOINTS, Subject, is_observed_around
from handtrack.tracking.tracker import Tracker
from handtrack.tracking.whole.chosen_frames import fit_person
from handtrack.tracking.whole.refinement import CameraError

_WRIST = ("wrist_flex", "wrist_abd")  # freedoms that only a forearm shows
_ARM_FRAMES = 8  # frames, evenly spread
_ARM_ERROR_M = 0.01  # by which a cuff's end is measured differently in one frame and another


@dataclass(frozen=True)
class TrackingRun:
    """What tracking a session takes. Immutable: another setting is another run (`with_values`)."""

    session: Session
    first: FirstPose | None
    """where tracking starts: of init.json unless another is given"""
    settings: TrackerSettings
    arm_m: float
    """how far from the wrist the model's forearm ends, as a cuff does [m of the mean adult's]; infinite where it goes on, 0 without one"""
    model: ArticulatedModel
    is_sized: bool = False
    """whether `fit_size` found the person"""
    cameras: tuple[CameraError, ...] = ()
    """what an estimate of all frames found, for frames beside poses that were set since"""

    @classmethod
    def open(
        cls,
        session: Session,
        overrides: Mapping[str, Any] | None = None,
        first: FirstPose | None = None,
        should_stop: Callable[[], bool] | None = None,
        use_init: bool = True,
    ) -> TrackingRun:
        """Return the run that session.toml describes, with dotted settings replaced.

        A hand scale of "fit" is fitted to the first pose's keypoints, then to the silhouettes of
        the frames after it (`fit_size`), unless that is put off; a forearm is modelled where
        silhouettes show one beyond the wrist, as far as they do.

        Parameters
        ----------
        use_init
            Whether init.json is the first pose where none is given.

        Raises
        ------
        HandtrackError
        """
        check_kind(session, Session, "session", "Session.open(folder)")
        settings = session.settings.with_values(overrides or {})
        session = session.as_tracked_by(settings)
        first = first or (session.init if use_init else None)
        if first is not None and first.pixels:
            first = FirstPose.of(poses_of_image_joints(session, settings, first)[0])
        run = cls.unfitted(session, settings, first)
        run = run.with_scale(run._of_this_recording(run.given_scale))
        run = run.with_forearm(run._arm_at_first())
        if run.sizes_first and settings.model.fit_size == "true" and first is not None:
            return run.fit_size(Control(should_stop) if should_stop else Control())
        return run

    @classmethod
    def unfitted(
        cls, session: Session, settings: TrackerSettings, first: FirstPose | None = None
    ) -> TrackingRun:
        """Return the run for a mean adult without a forearm."""
        return cls(session, first, settings, 0.0, _model(session, settings, HandScale(), 0.0))

    @property
    def scale(self) -> HandScale:
        """The person's size."""
        return self.model.scale

    @property
    def given_scale(self) -> HandScale:
        """Whose hand or body it is, before anything is fitted but the points of the first pose. Raises HandtrackError."""
        given, first = self.session.hand_scale, self.first
        if isinstance(given, Path):
            return read_scale(given)
        if given != "fit":
            return HandScale(float(given))
        if (person := self.session.prior_person) is not None:
            return person
        if first is None or first.xyz is None:  # nothing to fit to: an adult's mean hand
            return first.scale if first is not None and first.scale is not None else HandScale()
        seen = _keypoints(first, self.settings)
        return fit_scale(lambda scale: self._whole_hand(scale, self.forearm), seen)

    @property
    def prior_person(self) -> HandScale | None:
        """What a person's file says beforehand of a hand that is fitted."""
        person = self.session.prior_person
        return None if person is None else self._of_this_recording(person)

    def _of_this_recording(self, scale: HandScale) -> HandScale:
        """Return a person without what other recordings say of themselves: where an arm ended in their masks, and offsets that lead to
        another detector's points.
        """
        scale = without_forearm_end(scale)
        files = [v.keypoint_files for v in self.session.views if v.keypoint_files is not None]
        if not files or self.settings.keypoints.weight == 0:
            return scale
        own = "+".join(sorted({one.landmark_definition for one in files}))
        is_same = scale.landmark_definition in (own, UNNAMED_LANDMARKS)
        if is_same:
            return replace(scale, landmark_definition=own)
        known = scale.covariance
        if known is not None:  # of an offset it names its joint and an axis
            known = known.only([name for name in known.names if " " not in name])
        return replace(scale, offsets_mm={}, landmark_definition=own, covariance=known)

    def _arm_at_first(self) -> float:
        """Return how far from the wrist a forearm is modelled by what the first pose says and its frame shows, 0 for none."""
        wanted, first = self._asked_forearm, self.first
        if wanted != "auto":
            return np.inf if wanted == "true" else 0.0
        if first is None or self.model.kind == "body":
            return 0.0
        unseen = np.inf if any(name in _WRIST for name in first.parameters) else 0.0
        armed = self.with_forearm(unseen)
        frame, params = armed.initial()
        found = forearm_in_view(armed.model, [(params, self.observed(frame))])
        return unseen if found is None else found

    @property
    def size_is_open(self) -> bool:
        """Whether session and settings ask for the hand's size to be fitted, or where a detector sees its joints."""
        if self.settings.model.fit_size == "false":
            return False
        return self.asks_for_size or self.offsets_are_open

    @property
    def asks_for_size(self) -> bool:
        """Whether session.toml asks for lengths and girths that the model can tell."""
        return self.session.hand_scale == "fit" and self.model.name not in SIMPLER_HANDS

    @property
    def fits_sizes(self) -> bool:
        """Whether `fit_size` finds lengths and girths, not only where a detector sees joints."""
        return self.asks_for_size and self.session.prior_person is None

    @property
    def offsets_are_open(self) -> bool:
        """Whether it is to be found where a detector sees joints: no saved hand says so."""
        saved = isinstance(self.session.hand_scale, Path) and bool(self.scale.offsets_mm)
        return self.sees_joints and not saved

    @property
    def sizes_first(self) -> bool:
        """Whether something of the person is to be found before tracking: nothing that their file tells."""
        knows_joints = bool(self.scale.offsets_mm) or not self.sees_joints
        is_known = self.is_sized or (self.prior_person is not None and knows_joints)
        return self.size_is_open and not is_known

    @property
    def sees_joints(self) -> bool:
        """Whether a detector's joints of a whole hand, or of a body, are looked at."""
        whole = self.model.has_keypoints21 or self.model.kind == "body"
        if self.settings.keypoints.weight == 0 or not whole:
            return False
        return any(view.keypoint_files is not None for view in self.session.views)

    def fit_size(
        self,
        control: Control = Control(),
        frames: range | None = None,
        most: int | None = None,
        tracked: Iterable[FrameResult] | None = None,
        sizes: bool | None = None,
    ) -> TrackingRun:
        """Return the run for the person who explains the surest frames best; the same run where
        none can tell it.

        Takes frames that are tracked; or those of `frames` (of all unless given) whose poses joints
        of two cameras say; or tracks `frames` (from the first pose until enough are sure, unless
        given) with the size at hand. Then fits shape and poses of at most `most` of the surest
        together; where a detector sees the joints is found with them, or alone: sizes says so, else
        session.toml.
        """
        if sizes is None:
            sizes = self.fits_sizes
        share, usual = 0.0, MOST_BY_JOINTS if self.sees_joints else MOST_FRAMES
        if tracked is None:
            tracked = posed_by_joints(self, frames or self.session.frame_range, control.should_stop)
            if not tracked:
                share = TRACKED_SHARE
                tracked = tracked_for_size(self, frames, control)
        tracked = list(tracked)
        run = self.with_arm_of(tracked)
        if run is not self:
            tracked = [
                replace(r, parameters=run.joint_params_from(self, r.parameters)) for r in tracked
            ]
        scale = size_of_frames(run, tracked, most or usual, control, share, sizes)
        return run if scale is None else replace(run.with_scale(scale), is_sized=True)

    def with_arm_of(self, tracked: Iterable[FrameResult]) -> TrackingRun:
        """Return the run whose forearm is as long as tracked frames, spread evenly, show it: none, a cuff, or a whole one. The same
        where they show about that, or nothing, or where it is not left to the program; and where the forearm's end was estimated
        with the shape, which is more exact than how far masks reach along its axis.
        """
        posed = [r for r in tracked if r.status != Status.LOST]
        done = [r for r in posed if r.status == Status.TRACKED] or posed
        if not self.leaves_forearm_open or not done or self.model.kind == "body":
            return self
        arm_m, before = forearm_in_view(self.model, samples(self, done, _ARM_FRAMES)), self.arm_m
        if arm_m is None or arm_m == before:
            return self
        is_end_known = FOREARM_END in self.scale.proportions or abs(arm_m - before) < _ARM_ERROR_M
        if min(arm_m, before) > 0 and is_end_known:
            return self
        return replace(self, arm_m=arm_m).with_scale(without_forearm_end(self.scale))

    def joint_params_from(self, other: TrackingRun, joint_params: Floats[S]) -> Floats[S]:
        """Return joint parameters of another run, whose forearm may be another, as those of this run's model."""
        params = other.model.solver_params(joint_params)
        return self.model.joint_params(carried_over(other.model, params, self.model))

    def observation_of(self, result: FrameResult) -> Observation:
        """Return what was observed of a tracked frame; the cloud is cropped to its pose."""
        bones = self.model.bones(self.model.solver_params(result.parameters))
        return of_model(self.observed(result.frame, bones), self.model)

    def with_values(self, overrides: Mapping[str, Any]) -> TrackingRun:
        """Return the run with dotted settings replaced; the hand's size stays as it is."""
        settings = self.settings.with_values(overrides)
        wanted = settings.model.forearm
        arm_m = self.arm_m if wanted == "auto" else np.inf if wanted == "true" else 0.0
        session = self.session.as_tracked_by(settings)
        return replace(self, session=session, settings=settings).with_forearm(arm_m)

    def with_clouds(self, clouds: CloudSettings | None) -> TrackingRun:
        """Return the run with other settings of [clouds]. Raises HandtrackError when they cannot be used."""
        session = self.session.with_clouds(clouds).as_tracked_by(self.settings)
        return replace(self, session=session)

    @property
    def notes(self) -> list[str]:
        """A sentence for each setting without effect."""
        found = ineffective_settings(self.settings, self.session, self.model.kind)
        if self.session.hand_scale == "fit" and not self.asks_for_size:
            what = f"{self.model.name} is too simple to tell the hand's size"
            found.append(f'scale = "fit" has no effect: {what}.')
        return found

    def with_scale(self, scale: HandScale) -> TrackingRun:
        """Return the run for a hand of another size."""
        model = _model(self.session, self.settings, scale, self.arm_m)
        return replace(self, model=model)

    def with_limits_of(self, other: TrackingRun) -> TrackingRun:
        """Return the run whose joints have the limits that they have in another run."""
        names, limits = other.model.parameter_names, self.model.limits
        known = dict(zip(names, other.model.limits.interval, strict=True))
        found = [
            known.get(n, own)
            for n, own in zip(self.model.parameter_names, limits.interval, strict=True)
        ]
        if np.array_equal(found, limits.interval):
            return self
        limits = replace(limits, interval=np.array(found))
        return replace(self, model=replace(self.model, limits=limits))

    def with_arm_in_view(self, frame: int, params: Floats[P]) -> TrackingRun:
        """Return the run with a forearm in its model, if that is left to the program and the silhouettes of a
        frame show one beyond the hand's pose; without a first pose nothing else can tell.
        """
        if self.forearm or not self.leaves_forearm_open or self.model.kind == "body":
            return self
        arm_m = forearm_in_view(self.model, [(params, self.observed(frame))])
        return self.with_forearm(arm_m) if arm_m else self

    @property
    def forearm(self) -> bool:
        """Whether its model has one."""
        return bool(self.arm_m > 0)

    @property
    def leaves_forearm_open(self) -> bool:
        """Whether neither settings nor session.toml say if the model has a forearm."""
        return self._asked_forearm == "auto"

    @property
    def _asked_forearm(self) -> str:
        """Whether settings or session.toml ask for a forearm: `true`, `false`, or `auto`, which leaves it to the program."""
        chosen = self.settings.model.forearm
        return str(self.session.file.hand.forearm).lower() if chosen == "auto" else chosen

    def with_forearm(self, arm_m: float) -> TrackingRun:
        """Return the run whose model has another forearm; see `arm_m`."""
        return replace(self, arm_m=arm_m).with_scale(self.scale)

    def with_parameters(self, names: Sequence[str]) -> TrackingRun:
        """Return the run whose model has these joint parameters, as a take was tracked with, where a forearm makes the
        difference; else this one.
        """
        if self.model.parameter_names == tuple(names) or self.model.kind == "body":
            return self
        other = self.with_forearm(0.0 if self.forearm else np.inf)
        return other if other.model.parameter_names == tuple(names) else self

    def whole_hands(self) -> list[ArticulatedModel]:
        """Return the hands with all joints that may be in view: without and with a forearm, if that is left open."""
        asked = self._asked_forearm
        arms = (False, True) if asked == "auto" else (asked == "true",)
        return [self._whole_hand(self.model.scale, arm) for arm in arms]

    def resized(self, model: ArticulatedModel, scale: HandScale) -> ArticulatedModel:
        """Return one of `whole_hands` in another size."""
        return self._whole_hand(scale, model.has_forearm)

    def _whole_hand(self, scale: HandScale, arm: bool) -> ArticulatedModel:
        if self.model.kind != "hand" or self.model.has_keypoints21:
            return _model(self.session, self.settings, scale, np.inf if arm else 0.0)
        return load_model("hand26", self.model.side, scale, forearm=arm)

    def observed(self, frame: int, bones: BonePoses | None = None) -> Observation:
        """Return what was observed of a frame, as far as the settings use it; nothing that was given.

        Parameters
        ----------
        bones
            Where the hand is expected; the cloud is cropped to it.
        """
        settings, session = self.settings, self.session
        near = None if bones is None else hand_region(self.model, bones)
        silhouettes, cloud = settings.silhouettes.weight > 0, settings.cloud.weight > 0
        seen = session.observation(frame, silhouettes, cloud, near)
        if settings.keypoints.weight > 0:
            measured = None if settings.keypoints.sigma_px else joint_sigma_px(tuple(session.views))
            sigma = measured or settings.keypoints.detected_px
            points = tuple(p for view in session.views for p in view.keypoints(frame, sigma))
            seen = replace(seen, keypoints=points) if points else seen
        return replace(seen, images=session.images(frame)) if settings.uses_images else seen

    def fit_of(self, frame: int, params: Floats[P]) -> tuple[Reason | None, OutlineFit | None]:
        """Return why a frame is doubtful or lost at solver parameters, by itself, and how the pose fits its silhouettes."""
        bones = self.model.bones(params)
        terms = frame_terms(self.model, self.settings, self.observed(frame), bones, None)
        return assess(terms, bones, 0.0, ())[1], outline_fit(terms, bones)

    @property
    def tracker(self) -> Tracker:
        sure = None if self.first is None else self.first.confidence
        return Tracker(
            self.model,
            self.settings,
            start_confidence=1.0 if sure is None else sure,
            subject=person_to_fit(self),
            cameras=self.cameras,
        )

    def initial(self) -> tuple[int, Floats[P]]:
        """Return the first pose: its frame, and solver parameters. HandtrackError without one."""
        if self.first is None:
            raise HandtrackError(
                f"{self.session.folder}: there is no init.json, so tracking has no first pose. Pose the hand in the "
                "workbench (`handtrack open`) and press 'Save first-frame pose', or give one with --init FILE."
            )
        return self.first.frame, _first_params(self.model, self.first, self.settings)

    def observation(self, frame: int, bones: BonePoses | None = None) -> Observation:
        """Return what was observed of a frame, see `observed`, of what the model has, and keypoints that were given for it."""
        seen = of_model(self.observed(frame, bones), self.model)
        if self.first is None or self.first.frame != frame or self.first.xyz is None:
            return seen
        if not self.model.has_keypoints21:
            return seen
        given = _keypoints(self.first, self.settings)
        return replace(seen, keypoints=(given, *seen.keypoints))

    def track(
        self,
        frames: range,
        start_frame: int,
        start_params: Floats[P],
        control: Control = Control(),
        done: Sequence[Step] = (),
    ) -> Iterator[FrameResult]:
        """Yield results in the order of tracking; see tracking.sequence.track_recording. done: gone on from, if given."""
        on_the_way = range(min(frames.start, start_frame), max(frames.stop, start_frame + 1))
        with prefetching(self.observation, self._prepare, on_the_way, start_frame) as observe:
            yield from track_recording(
                self.tracker, observe, start_frame, start_params, frames, control, done
            )

    def refined(
        self,
        tracked: Sequence[FrameResult],
        control: Control = Control(),
        held: Mapping[int, Floats[P]] | None = None,
        changed: Sequence[int] | None = None,
        pinned: Mapping[int, Floats[P]] | None = None,
    ) -> list[FrameResult]:
        """Return tracked frames refined together; see tracking.sequence.refine_recording."""
        return refine_recording(
            self.tracker, self.observation, tracked, control, held, changed, pinned
        )

    def _prepare(self, frame: int) -> None:
        """Read what a frame's observation will need whatever the pose; it stays in the session's memory."""
        silhouettes, cloud = self.settings.silhouettes.weight > 0, self.settings.cloud.weight > 0
        self.session.prepare(frame, silhouettes, cloud)

    def result(self, frames: Iterable[FrameResult]) -> TrackResult:
        """Return the frames as one result, sorted, the latest of each, with where they came from."""
        return replace(self.labels.track(frames), pins=self.session.pins.text)

    @property
    def labels(self) -> TrackLabels:
        """What the numbers of this run's results mean, and where they come from."""
        model, std_mm = self.model, self.scale.std.get("length_mm")
        return TrackLabels.of(
            model,
            session=self.session.name,
            settings=json.dumps(self.settings.flat(), sort_keys=True),
            start_confidence=None if self.first is None else self.first.confidence,
            hand_length_mm=None if std_mm is None else hand_length_mm(model),
            hand_length_std_mm=std_mm,
            fps=self.session.fps,
            cameras=rig_json(self.session.rig),
        )


def samples(
    run: TrackingRun, results: Iterable[FrameResult], most: int
) -> Iterator[tuple[Floats[P], Observation]]:
    """Yield solver parameters, and what was observed, of at most so many frames, spread evenly over those given."""
    ascending = sorted(results, key=lambda result: result.frame)
    for row in evenly_spread(len(ascending), most):
        result = ascending[row]
        yield run.model.solver_params(result.parameters), run.observation_of(result)


def poses_of_image_joints(
    session: Session, settings: TrackerSettings, first: FirstPose
) -> list[PoseEstimate]:
    """Return the poses in space that a first pose with joints in images may mean, the surest first."""
    run = TrackingRun.unfitted(session, settings)
    whole = run.resized(run.model, run.given_scale)
    return poses_from_images(session.rig, settings, whole, first, run.observed(first.frame))


def _model(
    session: Session, settings: TrackerSettings, scale: HandScale, arm_m: float
) -> ArticulatedModel:
    """Return the model with a forearm of so much; 0: without. Another model than the session's has of the person what it knows."""
    chosen, side = settings.model, session.file.hand.side
    if chosen.name not in ("", session.hand_model):
        scale = scale_known_to(load_model(chosen.name, side, forearm=True), scale)
    return load_model(
        chosen.name or session.hand_model,
        side,
        scale,
        coupling=chosen.coupling,
        forearm=arm_m,
        spread=chosen.spread,
        narrowing=settings.traits.narrowing,
    )


def _keypoints(first: FirstPose, settings: TrackerSettings) -> Keypoints:
    assert first.xyz is not None
    return Keypoints(keypoint_names(), first.xyz, settings.keypoints.sigma_mm * 1e-3)


def _first_params(model: ArticulatedModel, first: FirstPose, settings: TrackerSettings) -> Floats:
    if model.kind == "body":
        if first.xyz is not None:
            raise HandtrackError(
                f"first pose: 21 keypoints are a hand's, but the model is '{model.name}'; give a body's pose by "
                "parameters, as the workbench saves it."
            )
        return model.params_from(first.parameters, nearest=True)
    if not model.has_keypoints21:  # a simpler hand stands where the whole one would
        whole = _whole(model)
        return carried_over(whole, _first_params(whole, first, settings), model)
    if first.xyz is not None:
        return fit_keypoints(model, _keypoints(first, settings))
    arm = () if model.has_forearm else _WRIST
    given = {name: value for name, value in first.parameters.items() if name not in arm}
    return model.params_from(given, nearest=True)


def _whole(model: ArticulatedModel) -> ArticulatedModel:
    """Return a hand with all its joints, of the same person: keypoints and names refer to it."""
    if model.has_keypoints21:
        return model
    return load_model("hand26", model.side, model.scale, forearm=True)


MOST_FRAMES = 8
"""that are used: neighbours show the same"""
MOST_BY_JOINTS = 16
"""that are used where joints are their first poses: spread over all of a recording, they show different postures"""
TRACKED_SHARE = 0.6
"""of the time that a fit takes, where its frames are to be tracked first"""
_LEAST_MEASURED = 0.7  # share of the hand in view that clouds measured, median; behind a can 0.62 made a hand of 125 mm from one of 180
_STRETCH = 40  # frames tracked to fit the hand's size, at least; more until enough of them are sure
_ROUNDS = 2  # of choosing: a better shape makes more frames sure


def tracked_for_size(run: TrackingRun, frames: range | None, control: Control) -> list[FrameResult]:
    """Return frames tracked from the first pose, each by those before it: all of `frames`, or unless given until enough are sure."""
    live, (start, params) = run.with_values({"tracker.estimate": "forward"}), run.initial()
    results: list[FrameResult] = []
    sure = 0
    wanted = frames or run.session.frame_range
    observer, shown = control.observer, Observer()
    shown.provisional = observer.tried
    for result in live.track(wanted, start, params, Control(control.should_stop, shown)):
        results.append(result)
        count, sure = len(results), sure + (result.status == Status.TRACKED)
        least = len(wanted) if frames else min(_STRETCH, len(wanted))
        share = TRACKED_SHARE * min(count / least, 1.0)
        observer.progress(share, f"frames tracked: {count}, of these sure: {sure}", "size")
        if frames is None and count >= least and sure >= MOST_FRAMES:
            break
    return results


def posed_by_joints(
    run: TrackingRun, frames: range, should_stop: Callable[[], bool]
) -> list[FrameResult]:
    """Return frames spread evenly over `frames` at the poses that joints of two cameras say; none where too few have any.

    They are not tracked yet: how sure they are is not known.
    """
    posed: list[FrameResult] = []
    if not run.sees_joints or len(run.session.views) < 2:
        return posed
    (hand, *_) = run.whole_hands()
    chosen = np.unique(np.linspace(frames.start, frames.stop - 1, 2 * MOST_BY_JOINTS).round())
    for frame in chosen.astype(int).tolist():
        if should_stop():
            return []
        seen = run.observed(frame)
        joints = seen.image_keypoints
        found = pose_in_space(run.settings, hand, frame, joints) if joints else None
        if found is not None:
            params = carried_over(hand, found.params, run.model)
            posed.append(posed_result(run.model, seen, params, Status.DOUBTFUL))
    return posed if len(posed) >= FEWEST_BY_JOINTS else []


def size_of_frames(
    run: TrackingRun,
    results: Iterable[FrameResult],
    most: int,
    control: Control = Control(),
    done: float = 0.0,
    sizes: bool = True,
) -> HandScale | None:
    """Return the person who explains the surest frames best, at most so many, of postures that differ; None where none can tell. Where
    clouds alone show the hand, and measured less than 70 % of what they could, the size is held at the population's mean and spread.

    With the shape that is found frames are assessed again, and those that are sure then count too. If `sizes` is not wished,
    where a detector sees joints is found alone. done: the share of all the work that came before.
    """
    stop, scale, used = control.should_stop, None, set[int]()
    results = [result for result in results if result.status != Status.LOST]
    for step in range(_ROUNDS):
        if step or any(not result.energies for result in results):
            some = [results[i] for i in evenly_spread(len(results), 2 * most)]
            assessed = partial(_assessed, run, stop)
            results = [one for one in in_parallel(assessed, some) if one is not None]
        chosen = _unlike(results, most)
        if stop() or not chosen or {result.frame for result in chosen} <= used:
            break
        used = {result.frame for result in chosen}
        seen = [run.observation_of(result) for result in chosen]
        places = list(zip(seen, map(_middle, chosen), strict=True))
        around = any(is_observed_around(one, place) for one, place in places)
        if sizes and not around and _measured(run, results, most) < _LEAST_MEASURED:
            given = run.first is not None and run.first.xyz is not None  # a size that points tell
            mean = replace(run.scale, overall=run.scale.overall if given else 1.0)
            return unmeasured_size(_subject(run).build, mean)
        subject = replace(_subject(run), sizes=sizes)
        poses = [run.model.solver_params(result.parameters) for result in chosen]

        def report(share: float, step: int = step, count: int = len(chosen)) -> None:
            all_done = done + (1 - done) * (step + share) / _ROUNDS
            control.observer.progress(all_done, f"{count} frames fitted together", "size")

        found = fit_person(subject, run.model, run.settings, seen, poses, stop, report)
        if found is None:
            break
        scale, run = found, run.with_scale(found)
    return scale


def _assessed(
    run: TrackingRun, should_stop: Callable[[], bool], result: FrameResult
) -> FrameResult | None:
    """Return a frame alone at the pose of this person nearest to that it had, and how sure it is; None when stopped."""
    if should_stop():
        return None
    start = run.model.clipped(run.model.solver_params(result.parameters))
    tracker = Tracker(run.model, run.settings)
    return tracker.step_without_search(
        TrackerState.beginning_at(start), run.observation_of(result)
    )[1]


def _unlike(results: Sequence[FrameResult], most: int) -> list[FrameResult]:
    """Return at most so many frames, ascending: of those that are sure, or as many of the least doubtful, those whose postures differ most."""
    grade = {Status.TRACKED: 0, Status.LOST: 2}
    sure = sorted(results, key=lambda r: (grade.get(r.status, 1), np.nan_to_num(r.p_off_25mm)))
    sure = sure[: max(sum(r.status == Status.TRACKED for r in sure), most)]
    joints = np.array([result.joint_positions - _middle(result) for result in sure])
    kept, far = [0] if sure else [], np.full(len(sure), np.inf)
    while 0 < len(kept) < min(most, len(sure)):
        far = np.minimum(far, np.linalg.norm(joints - joints[kept[-1]], axis=2).mean(axis=1))
        far[kept] = -1.0  # also where the others are at just the same pose
        kept.append(int(np.argmax(far)))
    return sorted((sure[n] for n in kept), key=lambda result: result.frame)


def person_to_fit(run: TrackingRun) -> Subject | None:
    """Return what of the person refining may find: not what was given, and nothing where `model.fit_size` says so."""
    if run.settings.model.fit_size == "false" or is_unmeasured(run.scale):
        return None
    return _subject(run)


def _subject(run: TrackingRun) -> Subject:
    def build(scale: HandScale) -> ArticulatedModel:
        return replace(run.with_scale(scale).model, limits=run.model.limits)

    sizes, offsets = run.asks_for_size, run.offsets_are_open
    return Subject(build, sizes, offsets, run.prior_person)


def _measured(run: TrackingRun, results: Sequence[FrameResult], most: int) -> float:
    """Return which share of the hand in view clouds measured, the median of frames; 1 where there are none."""
    shares = []
    for params, seen in samples(run, results, most):
        bones = run.model.bones(params)
        terms = frame_terms(run.model, run.settings, seen, bones)
        found = None if terms.cloud is None else agreement(terms.cloud, bones)
        shares += [] if found is None else [found.measured]
    return float(np.nanmedian(shares)) if np.isfinite(shares).any() else 1.0


def _middle(result: FrameResult) -> Floats[D3]:
    return np.asarray(result.joint_positions.mean(axis=0))


# ---- Settings that were changed and mean nothing to what is tracked: another model, evidence that is not there or not used


def ineffective_settings(settings: TrackerSettings, session: Session, kind: str) -> list[str]:
    """Return a sentence on the changed settings that have no effect, for each reason. kind: of the model, hand or body."""
    flat, usual = settings.flat(), dict(settings.usual)
    if kind == "body":
        usual |= {f"{g}.{key}": v for g, table in BODY_TRACKING.items() for key, v in table.items()}
    changed = [
        name
        for name, known in SETTINGS.items()
        if flat[name] != usual[name] and known.about in ("", kind)
    ]
    found = settings.without_effect(kind)
    for prefix, why in _reasons(settings, session):
        without = [n for n in changed if n.startswith(prefix) and not n.endswith(".weight")]
        if without:
            has = "have" if len(without) > 1 else "has"
            found.append(f"{' and '.join(without)} {has} no effect: {why}.")
    return found


def _reasons(settings: TrackerSettings, session: Session) -> Iterator[tuple[str, str]]:
    """Yield how names of ineffective settings begin, and why."""
    cameras = [view.settings for view in session.views]
    there = {
        "silhouettes": any(camera.masks is not None for camera in cameras),
        "cloud": session.has_clouds,
        "edges": any(camera.images is not None for camera in cameras),
        "intensity": any(camera.images is not None for camera in cameras),
    }
    needs = {"silhouettes": "no camera has masks", "cloud": "there are no [clouds]"}
    for name, is_there in there.items():
        if not is_there:
            yield f"{name}.", needs.get(name, "no camera has images")
        elif settings.flat()[f"{name}.weight"] == 0:
            yield f"{name}.", f"{name}.weight is 0"
    if settings.tracker.hypotheses == 1:
        yield "mixture.", "tracker.hypotheses is 1"
    if settings.model.coupling != "18":
        yield "model.spread_", f"it is for model.coupling = 18, which is {settings.model.coupling}"


# ---- What the next frame needs of files is read while this one is solved


@contextmanager
def prefetching(
    observe: Observe, prepare: Callable[[int], object], frames: range, start: int
) -> Iterator[Observe]:
    """Yield `observe`, with the frame after the one asked for prepared beside: decoded, segmented, undistorted, measured.

    What is prepared stays in the session's own memory, so nothing differs but when the work is done; a frame that cannot
    be read says so when it is asked for. start: of `frames`, where tracking begins: forward from there, and backward before it.
    """
    if thread_count() == 1:
        yield observe
        return
    begun: dict[int, Future[object]] = {}
    beside = ThreadPoolExecutor(1, "look-ahead")

    def look(frame: int, bones: BonePoses | None) -> Observation:
        if frame in begun:
            begun[frame].exception()  # waits; what failed is tried, and told of, below
        seen = observe(frame, bones)
        then = frame + (1 if frame >= start else -1)
        if then in frames:
            begun.clear()
            begun[then] = beside.submit(prepare, then)
        return seen

    try:
        yield look
    finally:
        beside.shutdown(cancel_futures=True)
