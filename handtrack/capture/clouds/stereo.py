"""Calibrated pair → coloured points in the world: rectify, match, check, triangulate."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from handtrack.arrays import D3, Array, Bytes, H, W
from handtrack.capture.clouds.depth import DepthSettings, surface_pixels
from handtrack.capture.clouds.disparity import (
    REJECTED,
    StereoSettings,
    disparity,
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
_SURFACE = DepthSettings(grazing_deg=75.0, jump_share=0.003, support=6)
_MARGIN_PX = 16  # around the masks, for the windows
_ASTRAY = REJECTED.index("outside the other mask")


class StereoView(NamedTuple):
    """A matched pair, for the screen and for checks."""

    left: Bytes[H, W, D3]
    """uint8 BGR, rectified."""
    right: Bytes[H, W, D3]
    disparity: Array[H, W]
    """float32 [px] of the left pixels, NaN where there is none."""
    searched: tuple[int, int]
    """least and most disparity looked for."""
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
        shift_px = _SHARED_SHIFT * self.pair.left_real.size[0]
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
        images = self._rectify((first, second), True)
        masks = self._rectify((first_mask, second_mask), False)
        left, right = images
        assert left is not None
        assert right is not None
        wanted = _wanted(masks[0], self.pair, right=False)
        least, most = self.range_px
        found = np.full_like(wanted, np.nan, np.float32)
        box = _box(wanted)
        asked = int(wanted.sum())
        rejected = np.zeros_like(found, np.uint8)
        if box is None or most < least:
            return StereoView(left, right, found, (least, most), asked, rejected)
        partner = _wanted(masks[1], self.pair, right=True)
        rows, columns = box
        least, most = self._narrowed(left, right, wanted, partner, box)
        # the same columns of the right image hold every partner once it is moved by `least`
        window = slice(max(columns.start - (most - least), 0), columns.stop)
        moved = moved_right(right[rows], least)
        part = matches(left[rows, window], moved[:, window], 0, most - least, self.settings)
        found[rows, window] = part.disparity + least
        rejected[rows, window] = part.rejected
        astray = np.isfinite(found) & ~_leads_into(partner, found)
        rejected[astray] = _ASTRAY
        found[astray | ~wanted] = np.nan
        rejected[~wanted] = 0
        return StereoView(left, right, found, (least, most), asked, rejected)

    def cloud(
        self,
        first: Bytes[H, W, D3],
        second: Bytes[H, W, D3],
        first_mask: Bytes[H, W] | None = None,
        second_mask: Bytes[H, W] | None = None,
    ) -> PointCloud:
        """Return the points that `match` finds, coloured by the left image, world [m]."""
        return self.triangulate(self.match(first, second, first_mask, second_mask))

    def triangulate(self, view: StereoView) -> PointCloud:
        """Return the coloured points (N, 3), world [m], of a matched pair."""
        depth_m = self.pair.depth_of(view.disparity)
        surface = surface_pixels(depth_m, float(self.pair.left.matrix[0, 0]), _SURFACE)
        rows, columns = np.nonzero(surface)
        points = self.pair.points(columns, rows, view.disparity[rows, columns].astype(float))
        depth = (points - self.pair.left.centre) @ self.pair.left.rotation[2]
        keep = (depth >= self.near_m) & (depth <= self.settings.far_m)
        if not keep.any():
            return EMPTY
        return PointCloud(points[keep], view.left[rows, columns, ::-1][keep])

    def _rectify(
        self, pictures: tuple[Bytes | None, Bytes | None], linear: bool
    ) -> tuple[Bytes | None, Bytes | None]:
        """Return what the left and the right virtual camera see of the first and second picture."""
        left, right = pictures[::-1] if self.pair.swapped else pictures
        return (
            None
            if left is None
            else self.pair.rectify(left, False, linear, self.along_level_lines),
            None
            if right is None
            else self.pair.rectify(right, True, linear, self.along_level_lines),
        )

    def _narrowed(
        self, left: Bytes, right: Bytes, wanted: Array, partner: Array, box: tuple[slice, slice]
    ) -> tuple[int, int]:
        """Return the range of disparities that a match of small images leaves, as a hand has
        little depth beside the range searched."""
        least, most = self.range_px
        if most - least < 2 * _COARSE * _COARSE:
            return least, most
        rows = box[0]
        small = [_smaller(image[rows]) for image in (left, right)]
        settings = StereoSettings(
            self.settings.method,
            _COARSE_WINDOW_PX,
            speckle_px=_COARSE_LEAST // 2,
        )
        low, high = least // _COARSE, -(-most // _COARSE)
        coarse = disparity(small[0], small[1], low, high, settings)
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


def _wanted(mask: Array | None, pair: RectifiedPair, right: bool) -> Array:
    """Return where a rectified image (H, W) may be matched: in the mask, and in the real image."""
    x, y = pair.right_maps if right else pair.left_maps
    width, height = (pair.right_real if right else pair.left_real).size
    inside = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    return inside if mask is None else inside & (mask > 0)


def _box(wanted: Array) -> tuple[slice, slice] | None:
    """Return rows and columns around what is wanted, with room for the windows."""
    rows, columns = np.flatnonzero(wanted.any(axis=1)), np.flatnonzero(wanted.any(axis=0))
    if len(rows) == 0:
        return None
    return (
        slice(max(int(rows[0]) - _MARGIN_PX, 0), min(int(rows[-1]) + 1 + _MARGIN_PX, len(wanted))),
        slice(
            max(int(columns[0]) - _MARGIN_PX, 0),
            min(int(columns[-1]) + 1 + _MARGIN_PX, wanted.shape[1]),
        ),
    )


def _smaller(image: Bytes) -> Bytes:
    """Return the image at a quarter of its size."""
    share = 1 / _COARSE
    return cv2.resize(image, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)  # type: ignore


def _leads_into(partner: Array, found: Array) -> Array:
    """Return where left disparities (H, W) lead to right pixels that may be matched."""
    target = np.arange(found.shape[1]) - np.nan_to_num(found).round().astype(int)
    inside = np.isfinite(found) & (target >= 0) & (target < found.shape[1])
    return inside & np.take_along_axis(partner, np.where(inside, target, 0), axis=1)
