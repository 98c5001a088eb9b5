"""A person's hand size from tracked frames: which of them can tell it, and what it is, a detector's offsets with it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from handtrack.arrays import D3, Floats
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.size import is_unmeasured, unmeasured_size
from handtrack.session.first_pose.image_first_pose import pose_in_space
from handtrack.tracking.frame.frame_result import posed_result
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.search.initialize import carried_over
from handtrack.tracking.search.poor_cloud import agreement
from handtrack.tracking.size.person import OpenPerson
from handtrack.tracking.size.seen_around import (
    FEWEST_BY_JOINTS,
    image_joints,
    joints_around,
    seen_around,
)
from handtrack.tracking.size.size import refine_scale

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
_STRETCH = 40  # frames tracked to fit the hand's size


def stretch_after(start: int, count: int) -> range:
    """Return the frames to be tracked for a fit: some after the first pose, or the last ones of all."""
    after = range(start, min(start + _STRETCH, count))
    return after if len(after) > 1 else range(max(count - _STRETCH, 0), count)


def tracked_for_size(
    run: TrackingRun, frames: range | None, should_stop: Callable[[], bool] | None, tell: Tell
) -> list[FrameResult]:
    """Return frames tracked from the first pose, a stretch after it unless given."""
    start, params = run.initial()
    frames = frames or stretch_after(start, run.session.frame_count)
    results: dict[int, FrameResult] = {}
    for result in run.track(frames, start, params, should_stop):
        results[result.frame] = result
        done, count = len(results), len(frames)
        tell(TRACKED_SHARE * done / count, f"{done} of {count} frames tracked")
    return list(results.values())


def posed_by_joints(
    run: TrackingRun, frames: range, should_stop: Callable[[], bool] | None
) -> list[FrameResult]:
    """Return frames spread evenly over `frames` at the poses that joints of two cameras say; none where too few have any.

    They are not tracked yet: what else was seen of them is for the fit to meet.
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
            posed.append(posed_result(run.model, seen, params, Status.TRACKED, None))
    return posed if len(posed) >= FEWEST_BY_JOINTS else []


def size_of_frames(
    run: TrackingRun,
    results: Iterable[FrameResult],
    most: int,
    should_stop: Callable[[], bool] | None,
    tell: Tell,
    sizes: bool = True,
) -> HandScale | None:
    """Return the size that explains at most so many of the frames best, evenly spread; None where none can tell it. Where clouds
    alone show the hand, and measured less than 70 % of what they could, it is held at the population's mean and spread.

    Seen from around, every finger has a size of its own; clouds are one-sided and tell the whole hand's only. Where a
    detector's joints are seen from around, where it sees them is found with the size; alone, if `sizes` is not wished.
    """
    results = list(results)
    tracked = sorted((r for r in results if r.fits), key=lambda r: r.frame)
    seen = [(result, run.seen_at(result)) for result in _spread(tracked, most)]
    around = [(r, known) for r, known in seen if seen_around(known, _middle(r))]
    if sizes and not around and _measured(run, results, most) < _LEAST_MEASURED:
        given = run.first is not None and run.first.xyz is not None  # a size that points tell
        mean = replace(run.scale, overall=run.scale.overall if given else 1.0)
        return unmeasured_size(lambda size: run.with_scale(size).model, mean)
    used = around or [pair for pair in seen if pair[1].cloud is not None]
    places = [(known, _middle(result)) for result, known in used]
    joints = joints_around(places) if run.sees_joints else ()
    if not used or not (sizes or joints):
        return None
    return refine_scale(
        lambda size: run.with_scale(size).model,
        run.settings,
        run.scale,
        [known for _, known in used],
        [run.model.transform.solver_params(result.parameters) for result, _ in used],
        should_stop,
        parts=bool(around),
        tell=tell,
        seen=joints,
        sizes=sizes,
    )


def who_is_open(run: TrackingRun) -> OpenPerson | None:
    """Return what of the person refining may find: not what was given, and nothing where `model.fit_size` says so."""
    if not run.size_is_open or is_unmeasured(run.scale):
        return None

    def build(scale: HandScale) -> ArticulatedModel:
        return replace(run.with_scale(scale).model, limits=run.model.limits)

    return OpenPerson(build, sizes=run.session.hand_scale == "fit", known=run.known_person)


def _spread(results: Sequence[FrameResult], most: int) -> list[FrameResult]:
    """Return at most so many, evenly spread."""
    if len(results) <= most:
        return list(results)
    return [results[round(i)] for i in np.linspace(0, len(results) - 1, most)]


def _measured(run: TrackingRun, results: Sequence[FrameResult], most: int) -> float:
    """Return which share of the hand in view clouds measured, the median of frames; 1 where there are none."""
    shares = []
    posed = sorted((r for r in results if r.status != Status.LOST), key=lambda r: r.frame)
    for result in _spread(posed, most):
        bones = run.model.bones(run.model.transform.solver_params(result.parameters))
        terms = frame_terms(run.model, run.settings, run.seen_at(result), bones, None)
        found = None if terms.cloud is None else agreement(terms.cloud, run.model, bones)
        shares += [] if found is None else [found.measured]
    return float(np.median(shares)) if shares else 1.0


def _middle(result: FrameResult) -> Floats[D3]:
    return np.asarray(result.joint_positions.mean(axis=0))
