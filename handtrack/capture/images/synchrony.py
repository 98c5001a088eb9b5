"""Estimate by how much each camera's recording is late against the others', to a tenth of a frame, from what moves.

A point in space lies in one plane through both cameras' centres. However the cameras stand, what moves at an angle of that
plane around the line between them moves at the same angle in the other's picture, at the same time.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from handtrack.arrays import D2, Array, Axes, B, Floats, H, Ints, L, N, Q, T, W, pixel_grid
from handtrack.geometry.camera import Camera

_WIDTH = 192  # of the reduced pictures [px]
_BINS = 48  # planes told apart
_NOISE = 6.0  # grey levels: smaller changes are the sensor's
_LEAST_OVERLAP = 10  # frames that both show
_MOST_OFFSET = 12  # frames
_LEAST_CORRELATION = 0.3
_LEAST_APART_M = 1e-4
_LEAST_GAIN = 0.1  # of the correlation over that of the frames as numbered, a frame away; less by the square where nearer
_TENTHS = 10  # steps a frame
_MOST_SWEEPS = 20
_NEIGHBOURS = 3  # to either side with which a camera is compared: all pairs of up to seven cameras
_INTERVAL_TENTHS = 20  # by which one stretch alone may differ from both together
_LEAST_STD = 0.1  # frames; what pairs of made scenes are off by on average, of 0.15 a pair (tests/capture/test_synchrony.py)
_MOST_STD = 1.0  # frames: stretches that differ by more disagree
_LEAST_OFFSET = 0.25  # frames: smaller ones are not told from none


@dataclass(frozen=True)
class TimeOffset:
    """How a camera's frames lie against those of the camera that most others agree with."""

    frames: float
    """by which it is late, in tenths"""
    std: float
    """frames: by how much the two stretches disagree, and no less than such estimates err"""
    correlation: float
    """correlation with the others of what moves, at that offset"""
    as_numbered: float
    """… and of frames of equal number"""
    at_edge: bool
    """whether the search ended there: it is at least so late, or early"""

    @property
    def agrees(self) -> bool:
        """Whether what moves in the camera agrees with the others' at all."""
        return self.correlation >= _LEAST_CORRELATION

    @property
    def is_sure(self) -> bool:
        """Whether the camera runs apart from the others: both stretches agree, and the pictures agree clearly better."""
        size = abs(self.frames)
        agree = size >= max(_LEAST_OFFSET, 2.0 * self.std) and self.std <= _MOST_STD
        gain = self.correlation - self.as_numbered
        return self.agrees and agree and gain >= _LEAST_GAIN * min(1.0, size * size)


class ImageMotion:
    """What moved from frame to frame in one camera's pictures, reduced."""

    def __init__(self, camera: Camera, pictures: Iterable[Array[H, W, *Axes] | None]) -> None:
        """pictures: of frames after one another, (H, W, 3) or (H, W) uint8, None where missing."""
        small = [None if p is None else _small(p) for p in pictures]
        self.camera = camera
        self.changes = [
            None if a is None or b is None else np.maximum(np.abs(b - a) - _NOISE, 0.0)
            for a, b in pairwise(small)
        ]

    def by_plane(self, angles: Floats[H, W], edges: Floats[Q]) -> Floats[B, T]:
        """Return how much moved in each range of angles; NaN where a frame is missing. angles: reduced."""
        bins = np.digitize(angles, edges).ravel()
        none = np.full(len(edges) + 1, np.nan)
        rows = [
            none if change is None else np.bincount(bins, change.ravel(), len(edges) + 1)
            for change in self.changes
        ]
        return np.array(rows)[:, 1:-1].T


