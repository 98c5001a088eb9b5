"""Calibrated pair → coloured points in the world: rectify, match, check, triangulate; and why a pair does not match."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from handtrack.arrays import D3, Array, Bytes, H, W
from handtrack.capture.clouds.depth import surface_pixels
from handtrack.capture.clouds.disparity import (
    REJECTED,
    StereoSettings,
    at_partners,
    matches,
    moved_right,
)
from handtrack.capture.clouds.point_cloud import EMPTY, PointCloud
from handtrack.capture.clouds.rectification import RectifiedPair, rectified
from handtrack.geometry.camera import Camera

_NEAR_M, _CLOSEST_M = 0.2, 0.1
"""as near as a hand comes to cameras on a desk, and to those that are made for it: a hand fills their images"""
_SHARED_SHIFT = 0.125
"""share of the image's width by which what is near is seen elsewhere by the other camera; close-range pairs, of 18 mm, have 0.11 at 10 cm, pairs
of 50 mm 0.15 at 20 cm. Searching costs in proportion to it"""
_COARSE = 4  # the range is narrowed on images smaller by that
_COARSE_WINDOW_PX = 5
_COARSE_LEAST = 40  # matches there, below which the whole range is searched
_ROOM_M = 0.04  # a hand may reach that much nearer and farther than what the coarse match saw
_SURFACE = 75.0, 0.003, 6  # grazing angle [°], share of jumps and support of `surface_pixels`
_MARGIN_PX = 16  # around the masks, for the windows
_ASTRAY = REJECTED.index("outside the other mask")


class StereoView(NamedTuple):
    """A matched pair, for the screen and for checks."""

    left: Bytes[H, W, D3]
    """uint8 BGR, rectified."""
    right: Bytes[H, W, D3]
    disparity: Array[H, W]
    """float32 [px] of the left pixels, NaN where there is none."""
    asked: int
    """pixels that could have had a disparity: those of the mask, or all."""
    rejected: Bytes[H, W]
    """uint8: why a match does not count, see disparity.REJECTED."""

    @property
    def matched_share(self) -> float:
        """How many of the pixels asked for have a disparity."""
        return float(np.isfinite(self.disparity).sum()) / max(self.asked, 1)


class StereoMatcher:
    """One calibrated pair. What depends on the cameras alone is made once."""

    def __init__(
        self,
        first: Camera,
        second: Camera,
        settings: StereoSettings = StereoSettings(),
        along_level_lines: bool = False,
    ) -> None:
        """Raises HandtrackError for cameras that cannot make a pair.

        along_level_lines: images are rectified by the 2004 paper's interpolation, not bilinearly.
        """
        self.along_level_lines = along_level_lines
        self.pair: RectifiedPair = rectified(first, second)
        self.settings = settings

    @property
    def near_m(self) -> float:
        """Nearest depth searched for: as it was given; else an arm's, or nearer where the cameras stand so close together that both
        still see about the same there.
        """
        if self.settings.near_m is not None:
            return self.settings.near_m
        shift_px = _SHARED_SHIFT * self.pair.real[0].size[0]
        both = float(self.pair.left.matrix[0, 0]) * self.pair.baseline_m / shift_px
        return min(max(both, _CLOSEST_M), _NEAR_M, 0.5 * self.settings.far_m)

    @property
    def range_px(self) -> tuple[int, int]:
        """Disparities of the farthest and the nearest depth."""
        far, near = self.settings.far_m, self.near_m
        low, high = self.pair.disparity_of(far), self.pair.disparity_of(near)
        width = self.pair.left.size[0]
        return max(int(np.floor(low)), 1 - width), min(int(np.ceil(high)), width - 1)

    def match(
        self,
        first: Bytes[H, W, D3],
        second: Bytes[H, W, D3],
        first_mask: Bytes[H, W] | None = None,
        second_mask: Bytes[H, W] | None = None,
    ) -> StereoView:
        """Return the disparities of two images uint8 BGR taken at once.

        Masks: only pixels > 0 are matched, in their own image.
        """
        left, right = (
            self.pair.rectify(image, side, along_level_lines=self.along_level_lines)
            for side, image in enumerate(self.pair.by_side(first, second))
        )
        wanted, partner = (
            _wanted(mask, self.pair, side)
            for side, mask in enumerate(self.pair.by_side(first_mask, second_mask))
        )
        least, most = self.range_px
        found = np.full_like(wanted, np.nan, np.float32)
        rejected = np.zeros_like(found, np.uint8)
        view = StereoView(left, right, found, int(wanted.sum()), rejected)
        box = _box(wanted)
        if box is None or most < least:
            return view
        rows, columns = box
        least, most = self._narrowed(left, right, wanted, rows)
        # the same columns of the right image hold every partner once it is moved by `least`
        window = slice(max(columns.start - (most - least), 0), columns.stop)
        moved = moved_right(right[rows], least)
        kept, thrown = matches(left[rows, window], moved[:, window], 0, most - least, self.settings)
        found[rows, window], rejected[rows, window] = kept + least, thrown
        inside, there = at_partners(partner, found)
        astray = np.isfinite(found) & ~(inside & there)
        rejected[astray] = _ASTRAY
        found[astray | ~wanted] = np.nan
        rejected[~wanted] = 0
        return view

    def triangulate(self, view: StereoView) -> PointCloud:
        """Return the coloured points (N, 3), world [m], of a matched pair."""
        depth_m = self.pair.depth_of(view.disparity)
        surface = surface_pixels(depth_m, float(self.pair.left.matrix[0, 0]), *_SURFACE)
        rows, columns = np.nonzero(surface)
        points = self.pair.points(columns, rows, view.disparity[rows, columns].astype(float))
        depth = (points - self.pair.left.centre) @ self.pair.left.rotation[2]
        keep = (depth >= self.near_m) & (depth <= self.settings.far_m)
        if not keep.any():
            return EMPTY
        return PointCloud(points[keep], view.left[rows, columns, ::-1][keep])

    def _narrowed(self, left: Bytes, right: Bytes, wanted: Array, rows: slice) -> tuple[int, int]:
        """Return the range of disparities that a match of small images leaves, as a hand has
        little depth beside the range searched."""
        least, most = self.range_px
        if most - least < 2 * _COARSE * _COARSE:
            return least, most
        small = [_smaller(image[rows]) for image in (left, right)]
        method, speckle_px = self.settings.method, _COARSE_LEAST // 2
        settings = StereoSettings(method, _COARSE_WINDOW_PX, speckle_px=speckle_px)
        low, high = least // _COARSE, -(-most // _COARSE)
        coarse, _ = matches(small[0], small[1], low, high, settings)
        inside = wanted[rows][_COARSE // 2 :: _COARSE, _COARSE // 2 :: _COARSE]
        coarse = coarse[: inside.shape[0], : inside.shape[1]]
        known = coarse[inside[: coarse.shape[0], : coarse.shape[1]] & np.isfinite(coarse)]
        if len(known) < _COARSE_LEAST:
            return least, most
        depth = self.pair.depth_of(np.quantile(known, [0.01, 0.99]) * _COARSE)
        far, near = np.nanmax(depth) + _ROOM_M, max(np.nanmin(depth) - _ROOM_M, 0.05)
        return (
            max(least, int(np.floor(self.pair.disparity_of(far)))),
            min(most, int(np.ceil(self.pair.disparity_of(near)))),
        )


def _wanted(mask: Array | None, pair: RectifiedPair, side: int) -> Array:
    """Return where a rectified image (H, W) may be matched: in the mask, and in the real image."""
    x, y = np.moveaxis(pair.source[side], -1, 0)
    width, height = pair.real[side].size
    inside = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    return inside if mask is None else inside & (pair.rectify(mask, side, linear=False) > 0)


def _box(wanted: Array) -> tuple[slice, slice] | None:
    """Return rows and columns around what is wanted, with room for the windows."""
    x, y, width, height = cv2.boundingRect(wanted.astype(np.uint8))
    if width == 0:
        return None
    return (
        slice(max(y - _MARGIN_PX, 0), min(y + height + _MARGIN_PX, wanted.shape[0])),
        slice(max(x - _MARGIN_PX, 0), min(x + width + _MARGIN_PX, wanted.shape[1])),
    )


def _smaller(image: Bytes) -> Bytes:
    """Return the image at a quarter of its size."""
    share = 1 / _COARSE
    return cv2.resize(image, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)  # type: ignore


# ---- Check why a stereo pair does not match: exchanged images, a wrong calibration, a wrong range


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
    names = f"cameras '{matcher.pair.real[0].name}' and '{matcher.pair.real[1].name}'"
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
        sides = enumerate(matcher.pair.by_side(a, b))
        pairs = _shared_features(*(matcher.pair.rectify(image, side) for side, image in sides))
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
