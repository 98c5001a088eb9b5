"""Where in an image a hand is expected, before its colours are looked at: from a detector's joints, or a model's outline."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import cv2
import numpy as np

from handtrack.arrays import D2, Array, Bytes, Floats, H, W, array_dataclass
from handtrack.capture.images.openpose import FINGERS

_PALM = ("wrist", "thumb_cmc", "thumb_mcp", "index_mcp", "middle_mcp", "ring_mcp", "little_mcp")
_KNUCKLES = ("index_mcp", "middle_mcp", "ring_mcp", "little_mcp")
_PALM_M = 0.09
"""wrist to knuckles, and about the palm's breadth, of a mean adult (hand26's definition): what sizes are told by"""
_FINGER_M = 0.008
"""half a finger's breadth"""
_PALM_DEPTH_M = 0.015
"""of the palm beyond the joints at its edges: heel, ball of the thumb and the little finger's side; as the finger's until a look
at desk_two_view showed palms cut"""
_CORE_M = 0.003
"""this near to bones, and this deep in the palm, is hand where the joints are right"""
_MARGIN_M = 0.045
"""the image is looked at this far around the joints; further out is no hand"""
_JOINTS_OFF_M = 0.01
"""how far a detector's joints lie beside a model's (docs/how-to/masks_and_joints.md: 10 to 15 mm at the worst joints); 6 mm until a look at desk_two_view"""
_ARM_M = 0.06
"""behind the wrist nothing is said from here on: it may be arm, sleeve or desk; 3 cm tell an arm's direction, and a detector's
wrist lies up to as much inside of the palm; 30 mm until a look at desk_two_view showed no forearm found"""
_MOST = 4.0
"""log-odds: place alone is never surer than 50 to 1"""


@array_dataclass
class HandSeeds:
    """What is expected in a part of an image."""

    corner: tuple[int, int]
    """column, row [px] of the part's first pixel."""
    log_odds: Floats[H, W]
    """of hand against background, by place alone."""
    core: Array[H, W]
    """bool: what shows how the hand looks in this image, if the joints are right."""
    before: Array[H, W]
    """bool: on the hand's side of the wrist, where what is no hand is no arm either."""
    px_per_m: float
    """how large the hand is in the image."""
    line: tuple[float, float, float]
    """(a, b, c): behind the wrist is a u + b v + c < 0, in the whole image [px]."""

    @property
    def part(self) -> tuple[slice, slice]:
        """Return rows and columns of the image that are looked at."""
        (x, y), (height, width) = self.corner, self.log_odds.shape
        return slice(y, y + height), slice(x, x + width)

    def behind(self, shape: tuple[int, ...]) -> Array[H, W]:
        """Return where in an image of that height and width nothing is said of: behind the wrist, by `line`."""
        a, b, c = self.line
        return a * np.arange(shape[1]) + b * np.arange(shape[0])[:, None] + c < 0


def seeds_of_joints(joints: Mapping[str, Floats[D2]], size: tuple[int, int]) -> HandSeeds | None:
    """Return seeds of joints by name [px], in an image of size (width, height); None without a wrist and two knuckles.

    The hand is drawn as bones and palm, a finger's breadth around them; sizes come from the palm, whichever way it is seen.
    """
    points = {name: at for name, at in joints.items() if np.isfinite(at).all()}
    knuckles = [points[name] for name in _KNUCKLES if name in points]
    if "wrist" not in points or len(knuckles) < 2:
        return None
    palm = np.array([points["wrist"], *knuckles])
    px_per_m = float(np.linalg.norm(palm[:, None] - palm, axis=-1).max()) / _PALM_M
    everything = np.array(list(points.values()))
    box = _box(everything, _MARGIN_M * px_per_m, size)
    if box is None or px_per_m * _FINGER_M < 1.0:
        return None
    (x, y), (width, height) = box
    bones, palm_drawn = np.zeros((2, height, width), np.uint8)
    shift = np.array([x, y])
    chains = [[f"{finger}_{name}" for name in names] for finger, names in FINGERS.items()]
    links = [
        np.rint(np.array([points[a], points[b]]) - shift).astype(np.int32)
        for chain in chains
        for a, b in itertools.pairwise(chain)
        if a in points and b in points
    ]
    cv2.polylines(bones, links, False, 255)
    flat = np.array([points[name] for name in _PALM if name in points]) - shift
    cv2.fillPoly(palm_drawn, [cv2.convexHull(np.rint(flat).astype(np.int32))], 255)
    of_palm, of_bones = _inside(palm_drawn) / px_per_m, _inside(bones) / px_per_m
    inside = np.maximum(of_palm + _PALM_DEPTH_M, of_bones + _FINGER_M)
    core = (of_palm > _CORE_M) | (of_bones > -_CORE_M)
    along = _along(points["wrist"], np.mean(knuckles, axis=0))
    return _seeds((x, y), inside, core, _JOINTS_OFF_M, along, px_per_m)


