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
from handtrack.capture.images.synchrony import plane_angles
from handtrack.geometry.camera import Camera
from handtrack.session.doctor.check_views import spread
from handtrack.session.doctor.finding import Finding, warning
from handtrack.session.seen.views import View

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
        yield warning(
            f"silhouettes do not fit together by this calibration: those of cameras {'; '.join(off)} (median of the frames looked "
            "at; a hand's outlines touch the same planes through both cameras). Was a camera moved, does its matrix belong to "
            "another image size, are cameras exchanged, or do frames of equal number show different moments?"
        )


def _pixels_apart(pair: tuple[View, View], masks: tuple[list[Bytes | None], ...]) -> float | None:
    """Return how far two cameras' outlines miss common planes [px], the median over frames; None where too few can tell."""
    cameras = (pair[0].camera, pair[1].camera)
    missed = []
    for a, b in zip(*masks, strict=True):
        if a is None or b is None:
            continue
        ends = _ends(a, pair[0], cameras[1]), _ends(b, pair[1], cameras[0])
        apart = np.abs(ends[0] - ends[1]) * min(camera.focal_px for camera in cameras)
        if np.isfinite(apart).any():
            missed.append(float(np.nanmax(apart)))
    return float(np.median(missed)) if len(missed) >= _FEWEST else None


def _ends(mask: Bytes, view: View, other: Camera) -> Floats:
    """Return (2,) the least and the largest angle of a mask's pixels [rad]; NaN where the image or its region cuts them off."""
    x, y, width, height = view.settings.roi or (0, 0, *view.camera.size)
    found, _ = cv2.findContours(
        (mask >= 128).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    outlines = [outline for outline in found if max(cv2.boundingRect(outline)[2:]) > _SPECK_PX]
    if not outlines:
        return np.full(2, np.nan)
    pixels = np.concatenate(outlines)[:, 0].astype(float)
    angles = plane_angles(view.camera, other, pixels)
    if not np.isfinite(angles).any():
        return np.full(2, np.nan)
    touching = pixels[[np.nanargmin(angles), np.nanargmax(angles)]]
    least = np.array([x, y]) + _BORDER_PX
    inside = ((touching >= least) & (touching < least + (width, height) - 2 * _BORDER_PX)).all(
        axis=1
    )
    return np.where(inside, [np.nanmin(angles), np.nanmax(angles)], np.nan)
