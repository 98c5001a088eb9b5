"""The doctor's look at whether the silhouettes of two cameras can be of one thing, by the calibration.

Planes through both cameras' centres that touch a body touch its outline in both pictures: the range of their angles is the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import cv2
import numpy as np

from handtrack.arrays import Bytes, Floats
from handtrack.capture.synchrony import plane_angles
from handtrack.geometry.camera import Camera
from handtrack.session.check_views import spread
from handtrack.session.finding import Finding
from handtrack.session.views import View

if TYPE_CHECKING:
    from handtrack.session.session import Session

_FRAMES = 12
_FEWEST = 3  # comparisons
_BORDER_PX = 3  # an outline that near to the image's border is cut off, not touched
_SPECK_PX = 5
_MOST_OFF, _MOST_OFF_PX = 0.01, 5.0  # of the images' width; good recordings are off by 0.1 to 2 px


def check_outlines(session: Session, frames: Sequence[int] | None = None) -> Iterator[Finding]:
    """Yield a finding about pairs of cameras whose silhouettes do not fit together. frames: unless evenly spread ones."""
    views = [view for view in session.views if view.has_masks]
    frames = spread(session.frame_count, _FRAMES) if frames is None else frames
    masks = {view.name: [view.mask(frame) for frame in frames] for view in views}
    off = []
    for a, b in combinations(views, 2):
        px = _pixels_apart((a, b), (masks[a.name], masks[b.name]))
        if px is not None and px > max(
            _MOST_OFF * min(a.camera.size[0], b.camera.size[0]), _MOST_OFF_PX
        ):
            off.append(f"'{a.name}' and '{b.name}' by {px:.0f} px")
    if off:
        yield Finding(
            "warning",
            f"silhouettes do not fit together by this calibration: those of cameras {'; '.join(off)} (median of the frames looked "
            "at; a hand's outlines touch the same planes through both cameras). Was a camera moved, does its matrix belong to "
            "another image size, are cameras exchanged, or do frames of equal number show different moments?",
        )


def _pixels_apart(pair: tuple[View, View], masks: tuple[list[Bytes | None], ...]) -> float | None:
    """Return how far two cameras' outlines miss common planes [px], the median over frames; None where too few can tell."""
    cameras = (pair[0].camera, pair[1].camera)
    if np.linalg.norm(cameras[0].centre - cameras[1].centre) < 1e-4:
        return None
    angles = [plane_angles(one, other, one.size[::-1]) for one, other in (cameras, cameras[::-1])]
    missed = []
    for a, b in zip(*masks, strict=True):
        if a is None or b is None:
            continue
        ends = [_ends(m, v, ang) for m, v, ang in zip((a, b), pair, angles, strict=True)]
        apart = np.abs(ends[0] - ends[1]) * min(_focal(camera) for camera in cameras)
        if np.isfinite(apart).any():
            missed.append(float(np.nanmax(apart)))
    return float(np.median(missed)) if len(missed) >= _FEWEST else None


def _ends(mask: Bytes, view: View, angles: Floats) -> Floats:
    """Return (2,) the least and the largest angle of a mask's pixels [rad]; NaN where the image or its region cuts them off."""
    x, y, width, height = view.settings.roi or (0, 0, *view.camera.size)
    opened = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((_SPECK_PX, _SPECK_PX), np.uint8))
    rows, columns = np.nonzero((np.asarray(opened) >= 128) & np.isfinite(angles))
    if not len(rows):
        return np.full(2, np.nan)
    seen = angles[rows, columns]
    ends = []
    for at in (int(np.argmin(seen)), int(np.argmax(seen))):
        inside = (
            x + _BORDER_PX <= columns[at] < x + width - _BORDER_PX
            and y + _BORDER_PX <= rows[at] < y + height - _BORDER_PX
        )
        ends.append(seen[at] if inside else np.nan)
    return np.array(ends)


def _focal(camera: Camera) -> float:
    return float(np.sqrt(camera.matrix[0, 0] * camera.matrix[1, 1]))