def plane_angles(camera: Camera, other: Camera, pixels: Floats[*Axes, D2]) -> Floats[*Axes]:
    """Return (...) the angle of each pixel's plane through both centres [rad]; NaN where the lens
    shows nothing, or the centres are one.

    Parameters
    ----------
    pixels
        Of the camera's real image. 0 is where the two look on average.
    """
    first, second = sorted((camera, other), key=lambda c: c.name)  # one line, one zero for both
    line = second.centre - first.centre
    length = float(np.linalg.norm(line))
    if length < _LEAST_APART_M:
        return np.full(pixels.shape[:-1], np.nan)
    line = line / length
    axis = first.rotation[2] + second.rotation[2]
    ahead = axis - (axis @ line) * line
    if np.linalg.norm(ahead) < 1e-6:  # they look at each other
        ahead = np.cross(line, first.rotation[0])
    ahead = ahead / np.linalg.norm(ahead)
    rays = camera.rays(pixels)
    return np.arctan2(rays @ np.cross(line, ahead), rays @ ahead)


def _grid(camera: Camera, shape: tuple[int, ...]) -> Floats:
    """Return (H, W, 2) the places in the real image of a reduced picture's pixels."""
    height, width = shape
    scale = camera.size[0] / width
    return (pixel_grid((width, height)) + 0.5) * scale - 0.5


