"""Calibrated pair → coloured points in the world: rectify, match, check, triangulate; and why a pair does not match."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, TypeVar

import cv2
import numpy as np

from handtrack.arrays import (
    D2,
    D3,
    Array,
    Axes,
    Bytes,
    Floats,
    H,
    K,
    L,
    N,
    W,
    array_dataclass,
    pixel_grid,
)
from handtrack.capture.clouds.point_cloud import EMPTY, PointCloud, surface_pixels
from handtrack.capture.images.raw_frames import level_line_at
from handtrack.errors import HandtrackError, unknown_name
from handtrack.geometry.camera import Camera, camera_matrix
from handtrack.geometry.lens import remap_source
from handtrack.setting import setting

# ---- Rectified pairs: two virtual cameras whose rows lie along the line between the real ones


_T = TypeVar("_T")
_BORDER_STEPS = 25  # points along each side of an image when its rectified place is looked for
_MOST_SCALE = 1.5  # of a rectified image over the real one
_LEAST_BASELINE_M = 1e-4
_LEAST_CROSSING_COS = 0.34  # 70 degrees: beyond that, two views have hardly a surface in common


@array_dataclass
class RectifiedPair:
    """Two virtual cameras without distortion, with the same rotation and rows; `left` is to the
    left of `right` in their own images."""

    left: Camera
    right: Camera
    real: tuple[Camera, Camera]
    """of the left and of the right one"""
    swapped: bool
    """whether the first of the two given cameras is `right`."""
    source: tuple[Floats[H, W, D2], Floats[H, W, D2]]
    """float32: the place in the real images of each rectified pixel."""

    @property
    def baseline_m(self) -> float:
        """Distance between the cameras."""
        return float(np.linalg.norm(self.right.centre - self.left.centre))

    @property
    def zero_disparity(self) -> float:
        """The disparity of what is infinitely far [px]."""
        return float(self.left.matrix[0, 2] - self.right.matrix[0, 2])

    def disparity_of(self, depth_m: float) -> float:
        """Return the disparity [px] at a depth z of the rectified cameras."""
        focal = float(self.left.matrix[0, 0])
        return focal * self.baseline_m / depth_m + self.zero_disparity

    def depth_of(self, disparity: Array[*Axes]) -> Array[*Axes]:
        """Return the depth z [m] of disparities [px]; NaN where they are beyond infinity."""
        parallax = disparity - self.zero_disparity
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = self.left.matrix[0, 0] * self.baseline_m / parallax
        return np.where(parallax > 0, depth, np.nan)

    def points(self, columns: Array[N], rows: Array[N], disparity: Array[N]) -> Floats[N, D3]:
        """Return world points [m] of left rectified pixels with their disparity [px]."""
        depth = self.depth_of(disparity)
        matrix = self.left.matrix
        flat = (np.column_stack([columns, rows]) - matrix[:2, 2]) / np.diag(matrix)[:2]
        across = np.column_stack([flat, np.ones(len(depth))])
        return (across * depth[:, None]) @ self.left.rotation + self.left.centre

    def by_side(self, first: _T, second: _T) -> tuple[_T, _T]:
        """Return what the two given cameras have, the left one's before the right one's."""
        return (second, first) if self.swapped else (first, second)

    def rectify(
        self,
        image: Array[H, W, *Axes],
        side: int,
        linear: bool = True,
        along_level_lines: bool = False,
    ) -> Array[K, L, *Axes]:
        """Return an image (H, W) or (H, W, 3) of a real camera as the virtual one sees it.

        Parameters
        ----------
        side
            0 left, 1 right.
        linear
            Interpolate, and repeat the border outside, which makes no edges; false for masks, 0
            outside.
        along_level_lines
            Interpolate by the 2004 paper's rule (§2.2) instead of bilinearly.
        """
        source = self.source[side]
        if linear and along_level_lines:
            return np.round(level_line_at(image, *np.moveaxis(source, -1, 0))).astype(image.dtype)
        how = cv2.INTER_LINEAR if linear else cv2.INTER_NEAREST
        border = cv2.BORDER_REPLICATE if linear else cv2.BORDER_CONSTANT
        return np.asarray(cv2.remap(image, source, None, how, borderMode=border))  # type: ignore[call-overload]


def rectified(first: Camera, second: Camera) -> RectifiedPair:
    """Return the rectified pair of two calibrated cameras, in any arrangement side by side, above
    one another, rolled or turned towards each other.

    Raises HandtrackError for cameras in one place, or looking across each other by more than 70
    degrees.
    """
    line: Floats = second.centre - first.centre
    baseline = float(np.linalg.norm(line))
    who = f"cameras '{first.name}' and '{second.name}'"
    if baseline < _LEAST_BASELINE_M:
        raise HandtrackError(
            f"{who}: their centres are {baseline * 1e3:.3g} mm apart, so there is no stereo in "
            "them. Check the translations in the calibration, and world_unit_m."
        )
    axes = first.rotation[2], second.rotation[2]
    if axes[0] @ axes[1] < _LEAST_CROSSING_COS:
        angle = np.degrees(np.arccos(np.clip(axes[0] @ axes[1], -1, 1)))
        raise HandtrackError(
            f"{who} look in directions {angle:.0f} degrees apart; matching needs less than 70. "
            "Choose neighbouring cameras as the pair, or use their silhouettes."
        )
    x = line / baseline
    axis = axes[0] + axes[1]
    ahead = axis - (axis @ x) * x
    if np.linalg.norm(ahead) < 0.2 * np.linalg.norm(axis):
        raise HandtrackError(
            f"{who} look along the line between them; matching needs them beside each other."
        )
    z = ahead / np.linalg.norm(ahead)
    # of the two ways to lie, the one that is less turned from the real images
    swapped = bool(x @ (first.rotation[0] + second.rotation[0]) < 0)
    if swapped:
        x = -x
    rotation: Floats = np.asarray([x, np.cross(z, x), z], dtype=float)
    left, right = (second, first) if swapped else (first, second)
    focal = float(np.mean([np.diag(c.matrix)[:2] for c in (first, second)]))
    lows, highs = np.stack([_span(camera, rotation, focal) for camera in (left, right)], axis=1)
    rows = _limited(lows[:, 1].max(), highs[:, 1].min(), max(left.size[1], right.size[1]))
    widths = left.size[0], right.size[0]
    columns = [_limited(*span) for span in zip(lows[:, 0], highs[:, 0], widths)]
    width = int(max(high - low for low, high in columns)) + 1
    height = int(rows[1] - rows[0]) + 1
    if height < 8:
        raise HandtrackError(
            f"{who}: their images have no rows in common. Do they see the same thing?"
        )
    virtual = []
    for camera, (low, high) in zip((left, right), columns):
        middle = (low + high) / 2 - (width - 1) / 2
        matrix = camera_matrix(focal, focal, -middle, -rows[0])
        virtual.append(
            Camera(
                f"{camera.name} rectified",
                (width, height),
                matrix,
                np.zeros(5),
                rotation,
                np.asarray(-rotation @ camera.centre, dtype=float),
            )
        )
    source = _source(left, virtual[0]), _source(right, virtual[1])
    return RectifiedPair(virtual[0], virtual[1], (left, right), swapped, source)


def _span(camera: Camera, rotation: Floats, focal: float) -> Floats[D2, D2]:
    """Return where the image lies on the rectified plane: least column and row [px] from the foot of
    the camera, then the most."""
    width, height = camera.size
    across = np.linspace(0, width - 1, _BORDER_STEPS)
    down = np.linspace(0, height - 1, _BORDER_STEPS)
    border = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    rays = camera.rays(border) @ rotation.T
    rays = rays[np.isfinite(rays).all(axis=1) & (rays[:, 2] > 0.1)]
    flat = focal * rays[:, :2] / rays[:, 2:]
    return np.stack([flat.min(axis=0), flat.max(axis=0)])


def _limited(low: float, high: float, real: int) -> tuple[float, float]:
    """Return the span, cut around its middle where it is much larger than the real image."""
    most, middle = _MOST_SCALE * real, (low + high) / 2
    low, high = np.floor(low), np.ceil(high)
    if high - low <= most:
        return float(low), float(high)
    return float(np.floor(middle - most / 2)), float(np.ceil(middle + most / 2))


def _source(real: Camera, flat: Camera) -> Floats[H, W, D2]:
    rays = flat.rays(pixel_grid(flat.size))
    return remap_source(real.project(real.centre + rays))


# ---- Disparity of rectified pairs by two methods, with the checks that both pass through


def correlate(
    left: Bytes[H, W],
    right: Bytes[H, W],
    least: int,
    most: int,
    window_px: int,
) -> tuple[Array[H, W], Array[H, W]]:
    """Return the disparities of two rectified grey images uint8, left x is right x − d: of the left
    pixels, between whole pixels, and of the right ones, whole; float32, NaN where none.

    Memory does not grow with the range.

    Parameters
    ----------
    least, most
        Range of d searched [px], both included.
    """
    size = (window_px, window_px)
    (a, mean_a, scale_a), (b, mean_b, scale_b) = (_statistics(i, size) for i in (left, right))
    found, found_right, before, after, last = (np.full_like(a, np.nan) for _ in range(5))
    best, best_right = (np.full_like(a, _LEAST_SCORE) for _ in range(2))
    width = a.shape[1]
    for d in range(least, most + 1):
        # only columns x with 0 <= x - d < width have a partner
        mine, theirs = slice(max(d, 0), width + min(d, 0)), slice(max(-d, 0), width - max(d, 0))
        score = np.full_like(a, np.nan)
        if mine.start < mine.stop:
            product = cv2.boxFilter(a[:, mine] * b[:, theirs], -1, size)
            product -= mean_a[:, mine] * mean_b[:, theirs]
            product *= scale_a[:, mine] * scale_b[:, theirs]
            score[:, mine] = product
            better = product > best_right[:, theirs]
            best_right[:, theirs][better] = product[better]
            found_right[:, theirs][better] = d
        followed = found == d - 1
        after[followed] = score[followed]
        better = score > best
        best[better] = score[better]
        before[better] = last[better]
        after[better] = np.nan
        found[better] = d
        last = score
    return found + _peak(before, best, after), found_right


def _peak(before: Array, best: Array, after: Array) -> Array:
    """Return where between −½ and ½ the parabola through three scores has its top; 0 at the ends
    of the range."""
    bend = before - 2 * best + after
    with np.errstate(invalid="ignore", divide="ignore"):
        top = (before - after) / (2 * bend)
    return np.where((bend < 0) & (np.abs(top) <= 0.5), top, 0.0).astype(np.float32)


def _statistics(image: Bytes, size: tuple[int, int]) -> tuple[Array, Array, Array]:
    """Return the image as float32 around 0, each window's mean, and 1 / standard deviation; NaN where there is no contrast."""
    values, mean, variance = _moments(image, size)
    with np.errstate(invalid="ignore", divide="ignore"):
        scale = np.where(variance > _LEAST_CONTRAST**2, 1 / np.sqrt(variance), np.nan)
    return values, mean, scale.astype(np.float32)


