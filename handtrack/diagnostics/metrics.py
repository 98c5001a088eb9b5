"""Standard measures of a tracked sequence against the truth, as `handtrack evaluate` prints them."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import D3, D21, Array, Axes, F, Floats, J, N, indices
from handtrack.errors import HandtrackError
from handtrack.geometry.rotation import turn_between
from handtrack.model.articulated import FINGERS, JOINT_CENTRES, definition_among, keypoint_names
from handtrack.observation.observation import check_kind
from handtrack.observation.truth import Truth
from handtrack.tracking.frame.result import COLUMNS, Status, TrackResult, model_of

# ---- Errors beside a constant offset, which two definitions of the same point have, and which frames are wrong by them


WRONG_M = 0.025
"""a hand's frame is wrong where one of its 21 keypoints is further off than that beside its constant offset (`without_offsets`): about
a finger's breadth and a half, another finger's place"""


def beside_other_half(errors: Floats[F, *Axes]) -> Floats[F, *Axes]:
    """Return errors beside the median of those in the other half of the frames, in time: neighbouring frames err alike, so that a
    median of every second frame would know what it is applied to. NaN where unknown, or where the other half knows nothing.
    """
    half = len(errors) // 2
    first, second = errors[:half], errors[half:]
    return np.concatenate([first - _median(second), second - _median(first)])


def offset_free_errors(
    found: Floats[F, N, D3], truth: Floats[F, N, D3], turns: Floats[F, N, D3, D3]
) -> Floats[F, N]:
    """Return how far points are off beside each one's constant offset in its bone's frame, in their
    unit; NaN where unknown.

    Parameters
    ----------
    turns
        Bone → world of the bone that carries each point.
    """
    own = np.einsum("fnji,fnj->fni", turns, truth - found)
    return np.linalg.norm(beside_other_half(own), axis=2)


def without_offsets(found: Floats[F, D21, D3], truth: Floats[F, D21, D3]) -> Floats[F, D21, D3]:
    """Return a hand's errors, in the world, beside each keypoint's median over all frames in the frame of its true bone, in their unit.

    All frames, other than in `offset_free_errors`: a finger that is wrong in half of one half would make the other half's frames wrong.
    """
    turns = bone_frames(truth)
    own = np.einsum("fjab,fja->fjb", turns, found - truth)
    return np.einsum("fjab,fjb->fja", turns, own - _median(own))


def wrong_frames(found: Floats[F, D21, D3], truth: Floats[F, D21, D3]) -> Array[F]:
    """Return which frames of a hand are wrong (`WRONG_M`); points in metres, NaN where unknown."""
    off = np.linalg.norm(without_offsets(found, truth), axis=2)
    return np.where(np.isfinite(off), off, 0.0).max(axis=1) > WRONG_M


def bone_frames(points: Floats[F, D21, D3]) -> Floats[F, J, D3, D3]:
    """Return a frame (F, 21, 3, 3) for each of a hand's keypoints: along its bone, and across the hand."""
    across, up = _unit(points[:, 5] - points[:, 17]), _unit(points[:, 9] - points[:, 0])
    back = _unit(np.cross(across, up))
    found = np.zeros((len(points), 21, 3, 3))
    for j in range(21):
        x, side = up, across
        if j not in (0, 5, 9, 13, 17):
            x = _unit(points[:, j] - points[:, 0 if j == 1 else j - 1])
            side = across if j > 4 else back
        y = _unit(side - x * (side * x).sum(axis=1, keepdims=True))
        found[:, j] = np.stack([x, y, np.cross(x, y)], axis=-1)
    return found


def _unit(v: Floats[F, D3]) -> Floats[F, D3]:
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-9)


def _median(values: Array[F, *Axes]) -> Floats[*Axes]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what is nowhere known
        return np.nanmedian(np.where(np.isfinite(values), values, np.nan), axis=0)


