"""Disparity by zero-mean normalised cross-correlation of square windows, as in the 2004 paper."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from handtrack.arrays import Array, Bytes, H, W


class Correlated(NamedTuple):
    """The best match of every pixel, in both directions."""

    left: Array[H, W]
    """float32 disparity of the left pixels, between whole pixels; NaN where none."""
    right: Array[H, W]
    """float32 disparity of the right pixels, whole; NaN where none."""


def correlate(
    left: Bytes[H, W],
    right: Bytes[H, W],
    least: int,
    most: int,
    window_px: int = 9,
    least_score: float = 0.6,
    least_contrast: float = 1.0,
) -> Correlated:
    """Return the disparities of two rectified grey images uint8: left x is right x − d.

    least, most: range of d searched [px], both included. least_score: correlation below which
    nothing matches. least_contrast: standard deviation in a window [grey levels] below which
    there is nothing to match. Memory does not grow with the range.
    """
    size = (window_px, window_px)
    a, b = _centred(left), _centred(right)
    mean_a, scale_a = _statistics(a, size, least_contrast)
    mean_b, scale_b = _statistics(b, size, least_contrast)
    best = np.full(a.shape, np.float32(least_score))
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
    return Correlated(found + _peak(before, best, after), found_right)


def _peak(before: Array, best: Array, after: Array) -> Array:
    """Return where between −½ and ½ the parabola through three scores has its top; 0 at the ends
    of the range."""
    bend = before - 2 * best + after
    with np.errstate(invalid="ignore", divide="ignore"):
        top = (before - after) / (2 * bend)
    return np.where((bend < 0) & (np.abs(top) <= 0.5), top, 0.0).astype(np.float32)


def _centred(image: Bytes) -> Array:
    """Return the image as float32 around 0, so that its squares lose no digits."""
    return image.astype(np.float32) - np.float32(image.mean())


def _statistics(image: Array, size: tuple[int, int], least_contrast: float) -> tuple[Array, Array]:
    """Return each window's mean and 1 / standard deviation; NaN where there is no contrast."""
    mean = cv2.boxFilter(image, -1, size)
    variance = cv2.boxFilter(image * image, -1, size) - mean * mean
    with np.errstate(invalid="ignore", divide="ignore"):
        scale = np.where(variance > least_contrast**2, 1 / np.sqrt(variance), np.nan)
    return mean, scale.astype(np.float32)
