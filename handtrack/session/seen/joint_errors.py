"""How far a detector's joints are off in this recording, by their confidence, as its cameras disagree."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from handtrack.arrays import Floats, K, N
from handtrack.observation.observation import ImageKeypoints
from handtrack.session.seen.seen_keypoints import JointErrors
from handtrack.session.seen.views import View
from handtrack.tracking.search.keypoint_start import triangulated

_FRAMES = 32  # looked at, spread over all: 32 x 21 points tell a median to some per cent
_FEWEST = 100  # points; fewer say nothing
_POWERS = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0)
_DECISIVE = 8.0  # log-likelihood for errors that grow: points of one hand err together, so that a fifth of it is their own
_TAIL = 3.0  # freedoms of Student's distribution: some points are simply elsewhere


@lru_cache(maxsize=8)
def joint_errors(views: tuple[View, ...]) -> JointErrors:
    """Return the errors; unknown where two cameras do not see enough joints.

    Triangulation takes three of a point's 2 V numbers in V cameras; what it leaves of them, squared and in units of the error, is
    χ² with 2 V − 3 freedoms. The median of that is compared, since some points are simply elsewhere. The power with which
    errors grow as confidence falls is the likeliest, where it is decisively likelier than none.
    """
    last = min((v.keypoint_files.frames.stop for v in views if v.keypoint_files), default=0)
    chosen = np.unique(np.linspace(0, max(last - 1, 0), _FRAMES).round()).astype(int)
    squares: list[float] = []
    confidences: list[Floats[K]] = []
    for frame in chosen.tolist():
        for square, sure in _squares([j for view in views for j in view.keypoints(frame, 1.0)]):
            squares.append(square)
            confidences.append(sure)
    if len(squares) < _FEWEST:
        return JointErrors()
    usual = float(np.median(np.concatenate(confidences)))
    found = np.array(squares)
    without, variance = _likelihood(found, np.ones(len(found)))
    best, graded = without + _DECISIVE, JointErrors(float(np.sqrt(variance)), None, usual)
    for power in _POWERS:
        relative = np.array(
            [float(np.mean((sure / usual) ** (-2 * power))) for sure in confidences]
        )
        likelihood, variance = _likelihood(found, relative)
        if likelihood > best:
            best, graded = likelihood, JointErrors(float(np.sqrt(variance)), power, usual)
    return graded


def _likelihood(squares: Floats[N], relative: Floats[N]) -> tuple[float, float]:
    """Return the log-likelihood of squared errors whose variances relate so, up to a constant, and the variance [px²]."""
    variance = float(np.median(squares / relative)) + 1e-12
    off = np.log1p(squares / (_TAIL * variance * relative))
    return float(-0.5 * (np.log(variance * relative) + (_TAIL + 1) * off).sum()), variance


def _squares(seen: Sequence[ImageKeypoints]) -> list[tuple[float, Floats[K]]]:
    """Return the variance [px²] that each point of a frame says, as its median goes, and its confidence in each camera."""
    squares: list[tuple[float, Floats[K]]] = []
    names = tuple(dict.fromkeys(name for one in seen for name in one.names))
    for name, point in zip(names, triangulated(seen, names), strict=True):
        off, sure = [], []
        for one in seen:
            row = one.names.index(name) if name in one.names else -1
            missed = one.camera.project(point) - one.pixels[row] if row >= 0 else np.array([np.nan])
            if np.isfinite(missed).all():
                off.append(missed)
                sure.append(1.0 if one.confidence is None else float(one.confidence[row]))
        freedoms = 2 * len(off) - 3
        if freedoms > 0:
            scaled = freedoms * (1 - 2 / (9 * freedoms)) ** 3
            squares.append((float(np.square(off).sum()) / scaled, np.array(sure)))
    return squares