def seeds_of_outline(
    drawn: Bytes[H, W], off_m: float, px_per_m: float, wrist: Floats[D2], knuckles: Floats[D2]
) -> HandSeeds | None:
    """Return seeds of a model's outline, which is known to `off_m` [m].

    None where the model is out of sight.

    Parameters
    ----------
    drawn
        255 where the image shows the model, else 0.
    wrist, knuckles
        Where they are in the image [px].
    """
    inside_px = _inside(drawn).astype(float)
    rows, columns = np.nonzero(inside_px > 0)
    if not len(rows):
        return None
    height, width = inside_px.shape
    box = _box(np.column_stack([columns, rows]), _MARGIN_M * px_per_m, (width, height))
    if box is None:
        return None
    (x, y), (wide, high) = box
    inside = inside_px[y : y + high, x : x + wide] / px_per_m
    return _seeds((x, y), inside, inside > _CORE_M, off_m, _along(wrist, knuckles), px_per_m)


def _seeds(
    corner: tuple[int, int],
    inside: Array,
    core: Array,
    off_m: float,
    along: tuple[float, float, float],
    px_per_m: float,
) -> HandSeeds:
    """inside: how far inside of where the outline is expected [m]; along: a u + b v + c is how far before the wrist [px]."""
    height, width = inside.shape
    column, row = np.arange(width) + corner[0], np.arange(height)[:, None] + corner[1]
    a, b, c = along
    before = (a * column + b * row + c) / px_per_m
    # log-odds of a normal distribution, nearly: Φ(x) ≈ 1 / (1 + exp(−1.7 x))
    odds = np.clip(1.7 * inside / off_m, -_MOST, _MOST).astype(np.float32)
    odds[before < 0] = np.maximum(odds[before < 0], 0)  # a wrist goes on as an arm, or not
    core &= before > 0
    line = a, b, c + _ARM_M * px_per_m
    return HandSeeds(corner, odds, core, before > 0, px_per_m, line)


def _along(wrist: Array, knuckles: Array) -> tuple[float, float, float]:
    """Return (a, b, c): a u + b v + c is how far a pixel lies before the wrist, towards the knuckles [px]."""
    along = knuckles - wrist
    along = along / max(float(np.linalg.norm(along)), 1e-9)
    return float(along[0]), float(along[1]), -float(along @ wrist)


def _inside(drawn: Array) -> Array:
    """Return how far pixels lie inside of what is drawn, below 0 outside [px]."""
    far = cv2.distanceTransform(255 - drawn, cv2.DIST_L2, 5)
    return cv2.distanceTransform(drawn, cv2.DIST_L2, 5) - far


def _box(
    points: Array, margin: float, size: tuple[int, int]
) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """Return corner and size of a box around points inside an image; None where they are outside."""
    low = np.maximum(np.floor(points.min(axis=0) - margin), 0).astype(int)
    high = np.minimum(np.ceil(points.max(axis=0) + margin) + 1, size).astype(int)
    if (high - low < 2).any():
        return None
    wide = high - low
    return (int(low[0]), int(low[1])), (int(wide[0]), int(wide[1]))
