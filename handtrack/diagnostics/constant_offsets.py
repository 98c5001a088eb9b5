"""Errors beside a constant offset, which two definitions of the same point have, and which frames are wrong by them."""

from __future__ import annotations

import warnings

import numpy as np

from handtrack.arrays import D3, D21, Array, Axes, F, Floats, J, N

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
