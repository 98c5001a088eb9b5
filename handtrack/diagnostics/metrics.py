"""Standard measures of a tracked sequence against the truth, as `handtrack evaluate` prints them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D3, Array, Floats, Ints, N, indices
from handtrack.diagnostics.constant_offsets import (
    known_median,
    mean_size,
    offset_free_errors,
    wrong_frames,
)
from handtrack.diagnostics.flexion import flexion_errors
from handtrack.errors import HandtrackError
from handtrack.geometry.rotation import turn_between
from handtrack.model.articulated import JOINT_CENTRES, definition_among, keypoint_names
from handtrack.observation.truth import Truth
from handtrack.tracking.frame.result import Status, TrackResult
from handtrack.tracking.frame.tables.track_model import model_of

_CHI2_90 = 6.251388631170325  # 90 % of a 3D normal distribution lies within this squared distance
_LEAST_STD_M = 1e-6  # a covariance flatter than this is taken as this thick
_PCK_MM = np.linspace(0.0, 50.0, 101)


@dataclass(frozen=True)
class _Compared:
    """Points (T, N, 3) of the T truth frames [mm], and what the track says of them."""

    frame: Ints
    names: tuple[str, ...]
    truth: Floats
    """NaN where unknown"""
    estimated: Floats
    """a missing or lost frame holds the last estimate"""
    covariance: Floats | None
    """(T, N, 3, 3) [mm²]"""
    tracked: Array
    """(T,) whether the frame was tracked, neither missing nor lost"""
    sure: Array
    """(T,) whether it is of high confidence, neither doubtful, missing nor lost"""
    turns: Floats | None
    """(T, N, 3, 3) bone → world of the bones that carry the points; None where the track does not say which these are"""


def evaluate(
    track: TrackResult, truth: Truth, landmarks: str | None = None
) -> dict[str, float | int | None]:
    """Return the measures of contracts §3, in mm; None where there is nothing to measure.

    On top come `finger_swaps` and, of hands, how far their joints are bent (`flexion_errors`, in
    degrees).

    Compared are keypoints21 where the truth has them, else joints of equal name, by frame number.
    Every truth frame counts: a missing or lost one with its last estimate (the first estimate
    before tracking begins). Unknown (NaN) points do not count.

    `offset_free` figures are beside each point's constant offset in its bone's frame, fitted on one
    half of the frames and applied to the other (`constant_offsets`): None where the track does not
    say how its model is built.

    `wrong_frames`, of hands, have a keypoint more than 25 mm off beside its constant offset
    (`constant_offsets.WRONG_M`): of frames of low confidence (doubtful, lost or missing) and of
    all.

    Last come how many frames of the truth and how many of their points were used, and of each
    joint.

    `jitter_mm` and `coverage90` are about tracked frames alone: a held estimate neither moves nor
    says anew how sure it is.

    Parameters
    ----------
    landmarks
        The definition in which points are compared; None: see `in_truths_landmarks`.

    Raises
    ------
    HandtrackError
        When nothing can be compared.
    """
    points = _compared(in_truths_landmarks(track, truth, landmarks), truth)
    error = np.linalg.norm(points.estimated - points.truth, axis=2)
    known = np.isfinite(error)
    tips = np.array([name.endswith("_tip") for name in points.names])
    every, tracked = error[known], error[known & points.tracked[:, None]]
    return {
        "mpjpe_mm": mean_size(every),
        "mpjpe_median_mm": float(np.median(every)),
        "p95_mm": float(np.percentile(every, 95)),
        "max_mm": float(every.max()),
        "mpjpe_tracked_mm": mean_size(tracked),
        "pa_mpjpe_mm": _aligned_error(points),
        "fingertip_mm": mean_size(error[known & tips]),
        "pck_auc_50mm": _pck_auc(every),
        "jitter_mm": _jitter(points),
        "lost_frames": int((~points.tracked).sum()),
        "coverage90": _coverage(points),
        "finger_swaps": _swaps(points, tips),
        **(
            flexion_errors(points.estimated, points.truth)
            if points.names == keypoint_names()
            else {}
        ),
        **_position_errors(points, error),
        **_wrong_frames(points),
        "frames_used": len(points.frame),
        "points_used": int(known.sum()),
        "points_unknown": int((~known).sum()),
        **{
            f"used_{name}": int(count)
            for name, count in zip(points.names, known.sum(axis=0), strict=True)
        },
    }


def in_truths_landmarks(track: TrackResult, truth: Truth, landmarks: str | None) -> TrackResult:
    """Return the track with the points that the truth has: in the definition asked for, else in that which the truth says
    (`keypoint_definition`) if the track has it, else as they are. Raises HandtrackError for one asked for that it has not.
    """
    theirs = truth.keypoint_definition
    known = theirs == JOINT_CENTRES or definition_among(track.landmark_definitions, theirs)
    wanted = landmarks or (theirs if known else None)
    return track if wanted is None else track.in_landmarks(wanted)


def similarity(points: Floats[N, D3], target: Floats[N, D3]) -> Floats[N, D3]:
    """Return points moved, turned and scaled to fit target best (Umeyama 1991)."""
    centre, goal = points.mean(axis=0), target.mean(axis=0)
    a, b = points - centre, target - goal
    turned, spread = a @ turn_between(a, b).T, (a**2).sum()
    return turned * ((turned * b).sum() / spread if spread > 0 else 1.0) + goal


# ---- what is compared ------------------------------------------------------------------------------


def _compared(track: TrackResult, truth: Truth) -> _Compared:
    names, found, true = _points(track, truth)
    known = np.all(np.isfinite(true), axis=2)
    rows = np.flatnonzero(known.any(axis=1))
    if not len(rows):
        raise HandtrackError("the truth has no finite point, so there is nothing to compare.")
    frames = np.asarray(truth.frame)[rows]
    if not np.isin(frames, track.frame).any():
        raise HandtrackError(
            f"no frame in common: the truth has frames {frames.min()} to {frames.max()}, the result "
            f"{track.frame[0]} to {track.frame[-1]}."
        )
    order = np.argsort(frames)
    frames, true = frames[order], np.where(known[:, :, None], true, np.nan)[rows[order]]
    usable = np.flatnonzero(np.isfinite(found).any(axis=(1, 2)))
    if not len(usable):
        raise HandtrackError("the result has no frame with finite joint positions.")
    last = np.searchsorted(track.frame[usable], frames, side="right") - 1
    source = usable[np.maximum(last, 0)]
    here = track.frame[source] == frames
    seen = here & (track.status[source] != Status.LOST)
    spread, turns = _covariance(track, names), _turns(track, names)
    found = 1e3 * found[source]
    return _Compared(
        frames,
        names,
        np.where(np.isfinite(found), 1e3 * true, np.nan),
        found,
        None if spread is None else 1e6 * spread[source],
        seen,
        seen & (track.status[source] != Status.DOUBTFUL),
        None if turns is None else turns[source],
    )


def _points(track: TrackResult, truth: Truth) -> tuple[tuple[str, ...], Floats, Floats]:
    if truth.keypoints21 is not None and track.keypoints21 is not None:
        return keypoint_names(), track.keypoints21, np.asarray(truth.keypoints21)
    positions = truth.joint_positions
    theirs = [str(name) for name in truth.joint_names] if positions is not None else []
    common = [name for name in track.joint_names if name in theirs]
    if positions is None or not common:
        keypoints = "21 hand keypoints alone" if truth.keypoints21 is not None else "none"
        raise HandtrackError(
            "nothing to compare: no joint has the same name in result and truth. Joints of the result: "
            f"{', '.join(track.joint_names)}. Of the truth: {', '.join(theirs) or keypoints}."
        )
    ours = indices(track.joint_names, common)
    return (
        tuple(common),
        track.joint_positions[:, ours],
        positions[:, [theirs.index(n) for n in common]],
    )


def _covariance(track: TrackResult, names: Sequence[str]) -> Floats | None:
    """Return (F, N, 3, 3) [m²], None when the track does not state it for all these points."""
    if any(name not in track.joint_names for name in names):
        return None
    return track.joint_covariance[:, indices(track.joint_names, names)]


def _turns(track: TrackResult, names: Sequence[str]) -> Floats | None:
    """Return bone → world (F, N, 3, 3) of the bones that carry the points, None where the track does not say which these are."""
    try:
        model = model_of(track)
    except HandtrackError:
        return None
    bones = model.joint_bone[indices(model.joint_names, names)]
    return track.T_world_bone[:, bones, :3, :3]


# ---- measures --------------------------------------------------------------------------------------


def _position_errors(points: _Compared, error: Floats) -> dict[str, float | int | None]:
    """Return errors of each point [mm], and of all and each beside its constant offset in its bone's frame."""
    beside = np.full_like(error, np.nan)
    if points.turns is not None:
        beside = offset_free_errors(points.estimated, points.truth, points.turns)
    each = [*enumerate(points.names)]
    return {
        "offset_free_mm": mean_size(beside),
        "offset_free_median_mm": known_median(beside),
        **{f"position_{name}_mm": mean_size(error[:, k]) for k, name in each},
        **{f"position_{name}_offset_free_mm": mean_size(beside[:, k]) for k, name in each},
    }