def _moments(image: Bytes, size: tuple[int, int]) -> tuple[Array, Array, Array]:
    """Return the image as float32 around 0, so that its squares lose no digits, and each window's mean and variance."""
    values = image.astype(np.float32) - np.float32(image.mean())
    mean = cv2.boxFilter(values, -1, size)
    return values, mean, cv2.boxFilter(values * values, -1, size) - mean * mean


_WINDOW_PX = {"sgbm": 5, "correlation": 11}  # the paper's windows need more to go by
_STEP = 16  # SGBM's disparities come in multiples of that, and in 16ths of a pixel
_UNIT = 16
_CONTRAST_PX = 9
_LEAST_SCORE = 0.6  # correlation below which nothing matches
_LEAST_CONTRAST = (
    1.0  # [grey levels] standard deviation in a window below which there is nothing to match
)

REJECTED = ("", "left and right disagree", "no contrast", "speckle", "outside the other mask")
"""why a match does not count, by its number; 0 where nothing was rejected"""


@dataclass(frozen=True)
class StereoSettings:
    """How a pair of images is matched."""

    method: Literal["sgbm", "correlation"] = setting(
        "sgbm",
        "How pairs are matched: OpenCV's semi-global matching, or windows alone, as in the 2004 paper.",
        label="Method",
        words={"sgbm": "semi-global", "correlation": "correlation (2004)"},
    )
    window_px: int | None = setting(
        None,
        "Side of the compared windows, odd; larger is denser and smoother. Unless set, 5 for sgbm and 11 for "
        "correlation.",
        label="Window px",
        unit="px",
        low=1,
        slider=(3, 31, 2),
    )
    left_right_px: float = setting(
        1.0,
        "How far the matches from left to right and back may differ.",
        label="Left-right px",
        unit="px",
        above=0.0,
        slider=(0.25, 6, 0.25),
    )
    contrast: float = setting(
        1.0,
        "Standard deviation around a pixel below which nothing is matched: matches there are spurious.",
        label="Contrast",
        unit="grey levels",
        above=0.0,
        slider=(0.1, 12, 0.1),
    )
    speckle_px: int = setting(
        80,
        "Smaller patches whose depth differs from their surroundings are rejected.",
        label="Speckle px",
        unit="px",
        low=1,
        slider=(1, 600, 1),
    )
    near_m: float | None = None
    """nearest depth searched for; unless given, see `stereo.StereoMatcher.near_m`."""
    far_m: float = 1.5
    """farthest depth searched for."""

    @property
    def window(self) -> int:
        """Side of the squares that are compared [px]."""
        return self.window_px or _WINDOW_PX[self.method]

    def __post_init__(self) -> None:
        if self.method not in _WINDOW_PX:
            raise unknown_name("stereo method", self.method, tuple(_WINDOW_PX))
        if self.near_m is not None and not 0 < self.near_m < self.far_m:
            raise HandtrackError(
                f"stereo searches from near_m = {self.near_m:g} to far_m = {self.far_m:g} m; "
                "expected 0 < near_m < far_m."
            )


