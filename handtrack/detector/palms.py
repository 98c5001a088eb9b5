"""What the palm network says: its anchors, and palms out of 2016 overlapping boxes."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from handtrack.arrays import D2, D4, D7, Axes, Floats, K, N

PALM_SIZE = 192
"""of the network's image [px]"""
_GRIDS = ((24, 2), (12, 6))  # cells a side, anchors a cell
_LEAST_SCORE = 0.5
_OVERLAP = 0.3  # intersection over union, beyond which two boxes are of one palm
_MOST_LOGIT = 100.0


class Palm(NamedTuple):
    """A palm in the unit square that the network saw."""

    score: float
    box: Floats[D4]
    """centre x, y, width, height"""
    points: Floats[D7, D2]
    """wrist, knuckles of index, middle, ring and little finger, the thumb's base and knuckle"""


@lru_cache(maxsize=1)
def anchors() -> Floats[N, D2]:
    """Return the 2016 points of the unit square that the network's boxes are offset from: cells of two grids, row by row."""
    parts = []
    for cells, each in _GRIDS:
        middle = (np.arange(cells) + 0.5) / cells
        grid = np.stack(np.meshgrid(middle, middle), axis=-1).reshape(-1, 2)
        parts.append(np.repeat(grid, each, axis=0))
    return np.concatenate(parts)


def palms(numbers: Floats[N, K], logits: Floats[N], most: int) -> list[Palm]:
    """Return up to `most` palms, the surest first.

    numbers: for each anchor box and seven points (18), in pixels of the network's image. Boxes that overlap are averaged, with
    their scores as weights, rather than dropped.
    """
    scores = 1.0 / (1.0 + np.exp(-np.clip(logits.astype(float), -_MOST_LOGIT, _MOST_LOGIT)))
    sure = np.flatnonzero(scores > _LEAST_SCORE)
    scores, decoded = scores[sure], numbers[sure].astype(float) / PALM_SIZE
    offsets = anchors()[sure]
    decoded[:, :2] += offsets
    decoded[:, 4:] += np.tile(offsets, 7)
    found: list[Palm] = []
    while len(scores) and len(found) < most:
        best = int(scores.argmax())
        same = overlaps(decoded[:, :4], decoded[best, :4]) > _OVERLAP
        same[best] = True
        mean = np.average(decoded[same], axis=0, weights=scores[same])
        found.append(Palm(float(scores[best]), mean[:4], mean[4:].reshape(7, 2)))
        scores, decoded = scores[~same], decoded[~same]
    return found


def overlaps(boxes: Floats[*Axes, D4], box: Floats[D4]) -> Floats[*Axes]:
    """Return intersection over union of boxes (centre, size) with one."""
    low = np.maximum(boxes[..., :2] - boxes[..., 2:] / 2, box[:2] - box[2:] / 2)
    high = np.minimum(boxes[..., :2] + boxes[..., 2:] / 2, box[:2] + box[2:] / 2)
    common = np.prod(np.maximum(high - low, 0.0), axis=-1)
    union = np.prod(boxes[..., 2:], axis=-1) + np.prod(box[2:]) - common
    return common / np.maximum(union, 1e-12)
