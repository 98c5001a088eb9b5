"""Pictures of clouds: camera images with each point in its filter's colour, and how a pair was matched."""

from __future__ import annotations

import cv2
import numpy as np

from handtrack.arrays import D3, Array, Bytes, Floats, H, N, W
from handtrack.capture.clouds.disparity import REJECTED
from handtrack.capture.clouds.rectification import RectifiedPair
from handtrack.capture.clouds.stereo import StereoView
from handtrack.geometry.camera import Camera
from handtrack_app.protocol.palette import FILTERS, KEPT, REJECTS

NARROW_PX, WIDE_PX = 620, 1240  # width of a picture in its panel, and large
_TALLEST = 0.6  # height of a large picture as a share of its width
_LINES = 12  # epipolar lines
_MARGIN = 0.12  # around what was matched, as a share of its size
_LINE, _BOX = (86, 180, 233), (255, 255, 255)


def points_picture(
    image: Bytes[H, W, D3],
    camera: Camera,
    points: Floats[N, D3],
    fate: Array[N],
    names: tuple[str, ...],
    width: int,
    box: tuple[int, int, int, int] | None = None,
) -> Bytes[H, W, D3]:
    """Return an image RGB at a width [px], each point painted in the colour of the filter that dropped it.

    points: world [m]. fate: place of the filter in `names`, or their number for points that stay.
    box: x, y, w, h [px] of the image, drawn as a frame.
    """
    factor = width / image.shape[1]
    size = (width, max(round(factor * image.shape[0]), 1))
    picture = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    picture = np.asarray(0.72 * picture, np.uint8)
    pixels = factor * (camera.project(points) + 0.5) if len(points) else np.zeros((0, 2))
    with np.errstate(invalid="ignore"):
        seen = ((pixels >= 0) & (pixels < size)).all(axis=1)
    for number, name in enumerate(names):  # those that stay come last, on top
        _paint(picture, pixels[seen & (fate == number)], FILTERS[name], 1)
    _paint(picture, pixels[seen & (fate == len(names))], KEPT, 1 + (width > NARROW_PX))
    if box is not None:
        corner = (round(box[0] * factor), round(box[1] * factor))
        other = (round((box[0] + box[2]) * factor), round((box[1] + box[3]) * factor))
        for colour, thick in (((0, 0, 0), 4), (_BOX, 2)):
            cv2.rectangle(picture, corner, other, colour, thick)
    return picture


def _paint(picture: Bytes, pixels: Floats, colour: tuple[int, int, int], side: int) -> None:
    x, y = pixels.astype(np.int64).T if len(pixels) else np.zeros((2, 0), np.int64)
    for right in range(side):
        for down in range(side):
            rows = np.minimum(y + down, picture.shape[0] - 1)
            picture[rows, np.minimum(x + right, picture.shape[1] - 1)] = colour


def depth_picture(depth_m: Floats[H, W]) -> Bytes[H, W, D3]:
    """Return a depth image [m] in colours RGB, near is bright; black where nothing was measured."""
    known = np.isfinite(depth_m) & (depth_m > 0)
    return _coloured(np.where(known, -depth_m, np.nan))


def stereo_pictures(view: StereoView) -> dict[str, Bytes[H, W, D3]]:
    """Return what to show of a matched pair, RGB: both rectified images with lines along which they are compared,
    the disparity, and what was thrown away; cut to what was matched, and around it.
    """
    rows, columns, moved = _cut(view)
    left, right = (np.asarray(i[..., ::-1], np.uint8).copy() for i in (view.left, view.right))
    found = view.disparity[rows, columns]
    grey = np.asarray(left[rows, columns].mean(axis=2) * 0.4, np.uint8)
    thrown = np.repeat(grey[..., None], 3, axis=2)
    kept = np.isfinite(found)
    thrown[kept] = np.clip(thrown[kept].astype(int) + 40, 0, 255)
    for number in range(1, len(REJECTED)):
        thrown[view.rejected[rows, columns] == number] = REJECTS[number]
    return {
        "left, rectified": _with_lines(left[rows, columns]),
        "right, rectified": _with_lines(right[rows, moved]),
        "disparity": _coloured(np.where(kept, found, np.nan)),
        "thrown away": thrown,
    }