def matches(
    left: Bytes[H, W, *Axes],
    right: Bytes[H, W, *Axes],
    least: int,
    most: int,
    settings: StereoSettings,
) -> tuple[Array[H, W], Bytes[H, W]]:
    """Return the disparity float32 [px] of the left pixels, NaN where there is no match that both
    directions agree on, and why other matches were thrown away, by number in REJECTED.

    Parameters
    ----------
    left, right
        Rectified BGR (H, W, 3) or grey uint8 of one size; left (x, y) is right (x − d, y).
    least, most
        Range of d searched, both included; may be negative.
    """
    if left.ndim == 3 and all((one == one[..., :1]).all() for one in (left, right)):
        left, right = left[..., 0], right[..., 0]  # the same is found, in two thirds of the time
    if settings.method == "correlation":
        found, back = correlate(_grey(left), _grey(right), least, most, settings.window)
    else:
        found = _sgbm(left, right, least, most, settings.window)
        back = _sgbm(_mirrored(right), _mirrored(left), least, most, settings.window)
        back = back[:, ::-1]
    matched = np.isfinite(found)
    rejected = np.zeros(found.shape, np.uint8)
    variance = _moments(_grey(left), (_CONTRAST_PX, _CONTRAST_PX))[2]
    rejected[variance < settings.contrast**2] = 2
    rejected[~consistent(found, back, settings.left_right_px)] = 1
    found = np.where(rejected == 0, found, np.float32(np.nan))
    kept = without_speckles(found, settings.speckle_px)
    rejected[np.isfinite(found) & ~np.isfinite(kept)] = 3
    rejected[~matched] = 0
    return kept, rejected


