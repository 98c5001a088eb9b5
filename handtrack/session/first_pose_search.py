"""First poses that the program finds by itself, in one frame of a session or in the surest of several."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import islice

import numpy as np

from handtrack.errors import HandtrackError
from handtrack.model.articulated import HandScale
from handtrack.observation.observation import Observation
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.session.sources.keypoint_files import NO_JOINTS, of_model
from handtrack.tracking.find_pose import (
    SURE,
    PoseEstimate,
    differs,
    pose_in_space,
    poses_by_joints,
    spread_order,
)
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.result import Status
from handtrack.tracking.search.engine import Candidate
from handtrack.tracking.search.global_search import Progress, auto_start
from handtrack.tracking.search.start_confidence import KNOWN_SIZE_SIGMA, SIZE_SIGMA
from handtrack.tracking.sequence import track_frames
from handtrack.tracking.tracker import CONFIRMED_BY

_MOST_TRIED = 4  # frames in which a hand is looked for
_MOST_OPENED = 40  # frames that are opened to see whether there is anything in them
_USUAL = 0.02  # a size that differs by no more from the one in use is not worth a word
_FEWEST_PX = 200  # mask pixels, or points, that may be a hand
_KNOWN = 0.5  # more likely than not its joints are within 12 mm
_FEWEST_IN_ONE = 8  # joints of one image that may say how a hand or body is turned: palm or trunk, and two chains
_SHOWN_BY = {
    "hand": "hand in silhouettes, cloud or joints",
    "body": f"body by {_FEWEST_IN_ONE} joints or more",
}


def find_first_poses(
    run: TrackingRun,
    frame: int | range | None = None,
    should_stop: Callable[[], bool] | None = None,
    on_progress: Progress | None = None,
) -> list[PoseEstimate]:
    """Return first poses of one frame, the surest first; empty where no hand was found.

    Looks at joints on which two cameras agree, the session's or what the hand detector sees in the
    images, where its weights are there; else at silhouettes and clouds, as far as the settings use
    them; where there are none, and for a body, at the joints of one camera, which leave several
    poses open. What init.json says does not matter.

    Parameters
    ----------
    frame
        That one; or the surest of a few frames of a range, of all frames where None.

    Raises
    ------
    HandtrackError
        For a body without joints.
    """
    if run.model.kind != "hand" and not run.sees_joints:
        raise HandtrackError(
            f"{run.session.folder}: {NO_JOINTS.format(model=run.model.name)} Or pose it in the workbench (`handtrack open`), or give a "
            "pose with --init FILE."
        )
    report = on_progress or (lambda share, text: None)
    stop = should_stop or (lambda: False)
    searches = _MOST_TRIED + (not _is_size_known(run))

    best: list[PoseEstimate] = []

    def is_over() -> bool:
        sure = best and best[0].settled >= SURE and best[0].p_in_basin >= _KNOWN
        return stop() or bool(sure)

    def surer(seen: Observation, scale: HandScale, step: int) -> list[PoseEstimate]:
        """Return the poses of this frame, looked for with a hand of that size; none where the best so far are as sure."""

        def report_here(share: float, text: str) -> None:
            report((step + share) / searches, f"frame {seen.frame}: {text}")

        found = _candidates_in(run, scale, seen, stop, report_here)
        least = best[0].confidence if best else -np.inf
        return found if found and found[0].confidence > least else []

    best_observation: Observation | None = None
    for step, seen in enumerate(_candidate_observations(run, frame)):
        if found := surer(seen, run.scale, step):
            best, best_observation = found, seen
        if is_over():
            break
    if best_observation is not None and not is_over() and best[0].points is not None:
        # hands of another size are found where they are as large as that
        best = surer(best_observation, best[0].model.scale, _MOST_TRIED) or best
    report(1.0, "done")
    return best


def confirmed_by_tracking(
    run: TrackingRun, frames: range, should_stop: Callable[[], bool] | None
) -> bool:
    """Return whether frames in a row, tracked from a run's first pose that is not sure, confirm it by their own evidence."""
    frame, start = run.initial()
    row = range(frame, frame + CONFIRMED_BY)
    if row.stop > frames.stop:  # backward from it
        row = range(frame + 1 - CONFIRMED_BY, frame + 1)
    if row.start < frames.start:
        return False
    control = Control(should_stop=should_stop) if should_stop else Control()
    tracked = [*track_frames(run.tracker, run.observation, frame, start, row, control)]
    return len(tracked) == CONFIRMED_BY and tracked[-1].status == Status.TRACKED


def _is_size_known(run: TrackingRun) -> bool:
    return run.session.hand_scale != "fit" or run.scale != HandScale()


def _candidate_observations(run: TrackingRun, frame: int | range | None) -> Iterator[Observation]:
    """Yield what was seen of a frame, or of a few that may show a hand, spread over all: those whose joints say where it is
    before those that may only be searched.
    """
    look = _looking(run)
    if isinstance(frame, int):
        return iter([look(frame)])
    order = spread_order(run.session.frame_range if frame is None else frame)[:_MOST_OPENED]
    opened, may_show = map(look, order), partial(_may_show_a_hand, run)
    if not run.sees_joints and look == run.observed:
        return islice(filter(may_show, opened), _MOST_TRIED)
    return islice(_those_with_joints_first(opened, may_show), _MOST_TRIED)