def known_median(values: Floats[*Axes]) -> float | None:
    """Return the median of the values that are known; None where none is."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None


def mean_size(errors: Floats[*Axes]) -> float | None:
    """Return the mean size of the errors that are known; None where none is."""
    known = np.isfinite(errors)
    return float(np.abs(errors[known]).mean()) if known.any() else None


# ---- How far joints are bent, from points alone: what a hand's angles are compared by, whatever model either side has


_KEYPOINTS = keypoint_names()
_CHAINS = [
    [0, *(n for n, name in enumerate(_KEYPOINTS) if name.startswith(f"{f}_"))] for f in FINGERS
]
_BENT = [triple for chain in _CHAINS for triple in zip(chain, chain[1:], chain[2:], strict=False)]
BENT_JOINTS = tuple(_KEYPOINTS[joint] for _, joint, _ in _BENT)
"""three a finger, from the palm out"""


def flexion_deg(keypoints21: Floats[F, D21, D3]) -> Floats[F, N]:
    """Return by how much the way along each finger turns at its joints [°], 0 where straight; NaN where a point is unknown.

    Between wrist, joint and next joint: a knuckle's spread counts with its bending.
    """
    before, here, after = (keypoints21[:, list(part)] for part in zip(*_BENT, strict=True))
    came, goes = here - before, after - here
    lengths = np.linalg.norm(came, axis=2) * np.linalg.norm(goes, axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = (came * goes).sum(axis=2) / lengths
    return np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))


def flexion_errors(
    found: Floats[F, D21, D3], truth: Floats[F, D21, D3]
) -> dict[str, float | int | None]:
    """Return the mean error of the joints' flexion [°], as it is and beside each joint's own constant offset (two models call
    different points a knuckle; `beside_other_half`): of all, and of each joint; None where nothing is known.
    """
    off = flexion_deg(found) - flexion_deg(truth)
    beside = beside_other_half(off)
    each = [*enumerate(BENT_JOINTS)]
    return {
        "flexion_deg": mean_size(off),
        "flexion_offset_free_deg": mean_size(beside),
        **{f"flexion_{name}_deg": mean_size(off[:, k]) for k, name in each},
        **{f"flexion_{name}_offset_free_deg": mean_size(beside[:, k]) for k, name in each},
    }


# ---- A whole sequence


_CHI2_90 = 6.251388631170325  # 90 % of a 3D normal distribution lies within this squared distance
_LEAST_STD_M = 1e-6  # a covariance flatter than this is taken as this thick
_PCK_MM = np.linspace(0.0, 50.0, 101)


def evaluate(
    track: TrackResult, truth: Truth, landmarks: str | None = None
) -> dict[str, float | int | None]:
    """Return the errors of a track against ground truth by their names, in mm; None where there is nothing to measure.

    Besides come `finger_swaps` and, of hands, how far their joints are bent (`flexion_errors`, in
    degrees).

    Compared are keypoints21 where the truth has them, else joints of equal name, by frame number.
    Every truth frame counts: a missing or lost one with its last estimate (the first estimate
    before tracking begins). Unknown (NaN) points do not count.

    `offset_free` figures are beside each point's constant offset in its bone's frame, fitted on one
    half of the frames and applied to the other (`offset_free_errors`): None where the track does not
    say how its model is built.

    `wrong_frames`, of hands, have a keypoint more than 25 mm off beside its constant offset
    (`WRONG_M`): of frames of low confidence (doubtful, lost or missing) and of
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
    check_kind(track, TrackResult, "evaluate", "a track, as `read_npz` and `track` return it")
    check_kind(truth, Truth, "evaluate", "a Truth, such as `session.truth`")
    track, names, found, true = _compared(in_truths_landmarks(track, truth, landmarks), truth)
    error = np.linalg.norm(found - true, axis=2)
    known, tracked = np.isfinite(error), track.status != Status.LOST
    tips = np.array([name.endswith("_tip") for name in names])
    every = error[known]
    return {
        "mpjpe_mm": mean_size(every),
        "mpjpe_median_mm": float(np.median(every)),
        "p95_mm": float(np.percentile(every, 95)),
        "max_mm": float(every.max()),
        "mpjpe_tracked_mm": mean_size(error[known & tracked[:, None]]),
        "pa_mpjpe_mm": _aligned_error(found, true),
        "fingertip_mm": mean_size(error[known & tips]),
        "pck_auc_50mm": _pck_auc(every),
        "jitter_mm": _jitter(track, found),
        "lost_frames": int((~tracked).sum()),
        "coverage90": _coverage(track, names, found, true),
        "finger_swaps": _swaps(found[:, tips], true[:, tips]),
        **(flexion_errors(found, true) if names == keypoint_names() else {}),
        **_position_errors(track, names, found, true),
        **(_wrong_frames(track, found, true) if names == keypoint_names() else {}),
        "frames_used": len(track),
        "points_used": int(known.sum()),
        "points_unknown": int((~known).sum()),
        **{
            f"used_{name}": int(count) for name, count in zip(names, known.sum(axis=0), strict=True)
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


def _compared(
    track: TrackResult, truth: Truth
) -> tuple[TrackResult, tuple[str, ...], Floats[F, N, D3], Floats[F, N, D3]]:
    """Return the track at the truth's frames, ascending, a missing one lost with the last estimate; the points' names, where the
    track has them, and where they are [mm]: NaN where unknown.
    """
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
    held = usable[np.maximum(last, 0)]
    columns = {name: getattr(track, name) for name in COLUMNS}
    columns = {name: array[held] for name, array in columns.items() if array is not None}
    columns["status"] = np.where(columns["frame"] == frames, columns["status"], Status.LOST)
    found = 1e3 * found[held]
    true = np.where(np.isfinite(found), 1e3 * true, np.nan)
    return replace(track, **columns | {"frame": frames}), names, found, true


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


def _turns(track: TrackResult, names: Sequence[str]) -> Floats | None:
    """Return bone → world (F, N, 3, 3) of the bones that carry the points; None where the track does not say which these are."""
    try:
        model = model_of(track)
    except HandtrackError:
        return None
    bones = model.joint_bone[indices(model.joint_names, names)]
    return track.T_world_bone[:, bones, :3, :3]


# ---- measures --------------------------------------------------------------------------------------


def _position_errors(
    track: TrackResult, names: Sequence[str], found: Floats, true: Floats
) -> dict[str, float | int | None]:
    """Return errors of each point [mm], and of all and each beside its constant offset in its bone's frame."""
    error, turns = np.linalg.norm(found - true, axis=2), _turns(track, names)
    beside = np.full_like(error, np.nan)
    if turns is not None:
        beside = offset_free_errors(found, true, turns)
    each = [*enumerate(names)]
    return {
        "offset_free_mm": mean_size(beside),
        "offset_free_median_mm": known_median(beside),
        **{f"position_{name}_mm": mean_size(error[:, k]) for k, name in each},
        **{f"position_{name}_offset_free_mm": mean_size(beside[:, k]) for k, name in each},
    }


def _wrong_frames(track: TrackResult, found: Floats, true: Floats) -> dict[str, int]:
    """Return how many frames are wrong, how many are of low confidence, and how many are both."""
    wrong = wrong_frames(1e-3 * found, 1e-3 * true)
    unsure = np.isin(track.status, (Status.DOUBTFUL, Status.LOST))
    return {
        "wrong_frames": int(wrong.sum()),
        "low_confidence_frames": int(unsure.sum()),
        "wrong_low_confidence_frames": int((wrong & unsure).sum()),
    }


def _aligned_error(found: Floats, true: Floats) -> float | None:
    """Return the mean error after a similarity fit per frame; frames with under 3 known points do not count."""
    errors = []
    for ours, theirs in zip(found, true, strict=True):
        known = np.isfinite(theirs).all(axis=1)
        if known.sum() >= 3:
            fitted = similarity(ours[known], theirs[known])
            errors.append(np.linalg.norm(fitted - theirs[known], axis=1))
    return mean_size(np.concatenate(errors)) if errors else None


def _pck_auc(errors: Floats) -> float:
    share = np.array([(errors <= threshold).mean() for threshold in _PCK_MM])
    return float(np.trapezoid(share, _PCK_MM) / _PCK_MM[-1])


def _jitter(track: TrackResult, found: Floats) -> float | None:
    """Return the median norm of second differences over three tracked frames in a row."""
    lost = track.status == Status.LOST
    row = (np.diff(track.frame) == 1) & ~lost[1:] & ~lost[:-1]
    bend = found[2:] - 2 * found[1:-1] + found[:-2]
    return known_median(np.linalg.norm(bend[row[1:] & row[:-1]], axis=2))


def _swaps(found: Floats, true: Floats) -> int | None:
    """Return how many fingertips, over all frames, are nearer to another finger's true tip than to their own."""
    if true.shape[1] < 2:
        return None
    apart = np.linalg.norm(found[:, :, None] - true[:, None, :], axis=3)
    own = np.diagonal(apart, axis1=1, axis2=2)
    other = np.where(np.isfinite(apart), apart, np.inf)
    other[:, np.arange(len(own[0])), np.arange(len(own[0]))] = np.inf
    return int((other.min(axis=2) < own).sum())


def _coverage(
    track: TrackResult, names: Sequence[str], found: Floats, true: Floats
) -> float | None:
    """Return the share of tracked points inside their stated 90 % ellipsoid; None where it is not stated of all these points."""
    asked = np.isfinite(true).all(axis=2) & (track.status != Status.LOST)[:, None]
    if not asked.any() or not set(names) <= set(track.joint_names):
        return None
    error = (found - true)[asked]
    reported = 1e6 * track.joint_covariance[:, indices(track.joint_names, names)][asked]
    sound = np.isfinite(reported).all(axis=(1, 2))  # an estimate that states nothing covers nothing
    values, vectors = np.linalg.eigh(reported[sound])
    along = np.einsum("nij,ni->nj", vectors, error[sound])
    least = (1e3 * _LEAST_STD_M) ** 2
    inside = (along**2 / np.maximum(values, least)).sum(axis=1) <= _CHI2_90
    return float(inside.sum() / len(error))
