"""Tracking a session from its first pose to its result: one generator of events, for the terminal, the workbench and Python.

size or shape → segments between fixed poses → forward pass → joint optimisation of all frames → warnings
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import field, replace
from hashlib import blake2b
from itertools import pairwise
from typing import Any

import numpy as np

from handtrack.arrays import Floats, P, S, array_dataclass
from handtrack.errors import HandtrackError
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import Observation
from handtrack.session.doctor.check_hand import (
    inconsistency_of_cameras,
    odd_side,
    wrong_side_warning,
)
from handtrack.session.hand_side import misfits_m, side_told
from handtrack.session.layout import TRACKS_FOLDER
from handtrack.session.run import TrackingRun
from handtrack.session.session_state import SessionState, readable
from handtrack.session.takes import TakeRecorder
from handtrack.store.store import Store
from handtrack.tracking.frame.control import Control, Observer
from handtrack.tracking.frame.frame_task import posed_result
from handtrack.tracking.frame.result import FrameResult, Status, Step, TrackResult
from handtrack.tracking.sequence import tracked_by_new_share
from handtrack.tracking.whole.refinement import Refinement


@array_dataclass
class TrackingRequest:
    """What to track. Poses are joint parameters (S,) of the run's model [m, rad], so they hold for a hand of any size."""

    frames: range
    first: int
    """where tracking starts: forward from there, then backward"""
    start: Floats[S] | None = None
    """the pose there; None: the run's first pose"""
    fixed: Mapping[int, FrameResult] = field(default_factory=dict)
    """keyframes and accepted frames: they stay as they are, and their neighbours are tracked from them"""
    guides: Mapping[int, Floats[S]] = field(default_factory=dict)
    """poses from pins or refits: tracking starts again from them and solves these frames, too"""
    both_ends: bool = False
    """half of the frames between two such poses are tracked from each"""
    fit_size: bool = True
    """the size is fitted where session and settings ask for it (`TrackingRun.sizes_first`)"""
    track_again: bool = True
    """frames are tracked again where they show another forearm than they were tracked with"""


Segment = tuple[int, Floats[P], range]
"""frames tracked from one pose, forward and to earlier ones backward: the first, solver parameters there, and all of them"""


# ---- events


@array_dataclass
class SizeFitted:
    """The size or forearm was found; frames from here on are of this run."""

    run: TrackingRun
    after_tracking: bool = False
    """it was found in the frames tracked before, which are tracked again with it"""


@array_dataclass
class PassBegan:
    """The frames are tracked from here on, perhaps again: what came before no longer counts."""

    run: TrackingRun
    frames: range
    segments: Sequence[Segment]
    resumed: Sequence[FrameResult] = ()
    """frames of an interrupted pass, which are not tracked again"""


@array_dataclass
class FramesRefined:
    """All frames were optimised jointly; `results` (ascending) are those that it changed."""

    run: TrackingRun
    """with the size that was found with them"""
    results: Sequence[FrameResult]
    refinement: Refinement | None


@array_dataclass
class Ended:
    """The last event. Cancelled, or ended by input that cannot be used, `results` are the frames before that."""

    run: TrackingRun
    frames: range
    """asked for, up to where the recording ends"""
    results: Sequence[FrameResult]
    """ascending; fixed poses among them"""
    refinement: Refinement | None = None
    cancelled: bool = False
    problem: str = ""

    @property
    def is_complete(self) -> bool:
        return not (self.cancelled or self.problem)

    @property
    def track(self) -> TrackResult:
        """The frames as one result."""
        text = None if self.refinement is None else self.refinement.text
        return replace(self.run.result(self.results), refinement=text)


Event = SizeFitted | PassBegan | FrameResult | FramesRefined | str | Ended
"""a frame's result is one of the forward pass; words warn of something about the recording that the tracked frames show"""


def request_for(
    run: TrackingRun, frames: range | None = None, from_init: bool = True
) -> tuple[TrackingRun, TrackingRequest]:
    """Return the run and the request to track a recording with all that a person decided in the workbench for its frames. Where poses
    were set, the run is of the size that they were set for, whether session.toml says it yet or not.

    Parameters
    ----------
    run
        with a first pose, or of a session that has a keyframe
    frames
        those to track; all unless given
    from_init
        whether tracking starts where the session's first pose is, so that a keyframe there counts as that pose

    Raises
    ------
    HandtrackError
        without a first pose
    """
    frames = run.session.known_frames if frames is None else frames
    first, (posed_run, fixed, guides) = run.initial()[0], posed_frames(run)
    start = fixed.get(first)
    pose = guides.get(first) if start is None else start.parameters
    is_solved = start is None or start.status == Status.KEYFRAME  # where tracking starts
    kept = [frame for frame in frames if frame != first or not is_solved]
    return posed_run, TrackingRequest(
        frames,
        first,
        pose if from_init else None,
        {f: fixed[f] for f in kept if f in fixed},
        {f: guides[f] for f in kept if f in guides},
        fit_size=posed_run.scale is run.scale,
    )


