"""How far silhouettes of one moment contradict one another: what one camera calls hand must be hand, or open, in the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import D3, Array, C, Floats, H, W
from handtrack.geometry.camera import Camera
from handtrack.observation.observation import Silhouette

_SAMPLES = 100
"""pixels of a mask that are asked about: a share of some hundredths is seen"""
_REACH_M = 0.12
"""a hand reaches so far from its middle, along a line of sight, too"""
_STEP_M = 0.004
"""along it: a quarter of a finger's breadth"""
_DEPTHS_M = np.arange(-_REACH_M, _REACH_M + _STEP_M / 2, _STEP_M)


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
    known = [s.known for s in silhouettes]
    covered = [s.mask > 0.5 for s in silhouettes]
    hands = [np.argwhere(c & k)[:, ::-1].astype(float) for c, k in zip(covered, known, strict=True)]
    empty = [k & ~c for c, k in zip(covered, known, strict=True)]
    lengths = [_outline_px(c) for c in covered]
    count = len(silhouettes)
    off = np.full((count, count), np.nan)
    for i in range(count):
        for j in range(count):
            if i != j and len(hands[i]) and len(hands[j]):
                one, other = silhouettes[i], silhouettes[j]
                share = _contradicted(one.camera, other.camera, hands[i], hands[j], empty[j])
                off[i, j] = share * len(hands[i]) / max(lengths[i], 1.0)
    both = (off + off.T) / 2
    return np.nan_to_num(np.where(np.isnan(both), np.inf, both).min(axis=1), posinf=0.0)


def _contradicted(
    one: Camera, other: Camera, hand: Floats, others: Floats, empty: Array[H, W]
) -> float:
    """Return the share of one hand's pixels (N, 2) whose lines of sight meet nothing but what is `empty` in the other camera.

    others: the other's hand (M, 2).
    """
    middle = _meeting_point(one, np.median(hand, axis=0), other, np.median(others, axis=0))
    ways = one.rays(hand[:: max(len(hand) // _SAMPLES, 1)])
    along = ((middle - one.centre) @ ways.T)[:, None] + _DEPTHS_M
    pixels = other.project(one.centre + along[..., None] * ways[:, None])
    rounded = np.rint(np.nan_to_num(pixels, nan=-1.0)).astype(int)
    width, height = other.size
    inside = ((rounded >= 0) & (rounded < (width, height))).all(axis=-1)
    column = np.clip(rounded[..., 0], 0, width - 1)
    row = np.clip(rounded[..., 1], 0, height - 1)
    return float((inside & empty[row, column]).all(axis=1).mean())


def _outline_px(mask: Array[H, W]) -> float:
    """Return how long the outline is [px]: Crofton, by crossings of rows and columns."""
    down, across = mask[1:] != mask[:-1], mask[:, 1:] != mask[:, :-1]
    return 0.25 * np.pi * float(np.count_nonzero(down) + np.count_nonzero(across))


def _meeting_point(one: Camera, here: Floats, other: Camera, there: Floats) -> Floats[D3]:
    """Return the point nearest to two lines of sight, world [m]."""
    sums, sides = np.zeros((3, 3)), np.zeros(3)
    for camera, pixel in ((one, here), (other, there)):
        way = camera.rays(pixel)
        across = np.eye(3) - np.outer(way, way)
        sums, sides = sums + across, sides + across @ camera.centre
    return np.linalg.lstsq(sums, sides, rcond=None)[0]
