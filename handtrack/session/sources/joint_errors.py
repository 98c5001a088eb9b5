"""How far a detector's joints are off in this recording, as its cameras disagree."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from handtrack.arrays import D2, Floats, evenly_spread
from handtrack.model.articulated import keypoint_names
from handtrack.observation.observation import ImageKeypoints
from handtrack.session.sources.views import View
from handtrack.tracking.frame.constants import BODY_BY_HAND
from handtrack.tracking.search.keypoint_start import triangulated

_FRAMES = 32  # looked at, spread over all: 32 x 21 points tell a median to some per cent
_FEWEST = 100  # points; fewer say nothing
_DEFINITION_M = 0.002
"""how far a point of the hand that a detector, or a person, means moves in the bone's frame as the hand moves: bone lengths that persons mark
vary by 3 to 8 % of 30 to 90 mm at palm, thumb and index of 76 frames of one recording; of a body the same share of its size"""


@lru_cache(maxsize=8)
def joint_sigma_px(views: tuple[View, ...]) -> float | None:
    """Return the standard deviation of detected joints in each direction [px]; None where two cameras do not see enough.

    Triangulation takes three of a point's 2 V numbers in V cameras; what it leaves of them, squared and in units of the error, is
    χ² with 2 V − 3 freedoms. The median of that is compared, since some points are simply elsewhere. Each camera's median
    residual is taken out first: it is an error of the calibration, not of the detector. What cameras agree on is no better than a point
    of a hand is defined.
    """
    last = min((v.keypoint_files.frames.stop for v in views if v.keypoint_files), default=0)
    found = [
        point
        for frame in evenly_spread(last, _FRAMES)
        for point in _residuals([j for view in views for j in view.keypoints(frame, 1.0)])
    ]
    if len(found) < _FEWEST:
        return None
    constant = {
        name: np.median([off[name] for off, _ in found if name in off], axis=0)
        for name in {name for off, _ in found for name in off}
    }
    squares, pixels_per_m = np.median(
        [(_variance([off[name] - constant[name] for name in off]), scale) for off, scale in found],
        axis=0,
    )
    hands = set(keypoint_names())
    of_hand = all(hands >= set(v.keypoint_files.layout.points) for v in views if v.keypoint_files)
    least_m = _DEFINITION_M * (1.0 if of_hand else BODY_BY_HAND)
    return float(np.sqrt(squares + (least_m * pixels_per_m) ** 2))


def _residuals(seen: Sequence[ImageKeypoints]) -> list[tuple[dict[str, Floats[D2]], float]]:
    """Return each point's residuals after triangulation [px], by camera, and how many pixels a metre is there; of points that two
    cameras see.
    """
    found: list[tuple[dict[str, Floats[D2]], float]] = []
    names = tuple(dict.fromkeys(name for one in seen for name in one.names))
    for name, point in zip(names, triangulated(seen, names), strict=True):
        off: dict[str, Floats[D2]] = {}
        scale = []
        for one in seen:
            row = one.names.index(name) if name in one.names else -1
            missed = one.camera.project(point) - one.pixels[row] if row >= 0 else np.array([np.nan])
            if np.isfinite(missed).all():
                off[one.camera.name] = missed
                scale.append(float(one.camera.pixels_per_m(one.camera.to_camera(point)[2])))
        if len(off) > 1:
            found.append((off, float(np.median(scale))))
    return found


def _variance(off: Sequence[Floats[D2]]) -> float:
    """Return the variance [px²] in each direction of which a point's residuals are the median."""
    freedoms = 2 * len(off) - 3
    return float(np.square(off).sum()) / (freedoms * (1 - 2 / (9 * freedoms)) ** 3)