def consistent(left: Array[H, W], right: Array[H, W], tolerance_px: float) -> Array[H, W]:
    """Return where left disparities are also those of the right pixels they lead to."""
    inside, back = at_partners(right, left)
    with np.errstate(invalid="ignore"):
        return inside & (np.abs(left - back) <= tolerance_px)


def at_partners(values: Array[H, W], found: Array[H, W]) -> tuple[Array[H, W], Array[H, W]]:
    """Return whether left disparities lead to right pixels, and the right image's values there."""
    known, (height, width) = np.isfinite(found), found.shape
    partner = np.arange(width) - np.where(known, found, 0.0).round().astype(int)
    inside = known & (partner >= 0) & (partner < width)
    rows = width * np.arange(height)[:, None]
    return inside, values.take(np.where(inside, partner, 0) + rows)


def without_speckles(found: Array[H, W], least_px: int) -> Array[H, W]:
    """Return disparities without patches, bounded by steps above a pixel, of fewer than least_px pixels."""
    known = np.isfinite(found)
    if least_px <= 1 or not known.any():
        return found
    low = float(found[known].min())
    whole = np.where(known, (found - low) * _UNIT + _UNIT, 0).astype(np.int16)
    cv2.filterSpeckles(whole, 0, least_px, _UNIT)
    return np.where(whole > 0, found, np.float32(np.nan))


