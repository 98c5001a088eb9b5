"""A person's size and shape from the frames that are surest: which they are, and who it is, a detector's offsets with it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from handtrack.arrays import D3, Floats
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.size import is_unmeasured, unmeasured_size
from handtrack.session.first_pose.image_first_pose import pose_in_space
from handtrack.tracking.frame.doubt.judgement import Judgement
from handtrack.tracking.frame.frame_result import posed_result
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.frame.terms.cloud_terms import agreement
from handtrack.tracking.search.initialize import carried_over
from handtrack.tracking.size.person import OpenPerson
from handtrack.tracking.size.seen_around import FEWEST_BY_JOINTS, image_joints, seen_around
from handtrack.tracking.state import TrackerState
from handtrack.tracking.tracker import Tracker
from handtrack.tracking.whole.chosen_frames import fit_person

if TYPE_CHECKING:
    from handtrack.session.run import TrackingRun

Tell = Callable[[float, str], None]
"""is given the share that is done, 0 to 1, and what is done in words"""
MOST_FRAMES = 8
"""that are used: neighbours show the same"""
MOST_BY_JOINTS = 16
"""that are used where joints are their first poses: spread over all of a recording, they show different postures"""
TRACKED_SHARE = 0.6
"""of the time that a fit takes, where its frames are to be tracked first"""
_LEAST_MEASURED = 0.7  # share of the hand in view that clouds measured, median; behind a can 0.62 made a hand of 125 mm from one of 180
_STRETCH = 40  # frames tracked to fit the hand's size, at least; more until enough of them are sure
_ROUNDS = 2  # of choosing: a better shape makes more frames sure


def tracked_for_size(
    run: TrackingRun, frames: range | None, should_stop: Callable[[], bool] | None, tell: Tell
) -> list[FrameResult]:
    """Return frames tracked from the first pose, each by those before it: all of `frames`, or unless given until enough are sure."""
    live, (start, params) = run.with_values({"tracker.estimate": "forward"}), run.initial()
    results: list[FrameResult] = []
    wanted = frames or run.session.frame_range
    for result in live.track(wanted, start, params, should_stop):
        results.append(result)
        count, sure = len(results), sum(r.status == Status.TRACKED for r in results)
        least = len(wanted) if frames else min(_STRETCH, len(wanted))
        tell(TRACKED_SHARE * min(count / least, 1.0), f"{count} frames tracked, {sure} are sure")
        if frames is None and count >= least and sure >= MOST_FRAMES:
            break
    return results


def posed_by_joints(
    run: TrackingRun, frames: range, should_stop: Callable[[], bool] | None
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
        if should_stop is not None and should_stop():
            return []
        seen = run.seen(frame)
        joints = image_joints(seen)
        found = pose_in_space(run.settings, hand, frame, joints) if joints else None
        if found is not None:
            params = carried_over(hand, found.params, run.model)
            posed.append(posed_result(run.model, seen, params, Judgement(Status.DOUBTFUL)))
    return posed if len(posed) >= FEWEST_BY_JOINTS else []


def size_of_frames(
    run: TrackingRun,
    results: Iterable[FrameResult],
    most: int,
    should_stop: Callable[[], bool] | None,
    tell: Tell,
    sizes: bool = True,
) -> HandScale | None:
    """Return the person who explains the surest frames best, at most so many, of postures that differ; None where none can tell. Where
    clouds alone show the hand, and measured less than 70 % of what they could, the size is held at the population's mean and spread.

    With the shape that is found frames are assessed again, and those that are sure then count too. If `sizes` is not wished,
    where a detector sees joints is found alone.
    """
    stop, scale, used = should_stop or (lambda: False), None, set[int]()
    results = [result for result in results if result.status != Status.LOST]
    for step in range(_ROUNDS):
        if step or any(not result.energies for result in results):
            results = [_assessed(run, one) for one in _spread(results, 2 * most) if not stop()]
        chosen = _unlike(results, most)
        if stop() or not chosen or {result.frame for result in chosen} <= used:
            break
        used = {result.frame for result in chosen}
        seen = [run.seen_at(result) for result in chosen]
        places = list(zip(seen, map(_middle, chosen), strict=True))
        around = any(seen_around(one, place) for one, place in places)
        if sizes and not around and _measured(run, results, most) < _LEAST_MEASURED:
            given = run.first is not None and run.first.xyz is not None  # a size that points tell
            mean = replace(run.scale, overall=run.scale.overall if given else 1.0)
            return unmeasured_size(_who(run).build, mean)
        who = replace(_who(run), sizes=sizes)
        poses = [run.model.transform.solver_params(result.parameters) for result in chosen]
        words = f"{len(chosen)} frames fitted together"
        found = fit_person(
            who, run.model, run.settings, seen, poses, stop,
            lambda share, step=step, words=words: tell((step + share) / _ROUNDS, words),
        )  # fmt: skip
        if found is None:
            break
        scale, run = found, run.with_scale(found)
    return scale


def _assessed(run: TrackingRun, result: FrameResult) -> FrameResult:
    """Return a frame alone at the pose of this person nearest to that it had, and how sure it is."""
    start = run.model.clipped(run.model.transform.solver_params(result.parameters))
    tracker = Tracker(run.model, run.settings)
    return tracker.glance(TrackerState.beginning_at(start), run.seen_at(result))[1]


def _unlike(results: Sequence[FrameResult], most: int) -> list[FrameResult]:
    """Return at most so many frames, ascending: of those that are sure, or as many of the least doubtful, those whose postures differ most."""
    sure = sorted(results, key=lambda r: (r.status != Status.TRACKED, np.nan_to_num(r.p_off_25mm)))
    sure = sure[: max(sum(r.status == Status.TRACKED for r in sure), most)]
    joints = np.array([result.joint_positions - _middle(result) for result in sure])
    kept, far = [0] if sure else [], np.full(len(sure), np.inf)
    while 0 < len(kept) < min(most, len(sure)):
        far = np.minimum(far, np.linalg.norm(joints - joints[kept[-1]], axis=2).mean(axis=1))
        kept.append(int(np.argmax(far)))
    return sorted((sure[n] for n in kept), key=lambda result: result.frame)


def who_is_open(run: TrackingRun) -> OpenPerson | None:
    """Return what of the person refining may find: not what was given, and nothing where `model.fit_size` says so."""
    if run.settings.model.fit_size == "false" or is_unmeasured(run.scale):
        return None
    return _who(run)


def _who(run: TrackingRun) -> OpenPerson:
    def build(scale: HandScale) -> ArticulatedModel:
        return replace(run.with_scale(scale).model, limits=run.model.limits)

    sizes, offsets = run.session.hand_scale == "fit", run.offsets_are_open
    return OpenPerson(build, sizes, offsets, run.known_person)


def _spread(results: Sequence[FrameResult], most: int) -> list[FrameResult]:
    """Return at most so many, evenly spread."""
    if len(results) <= most:
        return list(results)
    return [results[round(i)] for i in np.linspace(0, len(results) - 1, most)]


def _measured(run: TrackingRun, results: Sequence[FrameResult], most: int) -> float:
    """Return which share of the hand in view clouds measured, the median of frames; 1 where there are none."""
    shares = []
    for result in _spread(sorted(results, key=lambda r: r.frame), most):
        bones = run.model.bones(run.model.transform.solver_params(result.parameters))
        terms = frame_terms(run.model, run.settings, run.seen_at(result), bones, None)
        found = None if terms.cloud is None else agreement(terms.cloud, run.model, bones)
        shares += [] if found is None else [found.measured]
    return float(np.nanmedian(shares)) if np.isfinite(shares).any() else 1.0


def _middle(result: FrameResult) -> Floats[D3]:
    return np.asarray(result.joint_positions.mean(axis=0))
