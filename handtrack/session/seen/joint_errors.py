"""How far a detector's joints are off in this recording, as its cameras disagree."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from handtrack.model.articulated import keypoint_names
from handtrack.observation.observation import ImageKeypoints
from handtrack.session.seen.views import View
from handtrack.tracking.search.keypoint_start import triangulated

_FRAMES = 32  # looked at, spread over all: 32 x 21 points tell a median to some per cent
_FEWEST = 100  # points; fewer say nothing


@lru_cache(maxsize=8)
def joint_error_px(views: tuple[View, ...]) -> float:
    """Return the standard deviation in each direction [px]; 0 where two cameras do not see enough of a hand's joints.

    Triangulation takes three of a point's 2 V numbers in V cameras; what it leaves of them, squared and in units of the error, is
    χ² with 2 V − 3 freedoms. The median of that is compared, since some points are simply elsewhere.
    """
    last = min((v.keypoint_files.frames.stop for v in views if v.keypoint_files), default=0)
    chosen = np.unique(np.linspace(0, max(last - 1, 0), _FRAMES).round()).astype(int)
    errors: list[float] = []
    for frame in chosen.tolist():
        errors += _squares([joints for view in views for joints in view.keypoints(frame, 1.0)])
    return float(np.sqrt(np.median(errors))) if len(errors) >= _FEWEST else 0.0


def _squares(seen: Sequence[ImageKeypoints]) -> list[float]:
    """Return the variance [px²] that each point of a frame says, as its median goes."""
    squares: list[float] = []
    for name, point in zip(keypoint_names(), triangulated(seen), strict=True):
        known = [s for s in seen if name in s.names]
        off = np.array([s.camera.project(point) - s.pixels[s.names.index(name)] for s in known])
        off = off[np.isfinite(off).all(axis=1)] if len(off) else off
        freedoms = 2 * len(off) - 3
        if freedoms > 0:
            squares.append(float((off**2).sum()) / (freedoms * (1 - 2 / (9 * freedoms)) ** 3))
    return squares