def track_session(
    run: TrackingRun,
    request: TrackingRequest | None = None,
    control: Control = Control(),
    take: TakeRecorder | None = None,
) -> Iterator[Event]:
    """Track a session: the same events, and the same numbers, for whoever asks.

    Parameters
    ----------
    run
        of `TrackingRun.open`
    request
        what to track; `request_for(run)` unless given
    control
        `should_stop` is asked between solver steps: true cancels, and while it does not return, tracking pauses; `observer` is
        told on this thread what is not yielded, as it changes quickly
    take
        where frames are kept, and from where an interrupted run resumes; nowhere unless given

    Yields
    ------
    Event
        `Ended` is the last. After a second Ctrl-C (KeyboardInterrupt) it comes at once, as cancelled.

    Raises
    ------
    HandtrackError
        for input that cannot be used, before the first frame; after it, `Ended.problem` says so
    """
    if request is None:
        run, request = request_for(run)
    yield from _Tracking(run, request, control, take).events()


def refine_frames(
    run: TrackingRun,
    request: TrackingRequest,
    tracked: Sequence[FrameResult],
    control: Control,
    changed: Sequence[int] | None = None,
) -> FramesRefined:
    """Optimise tracked frames jointly; fixed poses of the request stay.

    Parameters
    ----------
    tracked
        ascending, without the fixed ones
    changed
        frames whose fixed poses are new since they were last refined: those that they affect alone are done. None: all
    """
    observer = Refining(control.observer)
    control = replace(control, observer=observer)
    before = {result.frame: result for result in tracked}
    fixed = {f: run.model.params_within_limits(r.parameters) for f, r in request.fixed.items()}
    guides = {f: run.model.params_within_limits(pose) for f, pose in request.guides.items()}
    settings = run.settings
    if any(result.status != Status.KEYFRAME for result in request.fixed.values()):
        settings = settings.with_values(
            {"model.fit_size": "false"}
        )  # accepted frames show this person
    found = replace(run, settings=settings).refined(tracked, control, fixed, changed, guides)
    refinement = Refinement.read(observer.refinement) if observer.refinement else None
    scale = None if refinement is None else refinement.scale
    results = [result for result in found if result is not before.get(result.frame)]
    return FramesRefined(run if scale is None else run.with_scale(scale), results, refinement)


def tracking_segments(run: TrackingRun, request: TrackingRequest) -> tuple[Segment, ...]:
    """Return the segments in which frames are tracked: from `first` to the next fixed pose or guide on either side, then on
    from that. Fixed frames are not tracked; their neighbours start from them.
    """
    frames, first, model = request.frames, request.first, run.model
    fixed = {f: model.params_within_limits(r.parameters) for f, r in request.fixed.items()}
    known = {f: model.params_within_limits(pose) for f, pose in request.guides.items()} | fixed
    later = [k for k in sorted(known) if first < k < frames.stop]
    earlier = [k for k in sorted(known, reverse=True) if frames.start <= k < first]
    low = earlier[0] + 1 if earlier else frames.start
    high = later[0] if later else frames.stop
    found: list[Segment] = []
    if first in fixed:
        found.append((first + 1, fixed[first], range(first + 1, high)))
        found.append((first - 1, fixed[first], range(low, first)))
    else:
        start = request.start
        params = run.initial()[1] if start is None else model.params_within_limits(start)
        found.append((first, params, range(low, high)))
    for mark, following in pairwise([*later, frames.stop]):
        begin = mark + 1 if mark in fixed else mark
        found.append((begin, known[mark], range(begin, following)))
    for mark, following in pairwise([*earlier, frames.start - 1]):
        end = mark if mark in fixed else mark + 1
        found.append((end - 1, known[mark], range(following + 1, end)))
    if request.both_ends:
        found = [half for one in found for half in _halves(one, fixed, known)]
    return tuple((start, params, row) for start, params, row in found if row)