def _those_with_joints_first(
    opened: Iterator[Observation], may_show: Callable[[Observation], bool]
) -> Iterator[Observation]:
    """Yield frames that may show a hand; any without joints in two images once as many were opened as are looked for in."""
    others: list[Observation] = []
    for seen in opened:
        if _has_joints_in_two(seen):
            yield seen
        elif may_show(seen):
            others.append(seen)
        if len(others) == _MOST_TRIED:
            break
    yield from others
    yield from filter(may_show, opened)


def _looking(run: TrackingRun) -> Callable[[int], Observation]:
    """Return what looks at a frame: with the detector's joints, where the session has none and the weights are there."""
    session = run.session
    if not isinstance(session, Session) or any(view.keypoint_files for view in session.views):
        return run.observed
    from handtrack.session.detection import joints_of_frame, usable_detector  # seldom

    detector = usable_detector(session)
    if detector is None:
        return run.observed

    def look(frame: int) -> Observation:
        joints = joints_of_frame(session, frame, detector, run.settings.keypoints.detected_px)
        seen = run.observed(frame)
        return replace(seen, keypoints=(*seen.keypoints, *joints))

    return look


def _of_size(row: PoseEstimate, usual: float) -> PoseEstimate:
    """Return a pose of a hand that is not of the usual size with its joints in space, to which the size is fitted."""
    size = row.model.scale.overall / usual
    if abs(size - 1.0) <= _USUAL:
        return row
    joints = row.model.keypoints21(row.model.bones(row.params))
    return replace(row, points=joints, note=f"{row.note}; {size:.2g} times the usual size")


def no_pose_error(run: TrackingRun) -> HandtrackError:
    """Return what to tell the user where no frame shows a hand."""
    seen = run.observed(next(iter(spread_order(run.session.frame_range))))
    filled = [s.camera.name for s in seen.silhouettes if s.fills_image]
    why = (
        f"In frame {seen.frame} more than half of the image is hand in the masks of {', '.join(filled)}: are they inverted? "
        if filled
        else ""
    )
    return HandtrackError(
        f"{run.session.folder}: no first pose was found: no frame that was looked at shows a {_SHOWN_BY[run.model.kind]}. {why}"
        f"Look at them with `handtrack doctor`, or pose the {run.model.kind} in the workbench (`handtrack open`)."
    )


def _candidates_in(
    run: TrackingRun,
    scale: HandScale,
    seen: Observation,
    should_stop: Callable[[], bool] | None,
    report: Progress,
) -> list[PoseEstimate]:
    known = _is_size_known(run)
    sigma, resize = (KNOWN_SIZE_SIGMA, None) if known else (SIZE_SIGMA, run.resized)
    models = (run if scale == run.scale else run.with_scale(scale)).whole_hands()
    joints = of_model(seen, models[0]).image_keypoints
    placed = pose_in_space(run.settings, models[0], seen.frame, joints) if joints else None
    if placed is not None:
        return [placed]
    if _is_by_joints_alone(run, seen):
        enough = _most_joints(seen) >= _FEWEST_IN_ONE
        return poses_by_joints(models[0], seen.frame, joints) if enough else []
    found = auto_start(models, run.settings, seen, should_stop, report, sigma, resize)
    if not found:
        return []
    rows = [PoseEstimate.of(candidate, seen.frame) for candidate in found]
    notes = [_fits(found[0]), *(differs(rows[0], row) for row in rows[1:])]
    usual = run.scale.overall
    noted = [replace(row, note=note) for row, note in zip(rows, notes, strict=True)]
    return [_of_size(row, usual) for row in noted]


def _fits(best: Candidate) -> str:
    arm = "with a forearm" if best.model.has_forearm else "no forearm in view"
    if best.p_in_basin < _KNOWN:
        arm += "; from here, its joints are not known to 12 mm"
    return arm if best.result.status == Status.TRACKED else f"{arm}; {best.result.note}"


def _has_joints_in_two(seen: Observation) -> bool:
    return len({joints.camera for joints in seen.image_keypoints}) > 1


def _is_by_joints_alone(run: TrackingRun, seen: Observation) -> bool:
    """Return whether nothing but joints can say where the hand or body is."""
    return run.model.kind == "body" or not (seen.silhouettes or seen.cloud is not None)


def _most_joints(seen: Observation) -> int:
    """Return how many joints the image shows that shows most."""
    known = [np.isfinite(joints.pixels).all(axis=1).sum() for joints in seen.image_keypoints]
    return int(max(known, default=0))


def _may_show_a_hand(run: TrackingRun, seen: Observation) -> bool:
    """Return whether a frame has enough to look for a hand or body in: two silhouettes (one, where there is one camera), joints in
    two images, or a cloud; joints in one image where there is nothing else.
    """
    if _has_joints_in_two(seen):
        return True
    if _is_by_joints_alone(run, seen):
        return _most_joints(seen) >= _FEWEST_IN_ONE
    if seen.cloud is not None and len(seen.cloud) >= _FEWEST_PX:
        return True
    full = sum(
        int((s.mask > 0.5).sum()) >= _FEWEST_PX and not s.fills_image for s in seen.silhouettes
    )
    return full >= min(2, len(seen.silhouettes)) > 0
