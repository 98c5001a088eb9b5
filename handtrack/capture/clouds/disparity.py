"""Disparity of rectified pairs by two methods, with the checks that both pass through."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from handtrack.arrays import Array, Axes, Bytes, H, L, W
from handtrack.errors import HandtrackError, unknown_name
from handtrack.setting import setting


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
    best = np.full(a.shape, np.float32(_LEAST_SCORE))
    best_right = best.copy()
    found = np.full_like(a, np.nan, np.float32)
    found_right = found.copy()
    before = np.full_like(a, np.nan, np.float32)
    after = before.copy()
    last = np.full_like(a, np.nan, np.float32)
    width = a.shape[1]
    for d in range(least, most + 1):
        # only columns x with 0 <= x - d < width have a partner
        mine, theirs = slice(max(d, 0), width + min(d, 0)), slice(max(-d, 0), width - max(d, 0))
        score = np.full_like(a, np.nan, np.float32)
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
    partner = np.arange(found.shape[1]) - np.nan_to_num(found).round().astype(int)
    inside = np.isfinite(found) & (partner >= 0) & (partner < found.shape[1])
    return inside, np.take_along_axis(values, np.where(inside, partner, 0), axis=1)


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
    width = image.shape[1]
    source = np.clip(np.arange(-extra, width) - by, 0, width - 1)
    return np.ascontiguousarray(image[:, source])


def _grey(image: Bytes) -> Bytes:
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)  # type: ignore


def _mirrored(image: Bytes) -> Bytes:
    return np.ascontiguousarray(image[:, ::-1])