def _halves(
    segment: Segment, fixed: Mapping[int, Floats[P]], known: Mapping[int, Floats[P]]
) -> list[Segment]:
    """Return a segment between two poses as one from each of them; any other as it is."""
    *_, frames = segment
    low, high = frames.start, frames.stop
    before = known[low] if low in known and low not in fixed else fixed.get(low - 1)
    after = known.get(high)
    if before is None or after is None:
        return [segment]
    middle = (low + high + 1) // 2
    return [(low, before, range(low, middle)), (high - 1, after, range(middle, high))]


class Refining(Observer):
    """Shows somebody how far refining is; keeps what all frames share."""

    refinement = ""

    def __init__(self, shown: Observer = Observer()) -> None:
        self.progress = shown.progress

    def shared(self, refinement: str) -> None:
        self.refinement = refinement


class _Tracking(Observer):
    """The state of one tracking, from its first event to its last."""

    def __init__(
        self,
        run: TrackingRun,
        request: TrackingRequest,
        control: Control,
        take: TakeRecorder | None,
    ) -> None:
        self._run, self._request, self._take = run, request, take
        self._shown = shown = control.observer
        self.search, self.provisional = shown.search, shown.provisional
        self.progress = shown.progress
        self._interrupted = False
        self._control = replace(control, refines=False, should_stop=self._stops, observer=self)
        self._caller = control
        self._recorded = run.session.live is None
        self._announced = run.session.known_frames.stop
        self._results: dict[int, FrameResult] = {}
        self._steps: list[Step] = []  # until all frames are counted
        self._refined: FramesRefined | None = None
        self._problem = ""

    def _stops(self) -> bool:
        return self._interrupted or self._caller.should_stop()

    def step(self, step: Step) -> None:
        if self._take is not None:
            self._take.add(step)
        if self._recorded and not self._run.session.is_counted:
            self._steps.append(step)

    def _sizing(self, run: TrackingRun, words: str, **frames: Any) -> TrackingRun:
        what = f"the {run.model.kind}'s size" if run.fits_sizes else "where joints are detected"
        self.progress(0.0, f"fitting {what} {words}…", "size")
        return run.fit_size(Control(self._stops, self._shown), **frames)

    def events(self) -> Iterator[Event]:
        """Yield all events."""
        request, run = self._request, self._run
        yield from odd_side(run.first, run.session)
        if request.fit_size and run.sizes_first and run.settings.model.fit_size == "true":
            sized = None
            try:
                sized = self._sizing(run, "")
            except KeyboardInterrupt:
                self._interrupted = True
            if sized is None or self._stops():
                yield self._ended()
                return
            sized = sized.with_limits_of(run)
            self._use(sized)
            yield SizeFitted(sized)
        if self._recorded and run.session.is_counted:
            self._request = replace(self._request, frames=self._counted_frames())
        yield from self._pass()
        if self._recorded and not self._stops() and not self._problem:
            counted = self._counted_frames()
            if counted != self._request.frames:
                self._request = replace(self._request, frames=counted)
                yield from self._pass()
        if self._recorded and not self._stops() and not self._problem:
            yield from self._track_again()
        if self._recorded and self._results and not self._stops():
            yield from self._warnings()
        yield self._ended()

    def _use(self, run: TrackingRun) -> None:
        """Go on with a run whose hand has another size, or a forearm."""
        before, request = self._run, self._request
        self._run = run
        if run.model.parameter_names == before.model.parameter_names:
            return
        self._request = replace(
            request,
            start=None if request.start is None else run.joint_params_from(before, request.start),
            fixed={
                f: keyframe_result(run, f, run.joint_params_from(before, r.parameters))
                for f, r in request.fixed.items()
                if r.status == Status.KEYFRAME  # accepted frames of another model cannot show
            },
            guides={f: run.joint_params_from(before, p) for f, p in request.guides.items()},
        )

    def _pass(self) -> Generator[Event]:
        """Track and refine all frames; what came of it is in `_results` and `_refined`."""
        run, request, take = self._run, self._request, self._take
        segments = tracking_segments(run, request)
        if not segments:
            raise HandtrackError(
                "All these frames are set by hand, found or accepted; there is nothing to track."
            )
        done = [] if take is None else take.begin(run, request.frames, _digests(run, request))
        if not done and self._steps:  # they were tracked before all frames were counted
            done, self._steps = self._steps, []
            for step in done if take is not None else ():
                take.add(step)  # pyright: ignore[reportOptionalMemberAccess]
        resumed = {
            step.result.frame: step.result
            for step in done
            if any(step.result.frame in frames for *_, frames in segments)
        }
        self._results, self._refined, self._problem = dict(resumed), None, ""
        yield PassBegan(run, request.frames, segments, [*resumed.values()])
        known = run.session.known_frames
        try:
            for first, params, frames in segments:
                for result in run.track(frames, first, params, self._control, done):
                    if self._recorded:
                        self._results[result.frame] = result
                    yield result
                    if self._recorded and run.session.known_frames != known:
                        return  # a video has not as many frames as it announces
                if self._stops():
                    return
            if self._recorded and run.settings.refines:
                yield self._refine(segments)
        except KeyboardInterrupt:  # a second Ctrl-C, in the middle of a frame
            self._interrupted = True
        except HandtrackError as error:
            if self._recorded and run.session.known_frames != known:
                return  # the frame is one that was announced alone
            if not self._results:
                raise
            self._problem = str(error)

    def _refine(self, segments: Sequence[Segment]) -> FramesRefined:
        run = self._run
        tracked = [self._results[frame] for frame in sorted(self._results)]
        tracked = tracked_by_new_share(
            run.tracker, run.observation, tracked, segments, self._control
        )
        found = refine_frames(run, self._request, tracked, self._control)
        changed = [r for r in found.results if r is not self._results.get(r.frame)]
        found = replace(found, results=changed)
        self._results |= {result.frame: result for result in changed}
        self._refined = found
        if self._take is not None and changed:
            text = None if found.refinement is None else found.refinement.text
            self._take.refine(replace(found.run.labels, refinement=text), changed)
        return found

    def _counted_frames(self) -> range:
        """Return the frames to track once those of videos are counted, which may be other than they announced."""
        request, session = self._request, self._run.session
        counted, stop = session.frame_range.stop, request.frames.stop
        stop = counted if stop == self._announced else min(stop, counted)
        frames = range(request.frames.start, stop)
        if not frames:
            raise HandtrackError(
                f"{session.folder}: frames from {request.frames.start} on were asked for, but the recording has the "
                f"frames 0 to {counted - 1}: its videos have not as many as they announce."
            )
        return frames

    def _track_again(self) -> Generator[Event]:
        """Track all frames again where they show another size or forearm than they were tracked with."""
        run, request = self._run, self._request
        results = [self._results[frame] for frame in sorted(self._results)]
        if request.fit_size and run.settings.model.fit_size == "later" and run.size_is_open:
            words = f"to the {len(results)} frames that were tracked "
            other = self._sizing(run, words, tracked=results)
            if self._stops():
                yield f"the {run.model.kind}'s size is not fitted."
                return
            yield SizeFitted(other, after_tracking=True)
        elif request.track_again and not request.fixed and not request.guides:
            known = run if self._refined is None else self._refined.run
            other = known.with_arm_of(results)
            if other is known:
                return
            yield SizeFitted(other, after_tracking=True)
        else:
            return
        if other is run:
            return
        before = run, request, self._results, self._refined
        self._use(other.with_limits_of(run))
        yield from self._pass()
        if self._stops() or self._problem:
            if self._take is not None:
                self._take.leave_pass()
            self._run, self._request, self._results, self._refined = before
            self._problem = ""
            yield "tracking again was not finished; what was tracked before is kept."

    def _warnings(self) -> Iterator[str]:
        run, results = self._ended_run, list(self._results.values())
        first = run.first
        # of a pose that was searched points only say its size, and a flat hand's tell no side
        by_joints = (
            first is not None
            and first.xyz is not None
            and (first.confidence is None or run.sees_joints)
            and side_told(misfits_m(first.xyz)) != ""
        )
        if self._take is not None and self._take.is_first and not by_joints:
            tracked = {r.frame: r.parameters for r in results if r.status != Status.LOST}
            control = Control(self._stops)
            text = wrong_side_warning(run.session, run.settings, run.model, tracked, control)
            yield from filter(None, [text])
        refinement = None if self._refined is None else self._refined.refinement
        found = [] if refinement is None else refinement.words
        text = "" if found or self._stops() else inconsistency_of_cameras(run, results)
        yield from found or filter(None, [text])

    @property
    def _ended_run(self) -> TrackingRun:
        return self._run if self._refined is None else self._refined.run

    def _ended(self) -> Ended:
        run, results = self._ended_run, dict(self._results)
        if results or not self._stops():
            for frame, fixed in self._request.fixed.items():
                is_keyframe = fixed.status == Status.KEYFRAME
                results[frame] = (
                    keyframe_result(run, frame, fixed.parameters) if is_keyframe else fixed
                )
        return Ended(
            run,
            self._request.frames,
            [results[frame] for frame in sorted(results)],
            None if self._refined is None else self._refined.refinement,
            self._stops(),
            self._problem,
        )