def time_offsets(motions: Sequence[tuple[ImageMotion, ImageMotion]]) -> dict[int, TimeOffset]:
    """Return the offset of each camera, by its place, that can be compared with most others; none
    where nothing tells.

    The offsets o of all cameras together maximise the sum over pairs of how well what moves agrees
    at the lag o_k − o_i, so that one pair may err. Compared are neighbours in the order of the
    cameras, and all pairs of up to seven.

    Parameters
    ----------
    motions
        Of each camera, in two stretches.
    """
    from scipy.sparse.csgraph import connected_components

    count = len(motions)
    near = {
        tuple(sorted((i, (i + step) % count)))
        for i in range(count)
        for step in range(1, min(_NEIGHBOURS, count - 1) + 1)
    }
    fine = {}
    for i, k in sorted(near):
        both = [_correlations(a, b) for a, b in zip(motions[i], motions[k], strict=True)]
        if not np.isnan(both).any():
            fine[i, k] = np.stack([_in_tenths(curve) for curve in both])
    fine |= {(k, i): both[:, ::-1] for (i, k), both in fine.items()}
    if not fine:
        return {}
    compared = np.zeros((count, count), bool)
    compared[tuple(np.transpose(list(fine)))] = True
    group = connected_components(compared, directed=False)[1]
    cameras = np.flatnonzero(group == np.bincount(group).argmax()).tolist()
    fine = {pair: both for pair, both in fine.items() if pair[0] in cameras}
    together = {pair: both.mean(axis=0) for pair, both in fine.items()}
    none = np.zeros(count, int)
    best = _best_offsets(together, none, cameras, 2 * _MOST_OFFSET * _TENTHS)
    reference = max(cameras, key=lambda k: (sum(abs(best[cameras] - best[k]) < 3), -k))
    best -= best[reference]
    each = [
        _best_offsets({p: both[s] for p, both in fine.items()}, best, cameras, _INTERVAL_TENTHS)
        for s in (0, 1)
    ]
    found = dict[int, TimeOffset]()
    for k in cameras:
        score = _scores(together, k, best)
        apart = np.diff([one[k] - one[reference] for one in each])[0] / _TENTHS
        there = np.flatnonzero(score > -1)
        at = int(best[k]) + len(score) // 2
        found[k] = TimeOffset(
            float(best[k] / _TENTHS),
            max(float(abs(apart)) / 2, _LEAST_STD),
            float(score[at]),
            float(score[len(score) // 2]),
            bool(at in (there[0], there[-1])),
        )
    return found


def _in_tenths(curve: Floats[L]) -> Floats[N]:
    """Return a curve of agreement between whole frames too, −1 where too little overlaps."""
    from scipy.interpolate import CubicSpline

    known = np.flatnonzero(curve > -1)
    steps = np.arange((len(curve) - 1) * _TENTHS + 1) / _TENTHS
    fine = np.full(len(steps), -1.0)
    there = (steps >= known[0]) & (steps <= known[-1])
    fine[there] = CubicSpline(known, curve[known])(steps[there]) if len(known) > 1 else curve[known]
    return fine


def _scores(pairs: Mapping[tuple[int, int], Floats[N]], camera: int, offsets: Ints[N]) -> Floats[N]:
    """Return how well a camera agrees with those it is compared with on average, by its offset: −12 to 12 frames in tenths."""
    most = _MOST_OFFSET * _TENTHS
    total = []
    for (i, k), curve in pairs.items():
        if k == camera:
            lag = np.arange(-most, most + 1) - offsets[i]
            total.append(np.where(abs(lag) <= most, curve[np.clip(lag + most, 0, 2 * most)], -1.0))
    return np.mean(total, axis=0)


def _best_offsets(
    pairs: Mapping[tuple[int, int], Floats[N]], start: Ints[N], cameras: Sequence[int], most: int
) -> Ints[N]:
    """Return the offsets [tenths of a frame] at which all pairs agree best, found camera by camera. most: from the start."""
    offsets = start.copy()
    for _ in range(_MOST_SWEEPS):
        before = offsets.copy()
        for k in cameras:
            score = _scores(pairs, k, offsets)
            middle = len(score) // 2
            far = abs(np.arange(-middle, middle + 1) - start[k]) > most
            at = int(np.argmax(np.where(far, -np.inf, score)))
            if score[at] > score[offsets[k] + middle] + 1e-9:
                offsets[k] = at - middle
        if (offsets == before).all():
            break
    return offsets


def _correlations(first: ImageMotion, second: ImageMotion) -> Floats:
    """Return (2 most + 1,) how well what moves agrees at each lag of the second; NaN where too little is seen to tell."""
    unknown = np.full(2 * _MOST_OFFSET + 1, np.nan)
    shapes = [next((c.shape for c in m.changes if c is not None), None) for m in (first, second)]
    if shapes[0] is None or shapes[1] is None:
        return unknown
    a, b = first.camera, second.camera
    angles = (
        plane_angles(a, b, _grid(a, shapes[0])),
        plane_angles(b, a, _grid(b, shapes[1])),
    )
    if not all(np.isfinite(part).any() for part in angles):
        return unknown
    low = max(float(np.nanmin(part)) for part in angles)
    high = min(float(np.nanmax(part)) for part in angles)
    if low >= high:
        return unknown
    edges = np.linspace(low, high, _BINS + 1)
    rows = [
        motion.by_plane(np.nan_to_num(part, nan=high + 1), edges)
        for motion, part in zip((first, second), angles, strict=True)
    ]
    lags = range(-_MOST_OFFSET, _MOST_OFFSET + 1)
    curve = np.array([_correlation(rows[0], rows[1], k) for k in lags])
    return unknown if np.isnan(curve[_MOST_OFFSET]) else np.nan_to_num(curve, nan=-1.0)


def _correlation(first: Floats, second: Floats, late: int) -> float:
    """Return how alike the changes over time are, the second `late` frames later: −1 to 1; NaN where they hardly overlap."""
    count = max(first.shape[1] - abs(late), 0)
    a, b = first[:, max(0, -late) :][:, :count], second[:, max(0, late) :][:, :count]
    both = np.isfinite(a[0]) & np.isfinite(b[0]) if count else np.zeros(0, bool)
    if both.sum() < _LEAST_OVERLAP:
        return float("nan")
    a, b = (part[:, both] - part[:, both].mean(axis=1, keepdims=True) for part in (a, b))
    size = np.sqrt((a**2).sum() * (b**2).sum())
    return float((a * b).sum() / size) if size > 0 else float("nan")


def _small(picture: Array) -> Floats:
    height, width = picture.shape[:2]
    wide = min(_WIDTH, width)
    grey = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    size = (wide, max(1, round(height * wide / width)))
    return cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)