def _wrong_frames(points: _Compared) -> dict[str, float | int | None]:
    """Return how many frames are wrong, how many are of low confidence, and how many are both."""
    if points.names != keypoint_names():
        return {}
    wrong = wrong_frames(1e-3 * points.estimated, 1e-3 * points.truth)
    return {
        "wrong_frames": int(wrong.sum()),
        "low_confidence_frames": int((~points.sure).sum()),
        "wrong_low_confidence_frames": int((wrong & ~points.sure).sum()),
    }


def _aligned_error(points: _Compared) -> float | None:
    """Return the mean error after a similarity fit per frame; frames with under 3 known points do not count."""
    errors = []
    for found, true in zip(points.estimated, points.truth, strict=True):
        known = np.isfinite(true).all(axis=1)
        if known.sum() >= 3:
            fitted = similarity(found[known], true[known])
            errors.append(np.linalg.norm(fitted - true[known], axis=1))
    return mean_size(np.concatenate(errors)) if errors else None


def _pck_auc(errors: Floats) -> float:
    share = np.array([(errors <= threshold).mean() for threshold in _PCK_MM])
    return float(np.trapezoid(share, _PCK_MM) / _PCK_MM[-1])


def _jitter(points: _Compared) -> float | None:
    """Return the median norm of second differences over three tracked frames in a row."""
    one = np.diff(points.frame) == 1
    middle = 1 + np.flatnonzero(
        one[1:] & one[:-1] & points.tracked[2:] & points.tracked[1:-1] & points.tracked[:-2]
    )
    bend = (
        points.estimated[middle + 1] - 2 * points.estimated[middle] + points.estimated[middle - 1]
    )
    return known_median(np.linalg.norm(bend, axis=2))