def _digests(run: TrackingRun, request: TrackingRequest) -> dict[str, str]:
    """Return digests of the poses that a pass is tracked by besides the first one; none where there are none."""
    found = dict[str, str]()
    for name, poses in (
        ("start", {} if request.start is None else {request.first: request.start}),
        ("fixed poses", {f: r.parameters for f, r in request.fixed.items()}),
        ("guides", request.guides),
        ("pins", {}),
    ):
        total = blake2b(digest_size=8)
        for frame, pose in sorted(poses.items()):
            total.update(f"{frame}:".encode())
            total.update(pose.tobytes())
        text = run.session.pins.text if name == "pins" else None
        if poses or text:
            total.update((text or "").encode())
            found[name] = total.hexdigest()
    return found


# ---- Poses that a person decided for single frames, as the session's store has them


def posed_frames(
    run: TrackingRun,
) -> tuple[TrackingRun, dict[int, FrameResult], dict[int, Floats[S]]]:
    """Return what a person decided in the workbench for frames of a recording. Poses of another model count by names.

    Returns
    -------
    run
        with the size and forearm for which the poses were set
    fixed
        keyframes and accepted frames, ascending
    guides
        joint parameters where pins or tuned settings led the solver: tracking starts again from there and solves these frames, too
    """
    store = Store(run.session.folder / TRACKS_FOLDER)
    state, frames = readable(store.state()), run.session.known_frames
    decided = {frame: pose for frame, pose in state.pose.items() if not pose.carried}
    if (
        decided
    ):  # the size and forearm that were found or set; a size still to be fitted does not count
        size, arm_m = state.size, state.forearm
        if arm_m is not None and arm_m != run.arm_m:
            run = run.with_forearm(arm_m)
        if size is not None and not size.pending:
            run = run.with_scale(size.scale)
    model = run.model
    poses = dict[int, Floats]()
    rest = model.joint_params(run.initial()[1] if run.first is not None else model.rest_params())
    for frame, known in decided.items():
        if frame not in frames:
            continue
        names = zip(model.parameter_names, rest, strict=True)
        poses[frame] = np.array([known.parameters.get(name, float(at)) for name, at in names])
    accepted = state.accepted_frames.intersection(frames) - poses.keys()
    return run, *decided_frames(run, state, poses, _tracked(store, model, accepted))


