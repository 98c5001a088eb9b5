"""How far silhouettes of one moment contradict one another: what one camera calls hand must be hand, or open, in the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from handtrack.arrays import D2, C, Floats, N
from handtrack.geometry.triangulation import triangulated
from handtrack.observation.observation import Silhouette

_SAMPLES = 100
"""pixels of a mask that are asked about: a share of some hundredths is seen"""
_MOST = 0.5
"""share of them that is contradicted, from which masks do not agree; of marked_real_5cam's masks of a shadow 0.65 to 1, of others up to 0.25"""
_REACH_M = 0.12
"""a hand reaches so far from its middle, along a line of sight, too"""
_STEP_M = 0.004
"""along it: a quarter of a finger's breadth"""


# terms are made anew for each start that is tried, of a frame and of one beside it; masks may be large
@lru_cache(maxsize=2)
def suspected(silhouettes: tuple[Silhouette, ...]) -> list[Silhouette]:
    """Return those of three silhouettes or more that may show something else: without one of them the others agree, with it they do not.
    None where all agree; of several only one is wrong.

    They agree where behind most pixels of each some point may be hand in all of the others.
    """
    hands = [s for s in silhouettes if len(_hand(s)[0])]

    def agree(some: Sequence[Silhouette]) -> bool:
        return all(_contradicted(h, [o for o in some if o is not h]) < _MOST for h in some)

    if len(hands) < 3 or agree(hands):
        return []
    return [one for one in hands if agree([o for o in hands if o is not one])]


def weighed(silhouettes: Sequence[Silhouette]) -> tuple[Silhouette, ...]:
    """Return the silhouettes, with how far their outlines are off where they say what is unknown; the others as they are."""
    asked = [bool((s.mask < 0).any()) for s in silhouettes]
    if len(silhouettes) < 2 or not any(asked):
        return tuple(silhouettes)
    off = outline_errors_px(silhouettes)
    return tuple(
        replace(s, off_px=float(px)) if is_asked else s
        for s, px, is_asked in zip(silhouettes, off, asked, strict=True)
    )


def outline_errors_px(silhouettes: Sequence[Silhouette]) -> Floats[C]:
    """Return how far each outline is off on average, as far as another camera tells [px]; 0 where none does.

    A pixel is contradicted where no point on its line of sight is hand, open or out of sight in another camera. The
    contradicted area over the outline's length is a distance. Who of two is wrong cannot be told, so both get the mean;
    whom any other camera confirms is right.
    """
    counts = [len(_hand(s)[0]) for s in silhouettes]
    lengths = [s.outline_px for s in silhouettes]
    off = np.full((len(counts), len(counts)), np.nan)
    for i, one in enumerate(silhouettes):
        for j, other in enumerate(silhouettes):
            if i != j and counts[i] and counts[j]:
                off[i, j] = _contradicted(one, [other]) * counts[i] / max(lengths[i], 1.0)
    both = (off + off.T) / 2
    return np.nan_to_num(np.where(np.isnan(both), np.inf, both).min(axis=1), posinf=0.0)


@lru_cache(maxsize=32)
def _hand(silhouette: Silhouette) -> tuple[Floats[N, D2], Floats[D2]]:
    """Return the pixels that a silhouette calls hand, and their middle, NaN where there are none."""
    pixels = np.argwhere((silhouette.mask > 0.5) & silhouette.known)[:, ::-1].astype(float)
    return pixels, np.median(pixels, axis=0) if len(pixels) else np.full(2, np.nan)


def _contradicted(one: Silhouette, others: Sequence[Silhouette]) -> float:
    """Return the share of a hand's pixels on whose lines of sight no point may be hand in all of the others."""
    camera, (pixels, middle) = one.camera, _hand(one)
    met = [
        triangulated([camera, other.camera], np.array([[middle], [_hand(other)[1]]]), 0.0)[0]
        for other in others
    ]
    middles = np.array([place for place in met if np.isfinite(place).all()])
    if not len(middles):  # they look along one line
        return 0.0
    rays = camera.rays(pixels[:: max(len(pixels) // _SAMPLES, 1)])
    along = (middles - camera.centre) @ rays.T
    steps = np.arange(-_REACH_M, _REACH_M + np.ptp(along, axis=0).max() + _STEP_M / 2, _STEP_M)
    points = camera.centre + (along.min(axis=0)[:, None] + steps)[..., None] * rays[:, None]
    possible = np.ones(points.shape[:2], bool)
    for other in others:
        covered, known, _ = other.at(points[possible])
        possible[possible] = covered | ~known
    return float((~possible.any(axis=1)).mean())
