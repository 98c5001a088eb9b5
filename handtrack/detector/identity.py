"""Which of the hands seen is ours: by its side, and by lying in all views on one another's epipolar lines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import cv2
import numpy as np

from handtrack.arrays import D2, D3, Floats, K
from handtrack.detector.hand_detector import DetectedHand
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import skew

_AGREE = 0.1  # of the hand's square: pixels by which one hand may miss its epipolar lines, hidden fingers and time included
_MOST_LOG_ODDS = 4.6  # of a side: no view is surer than 99 %


class HandObservation(NamedTuple):
    """A hand in one view of one frame."""

    camera: Camera
    hand: DetectedHand
    log_odds: float
    """that it is of the side asked for"""


def log_odds(right: float, side: str) -> float:
    """Return the log-odds of a side, right or left, from the probability of a right hand; bounded."""
    share = np.clip(right if side == "right" else 1.0 - right, 1e-9, 1.0 - 1e-9)
    return float(np.clip(np.log(share / (1.0 - share)), -_MOST_LOG_ODDS, _MOST_LOG_ODDS))


def our_hands(seen: Mapping[str, list[HandObservation]]) -> dict[str, HandObservation]:
    """Return by view the hand that is ours, as far as there is one.

    Each hand is tried: from every other view joins the one nearest to its epipolar lines, if near enough. The hand with the
    highest log-odds of our side over all views is ours, unless they are against it.
    """
    best: dict[str, HandObservation] = {}
    highest = 0.0
    for name, hands in seen.items():
        for hand in hands:
            joined = {name: hand} | {
                other: near
                for other, theirs in seen.items()
                if other != name and (near := _nearest(hand, theirs)) is not None
            }
            total = sum(one.log_odds for one in joined.values())
            if total > highest:
                best, highest = joined, total
    return best


def _nearest(hand: HandObservation, others: list[HandObservation]) -> HandObservation | None:
    misses = [(epipolar_miss(hand, other), i) for i, other in enumerate(others)]
    miss, nearest = min(misses, default=(np.inf, -1))
    return others[nearest] if miss < _AGREE else None


def epipolar_miss(one: HandObservation, other: HandObservation) -> float:
    """Return by how much of their squares two views' hands miss one another's epipolar lines, in the median of the points."""
    a, b = (seen.camera.undistort_points(seen.hand.points) for seen in (one, other))
    there = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    if not there.any():
        return float("inf")
    fundamental = _fundamental(one.camera, other.camera)
    in_other = _to_lines(b[there], a[there], fundamental) / other.hand.region.side
    in_one = _to_lines(a[there], b[there], fundamental.T) / one.hand.region.side
    return float(np.median((in_one + in_other) / 2))


def _to_lines(
    points: Floats[K, D2], theirs: Floats[K, D2], fundamental: Floats[D3, D3]
) -> Floats[K]:
    """Return distances [px] of points from the lines that points of the other image lie on."""
    lines = cv2.computeCorrespondEpilines(theirs, 1, fundamental)[:, 0]
    return np.abs((points * lines[:, :2]).sum(axis=1) + lines[:, 2])


def _fundamental(a: Camera, b: Camera) -> Floats[D3, D3]:
    """Return F with x_bᵀ F x_a = 0 for pixels of the two undistorted cameras."""
    rotation = b.rotation @ a.rotation.T
    cross = skew(b.translation - rotation @ a.translation)
    return np.linalg.inv(b.matrix).T @ cross @ rotation @ np.linalg.inv(a.matrix)
