"""Check why a stereo pair does not match: exchanged images, a wrong calibration, a wrong range."""

from __future__ import annotations

import cv2
import numpy as np

from handtrack.arrays import D3, Array, Bytes, H, W
from handtrack.capture.clouds.stereo import StereoMatcher, StereoView

_FEATURES = 1500
_RATIO = 0.75  # Lowe's test: the second best match must be that much worse
_LEAST_FEATURES = 12
_ROW_PX = 2.0
_SHARE = 0.5
_EXCHANGED = 2.0
_LEAST_MATCHED = 0.02


def check_pair(
    matcher: StereoMatcher, view: StereoView, first: Bytes[H, W, D3], second: Bytes[H, W, D3]
) -> str | None:
    """Return what is wrong with a matched pair of images uint8 BGR, in one plain
    sentence or two; None when nothing is.

    Looks at distinct features (SIFT) that the rectified images share: they must lie in the same
    rows, and within the range of depths searched.
    """
    names = f"cameras '{matcher.pair.left_real.name}' and '{matcher.pair.right_real.name}'"
    pairs = _shared_features(view.left, view.right)
    share = view.matched_share
    if len(pairs) < _LEAST_FEATURES:
        if share >= _LEAST_MATCHED:
            return None
        return (
            f"{names}: only {share:.1%} of the pixels have a match, and the images share "
            f"{len(pairs)} distinct features. Do they show the same thing at the same time, with "
            "enough texture and light?"
        )
    rows_apart = np.abs(pairs[:, 1] - pairs[:, 3])
    parallax = pairs[:, 0] - pairs[:, 2]
    if _behind(matcher, first, second):
        return (
            f"{names}: seen through this calibration, most shared features lie behind the cameras "
            "(negative disparity), and with the images exchanged they do not. Are the two cameras' "
            "images, or their calibrations, exchanged?"
        )
    if (rows_apart <= _ROW_PX).mean() < _SHARE:
        return (
            f"{names}: shared features lie {np.median(rows_apart):.1f} px apart in height after "
            f"rectification (median of {len(pairs)}); expected below {_ROW_PX:g}. The calibration "
            "does not fit these images: was a camera moved, or were they not taken at one time?"
        )
    least, most = matcher.range_px
    level = parallax[rows_apart <= _ROW_PX]
    if ((level < least - 1) | (level > most + 1)).mean() > _SHARE:
        depth = matcher.pair.depth_of(np.median(level))
        where = f"{float(depth):.2f} m" if np.isfinite(depth) else "no finite depth"
        return (
            f"{names}: shared features lie at {where}, but depths from {matcher.near_m:g} "
            f"to {matcher.settings.far_m:g} m are searched. Set near_m and far_m in [clouds], or "
            "look at the unit of the calibration."
        )
    return None


def _behind(matcher: StereoMatcher, first: Bytes, second: Bytes) -> bool:
    """Return whether features lie behind the cameras, and do not with the images exchanged."""

    def share_before(a: Bytes, b: Bytes) -> float:
        left, right = (b, a) if matcher.pair.swapped else (a, b)
        pairs = _shared_features(
            matcher.pair.rectify(left, False), matcher.pair.rectify(right, True)
        )
        if len(pairs) < _LEAST_FEATURES:
            return 0.0
        level = np.abs(pairs[:, 1] - pairs[:, 3]) <= 4 * _ROW_PX
        before = pairs[:, 0] - pairs[:, 2] > matcher.pair.zero_disparity
        return float((level & before).mean())

    if first.shape != second.shape:
        return False
    given = share_before(first, second)
    return given < _SHARE and share_before(second, first) > max(_SHARE, _EXCHANGED * given)


def _shared_features(left: Bytes, right: Bytes) -> Array:
    """Return (N, 4) x, y in the left and x, y in the right image [px] of features in both."""
    detector = cv2.SIFT_create(_FEATURES)  # type: ignore[attr-defined]
    found = [
        detector.detectAndCompute(cv2.cvtColor(i, cv2.COLOR_BGR2GRAY), None) for i in (left, right)
    ]
    (points_left, words_left), (points_right, words_right) = found
    if words_left is None or words_right is None or len(words_right) < 2:
        return np.zeros((0, 4))
    matches = cv2.BFMatcher(cv2.NORM_L2).knnMatch(words_left, words_right, k=2)
    clear = [m[0] for m in matches if len(m) == 2 and m[0].distance < _RATIO * m[1].distance]
    rows = [(*points_left[m.queryIdx].pt, *points_right[m.trainIdx].pt) for m in clear]
    return np.array(rows).reshape(-1, 4)