def _swaps(points: _Compared, tips: Array) -> int | None:
    """Return how many fingertips, over all frames, are nearer to another finger's true tip than to their own."""
    found, true = points.estimated[:, tips], points.truth[:, tips]
    if true.shape[1] < 2:
        return None
    apart = np.linalg.norm(found[:, :, None] - true[:, None, :], axis=3)
    own = np.diagonal(apart, axis1=1, axis2=2)
    other = np.where(np.isfinite(apart), apart, np.inf)
    other[:, np.arange(len(own[0])), np.arange(len(own[0]))] = np.inf
    return int((other.min(axis=2) < own).sum())


def _coverage(points: _Compared) -> float | None:
    """Return the share of tracked points inside their stated 90 % ellipsoid."""
    if points.covariance is None:
        return None
    asked = np.isfinite(points.truth).all(axis=2) & points.tracked[:, None]
    if not asked.any():
        return None
    error = (points.estimated - points.truth)[asked]
    reported = points.covariance[asked]
    sound = np.isfinite(reported).all(axis=(1, 2))  # an estimate that states nothing covers nothing
    values, vectors = np.linalg.eigh(reported[sound])
    along = np.einsum("nij,ni->nj", vectors, error[sound])
    least = (1e3 * _LEAST_STD_M) ** 2
    inside = (along**2 / np.maximum(values, least)).sum(axis=1) <= _CHI2_90
    return float(inside.sum() / len(error))
