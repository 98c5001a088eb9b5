"""How far silhouettes of one moment contradict one another: what one camera calls hand must be hand, or open, in the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import D3, C, Floats
from handtrack.observation.observation import Silhouette

_SAMPLES = 250
"""pixels of a mask that are asked about: a share of a hundredth is seen"""
_REACH_M = 0.12
"""a hand reaches so far from its middle, along a line of sight, too"""
_STEP_M = 0.004
"""along it: a quarter of a finger's breadth"""


def weighed(silhouettes: Sequence[Silhouette]) -> tuple[Silhouette, ...]:
    """Return the silhouettes, with how far their outlines are off where they say what is unknown; the others as they are."""
    asked = [bool((s.mask < 0).any()) for s in silhouettes]
    if len(silhouettes) < 2 or not any(asked):
        return tuple(silhouettes)
    off = outlines_off(silhouettes)
    return tuple(
        replace(s, off_px=float(px)) if told else s
        for s, px, told in zip(silhouettes, off, asked, strict=True)
    )


def outlines_off(silhouettes: Sequence[Silhouette]) -> Floats[C]:
    """Return how far each outline is off on average, as far as another camera tells [px]; 0 where none does.

    A pixel is contradicted where no point on its line of sight is hand, open or out of sight in another camera. The
    contradicted area over the outline's length is a distance. Who of two is wrong cannot be told, so both get the mean;
    whom any other camera confirms is right.
    """
    hands = [np.argwhere((s.mask > 0.5) & s.known)[:, ::-1].astype(float) for s in silhouettes]
    count = len(silhouettes)
    off = np.full((count, count), np.nan)
    for i in range(count):
        for j in range(count):
            if i != j and len(hands[i]) and len(hands[j]):
                off[i, j] = _contradicted(silhouettes[i], silhouettes[j], hands[i], hands[j])
    both = (off + off.T) / 2
    return np.nan_to_num(np.where(np.isnan(both), np.inf, both).min(axis=1), posinf=0.0)


def _contradicted(one: Silhouette, other: Silhouette, hand: Floats, others: Floats) -> float:
    """Return the area of one hand's pixels (N, 2) that the other camera contradicts, by its outline's length [px]."""
    middle = _meeting_point(one, np.median(hand, axis=0), other, np.median(others, axis=0))
    chosen = hand[:: max(len(hand) // _SAMPLES, 1)]
    ways = one.camera.rays(chosen)
    at = (middle - one.camera.centre) @ ways.T
    along = at[:, None] + np.arange(-_REACH_M, _REACH_M + _STEP_M / 2, _STEP_M)
    points = one.camera.centre + along[..., None] * ways[:, None]
    pixels = other.camera.project(points)
    rounded = np.rint(np.nan_to_num(pixels, nan=-1.0)).astype(int)
    width, height = other.camera.size
    inside = ((rounded >= 0) & (rounded < (width, height))).all(axis=-1)
    column = np.clip(rounded[..., 0], 0, width - 1)
    row = np.clip(rounded[..., 1], 0, height - 1)
    empty = (inside & (other.mask <= 0.5)[row, column] & other.known[row, column]).all(axis=1)
    return float(empty.mean()) * len(hand) / max(_outline_px(one), 1.0)


def _outline_px(silhouette: Silhouette) -> float:
    """Return how long the outline is [px]: Crofton, by crossings of rows and columns."""
    mask = silhouette.mask > 0.5
    down = mask[1:] != mask[:-1]
    across = mask[:, 1:] != mask[:, :-1]
    return 0.25 * np.pi * float(down.sum() + across.sum())


def _meeting_point(one: Silhouette, here: Floats, other: Silhouette, there: Floats) -> Floats[D3]:
    """Return the point nearest to two lines of sight, world [m]."""
    sums, sides = np.zeros((3, 3)), np.zeros(3)
    for silhouette, pixel in ((one, here), (other, there)):
        way = silhouette.camera.rays(pixel)
        across = np.eye(3) - np.outer(way, way)
        sums, sides = sums + across, sides + across @ silhouette.camera.centre
    return np.linalg.lstsq(sums, sides, rcond=None)[0]