def decided_frames(
    run: TrackingRun,
    state: SessionState,
    poses: Mapping[int, Floats[S]],
    tracked: Mapping[int, FrameResult],
) -> tuple[dict[int, FrameResult], dict[int, Floats[S]]]:
    """Return which frames stay as they are, and the poses from which tracking starts again, as `posed_frames` has them.

    Parameters
    ----------
    poses
        joint parameters of the frames of `state.pose`
    tracked
        of accepted frames that nobody posed
    """
    accepted = state.accepted_frames
    guides = {f: p for f, p in poses.items() if state.pose[f].is_led and f not in accepted}
    posed = {f: keyframe_result(run, f, p) for f, p in poses.items() if f not in guides}
    return dict(sorted({**tracked, **posed}.items())), dict(sorted(guides.items()))


def _tracked(
    store: Store, model: ArticulatedModel, wanted: frozenset[int]
) -> dict[int, FrameResult]:
    """Return tracked frames of the current track, if they are of this model."""
    found = dict[int, FrameResult]()
    for span in store.current() if wanted else ():
        take = store.take(span.take)
        try:
            names = take.about.labels.parameter_names
        except HandtrackError:  # damaged: the store reports it
            continue
        if names == model.parameter_names:
            results = take.results(range(span.first, span.stop))
            found |= {result.frame: result for result in results if result.frame in wanted}
    return found


def keyframe_result(run: TrackingRun, frame: int, joint_params: Floats[S]) -> FrameResult:
    """Return a frame as a person posed it; nothing is known of its uncertainty."""
    model, values = run.model, np.asarray(joint_params, dtype=float)
    params = model.solver_params(values)
    seen = Observation(frame, float(run.session.time_s(frame)))
    return replace(posed_result(model, seen, params, Status.KEYFRAME), parameters=values)