def _sgbm(left: Bytes, right: Bytes, least: int, most: int, window_px: int) -> Array:
    count = -(-(most - least + 1) // _STEP) * _STEP
    channels = 1 if left.ndim == 2 else left.shape[2]
    area = channels * window_px**2
    matcher = cv2.StereoSGBM_create(  # type: ignore[attr-defined]
        minDisparity=0,
        numDisparities=count,
        blockSize=window_px,
        P1=8 * area,
        P2=32 * area,
        disp12MaxDiff=-1,  # our own check does that
        preFilterCap=31,
        uniquenessRatio=5,
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    # SGBM answers nothing in its first `count` columns, so they are added in front; moving the
    # right image makes the range start at 0
    wide = cv2.copyMakeBorder(left, 0, 0, count, 0, cv2.BORDER_REPLICATE)
    moved = moved_right(right, least, count)
    raw = np.asarray(matcher.compute(wide, moved))[:, count:]
    return np.where(raw >= 0, raw / np.float32(_UNIT) + least, np.nan).astype(np.float32)


def moved_right(image: Bytes[H, W], by: int, extra: int = 0) -> Bytes[H, L]:
    """Return columns −extra … W − 1 of the image moved right by `by`, its edge repeated."""
    before = max(extra + by, 0)
    wide = cv2.copyMakeBorder(image, 0, 0, before, max(-by, 0), cv2.BORDER_REPLICATE)
    first = before - extra - by
    return np.asarray(wide, np.uint8)[:, first : first + extra + image.shape[1]]


def _grey(image: Bytes) -> Bytes:
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)  # type: ignore


def _mirrored(image: Bytes) -> Bytes:
    return np.asarray(cv2.flip(image, 1), np.uint8)


# ---- From a pair of images to points


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
        surface &= (depth_m >= self.near_m) & (depth_m <= self.settings.far_m)
        rows, columns = np.nonzero(surface)
        if not len(rows):
            return EMPTY
        points = self.pair.points(columns, rows, view.disparity[surface].astype(float))
        return PointCloud(points, view.left[surface][:, ::-1])

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
    if _are_exchanged(matcher, pairs, first, second):
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


def _share_before(matcher: StereoMatcher, pairs: Array) -> float:
    """Return the share of features that lie before the cameras, in about the same row."""
    if len(pairs) < _LEAST_FEATURES:
        return 0.0
    level = np.abs(pairs[:, 1] - pairs[:, 3]) <= 4 * _ROW_PX
    return float((level & (pairs[:, 0] - pairs[:, 2] > matcher.pair.zero_disparity)).mean())


def _are_exchanged(matcher: StereoMatcher, pairs: Array, first: Bytes, second: Bytes) -> bool:
    """Return whether features lie behind the cameras, and do not with the images exchanged."""
    given = _share_before(matcher, pairs)
    if given >= _SHARE or first.shape != second.shape:
        return False
    exchanged = enumerate(matcher.pair.by_side(second, first))
    swapped = _shared_features(*(matcher.pair.rectify(image, side) for side, image in exchanged))
    return _share_before(matcher, swapped) > max(_SHARE, _EXCHANGED * given)


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