def not_tall(picture: Bytes[H, W, D3]) -> Bytes[H, W, D3]:
    """Return a picture of the same width, smaller and with margins where it would cover all the page."""
    height, width = picture.shape[:2]
    most = round(_TALLEST * width)
    if height <= most:
        return picture
    across = round(width * most / height)
    small = np.asarray(cv2.resize(picture, (across, most), interpolation=cv2.INTER_AREA), np.uint8)
    left = (width - across) // 2
    framed = np.full((most, width, 3), 36, np.uint8)
    framed[:, left : left + across] = small
    return framed


def stereo_words(view: StereoView, pair: RectifiedPair) -> str:
    """Return how a pair was matched, in a line or two."""
    asked = max(view.asked, 1)
    known = view.disparity[np.isfinite(view.disparity)]
    asked_words = f"{view.asked:,}".replace(",", "\u202f")
    words = f"{100 * view.matched_share:.0f} % of {asked_words} pixels matched"
    if len(known):
        near, far = (float(pair.depth_of(np.quantile(known, q))) for q in (0.99, 0.01))
        words += f", {far * 100:.0f} to {near * 100:.0f} cm away"
    parts = [
        f"{REJECTED[n]} {100 * float((view.rejected == n).sum()) / asked:.0f} %"
        for n in range(1, len(REJECTED))
        if (view.rejected == n).any()
    ]
    return f"{words}. Thrown away: {', '.join(parts)}." if parts else f"{words}."


def _cut(view: StereoView) -> tuple[slice, slice, slice]:
    """Return rows and columns of the left image around what was looked at, and the right image's columns."""
    height, width = view.disparity.shape
    looked = np.isfinite(view.disparity) | (view.rejected > 0)
    if not looked.any():
        whole = slice(0, width)
        return slice(0, height), whole, whole
    y, x = np.flatnonzero(looked.any(axis=1)), np.flatnonzero(looked.any(axis=0))
    top, bottom = _span(int(y[0]), int(y[-1]) + 1, height)
    left, right = _span(int(x[0]), int(x[-1]) + 1, width)
    known = view.disparity[np.isfinite(view.disparity)]
    shift = round(float(np.median(known))) if len(known) else 0
    start = int(np.clip(left - shift, 0, width - (right - left)))
    return slice(top, bottom), slice(left, right), slice(start, start + right - left)


def _span(low: int, high: int, size: int) -> tuple[int, int]:
    room = round(_MARGIN * (high - low))
    return max(low - room, 0), min(high + room, size)


def _with_lines(image: Bytes) -> Bytes:
    picture = np.ascontiguousarray(image)
    thick = max(picture.shape[1] // 500, 1)
    for row in np.linspace(0, picture.shape[0] - 1, _LINES + 2)[1:-1].round().astype(int):
        cv2.line(picture, (0, int(row)), (picture.shape[1] - 1, int(row)), _LINE, thick)
    return picture


def _coloured(values: Array) -> Bytes:
    """Return values (H, W) in colours that people with any colour vision can read; NaN is black."""
    known = np.isfinite(values)
    if not known.any():
        return np.zeros((*values.shape, 3), np.uint8)
    low, high = np.quantile(values[known], [0.01, 0.99])
    share = (np.nan_to_num(values, nan=low) - low) / max(float(high - low), 1e-12)
    grey = np.asarray(np.clip(40 + 215 * share, 40, 255), np.uint8)
    picture = np.asarray(cv2.applyColorMap(grey, cv2.COLORMAP_CIVIDIS)[..., ::-1], np.uint8).copy()
    picture[~known] = 0
    return picture
