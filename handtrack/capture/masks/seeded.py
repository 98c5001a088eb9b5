"""Mask method that starts from where the hand is expected, by a detector's joints or a model's outline, and learns on this recording what hand and background look like."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated

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
    N,
    W,
    array_dataclass,
    evenly_spread,
)
from handtrack.capture.images.openpose import FINGERS
from handtrack.capture.masks.mask_correction import UNKNOWN_LEVEL, Roi, inside_roi
from handtrack.errors import HandtrackError
from handtrack.files.toml_table import above, at_least

# ---- Where a hand is expected, before colours are looked at


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
    px_per_m: float
    """how large the hand is in the image."""
    along: tuple[float, float, float]
    """(a, b, c): a u + b v + c is how far a pixel of the whole image lies before the wrist, towards the knuckles [px]."""

    @property
    def part(self) -> tuple[slice, slice]:
        """Return rows and columns of the image that are looked at."""
        (x, y), (height, width) = self.corner, self.log_odds.shape
        return slice(y, y + height), slice(x, x + width)

    @property
    def before(self) -> Array[H, W]:
        """bool: on the hand's side of the wrist, where what is no hand is no arm either."""
        return _before(self.along, self.corner, self.log_odds.shape) / self.px_per_m > 0

    def behind(self, shape: tuple[int, ...]) -> Array[H, W]:
        """Return where in an image of that height and width nothing is said of: well behind the wrist."""
        a, b, c = self.along
        return _before((a, b, c + _ARM_M * self.px_per_m), (0, 0), shape) < 0


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
    box = _box_around(everything, _MARGIN_M * px_per_m, size)
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
    box = _box_around(np.column_stack([columns, rows]), _MARGIN_M * px_per_m, (width, height))
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
    before = _before(along, corner, inside.shape) / px_per_m
    # log-odds of a normal distribution, nearly: Φ(x) ≈ 1 / (1 + exp(−1.7 x))
    odds = np.clip(1.7 * inside / off_m, -_MOST, _MOST).astype(np.float32)
    odds[before < 0] = np.maximum(odds[before < 0], 0)  # a wrist goes on as an arm, or not
    return HandSeeds(corner, odds, core & (before > 0), px_per_m, along)


def _before(
    along: tuple[float, float, float], corner: tuple[int, int], shape: tuple[int, ...]
) -> Floats[H, W]:
    """Return how far pixels lie before the wrist [px], in a part of the image of that corner (column, row), height and width."""
    a, b, c = along
    column, row = np.arange(shape[1]) + corner[0], np.arange(shape[0])[:, None] + corner[1]
    return a * column + b * row + c


def _along(wrist: Array, knuckles: Array) -> tuple[float, float, float]:
    """Return (a, b, c): a u + b v + c is how far a pixel lies before the wrist, towards the knuckles [px]."""
    along = knuckles - wrist
    along = along / max(float(np.linalg.norm(along)), 1e-9)
    return float(along[0]), float(along[1]), -float(along @ wrist)


def _inside(drawn: Array) -> Array:
    """Return how far pixels lie inside of what is drawn, below 0 outside [px]."""
    far = cv2.distanceTransform(255 - drawn, cv2.DIST_L2, 5)
    return cv2.distanceTransform(drawn, cv2.DIST_L2, 5) - far


def _box_around(
    points: Array, margin: float, size: tuple[int, int]
) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """Return corner and size of a box around points inside an image; None where they are outside."""
    low = np.maximum(np.floor(points.min(axis=0) - margin), 0).astype(int)
    high = np.minimum(np.ceil(points.max(axis=0) + margin) + 1, size).astype(int)
    if (high - low < 2).any():
        return None
    wide = high - low
    return (int(low[0]), int(low[1])), (int(wide[0]), int(wide[1]))


# ---- What looks like it


_Sample = tuple[Array, HandSeeds]
"""a sampled frame's image, and where the hand is expected in it"""
Seeds = Callable[[int], HandSeeds | None]
"""frame → where the hand is expected in its image"""
Read = Callable[[int], Array | None]
"""frame → its image; None where there is none"""

_WORK_PX_A_M = 700.0
"""images are looked at this coarse: a finger is 11 pixels wide; bounds the cost"""
_SMOOTH_M = 0.004
"""what one pixel says, its neighbours as far as a quarter of a finger's breadth say too"""
_BLUR_M = 2 * _SMOOTH_M
"""so far apart sure hand and sure background may be by that smoothing alone, which makes no outline unknown"""
_COLOURED = 6.0
"""distance of a or b of Lab from grey [8 bit] that is reached nowhere in images without colour: infrared; set with desk_two_view
in view"""
_AWAY = -2.0
"""log-odds by place below which the hand is not, for the image of the background alone"""
_LEAST_SAMPLES = 3
_LONGEST_PX = 480
"""of the image of the background alone"""
_ROUNDING = 4.0
"""variance of 8 bit levels by compression"""
_ROUNDS = 3
"""of learning: by place alone, then by what was learned, too"""
_CUE_WEIGHT = 0.5
"""of the log-odds by colour and by change against the background, which look at the same pixel"""
_BITS = 4
"""of each channel: 16 levels, as coarse as skin is even"""
_LEVELS = 1 << _BITS
_BINS = _LEVELS**3
_STRANGE = 0.02
"""share of pixels that are of none of the colours seen: reflections, compression; bounds what one pixel can say"""
_SPREAD = (0.25, 0.5, 0.25)
"""colours one level apart are half as likely the same (a light that turns does that much)"""


@dataclass(frozen=True)
class Seeded:
    """What looks like this recording's hand near where its joints, or a model, say that it is; unknown where that is not sure."""

    name = "seeded"
    needs = "images"

    samples: Annotated[int, at_least(_LEAST_SAMPLES)] = 25
    """frames, evenly spaced over the recording, that teach what hand and background look like."""
    sure: Annotated[float, above(0.5, "probability")] = 0.9
    """how probable hand, or background, must be; what is less so counts for nothing."""

    def __post_init__(self) -> None:
        if self.sure >= 1:
            raise ValueError(f"sure = {self.sure:g}; expected a probability above 0.5 and below 1.")

    def learned(
        self, count: int, read: Read, seeds: Seeds, where: str = "images", roi: Roi | None = None
    ) -> SeededMasks:
        """Return what makes masks, after one look at some of so many frames.

        Raises HandtrackError with fewer than 3 that show a hand. where: the path or pattern, for that.
        """
        samples = [
            (image, found)
            for frame in evenly_spread(count, self.samples)
            if (found := seeds(frame)) is not None and (image := read(frame)) is not None
        ]
        if len(samples) < _LEAST_SAMPLES:
            raise HandtrackError(
                f"{where}: mask method seeded learns from images in which the hand was found, at least "
                f"{_LEAST_SAMPLES} of {self.samples}; found {len(samples)}. `handtrack detect SESSION --write` finds joints."
            )
        return SeededMasks(self, samples, roi)


class SeededMasks:
    """Masks of one camera's images. Safe to use from several threads."""

    def __init__(self, method: Seeded, samples: list[_Sample], roi: Roi | None) -> None:
        """Use `Seeded.learned`."""
        self._limit = float(np.log(method.sure / (1 - method.sure)))
        self._roi = roi
        spread = np.mean([_colour(image) for image, _ in samples])
        self._grey = bool(spread < _COLOURED)
        self._empty = _background(samples)
        self._by_change = self._other_log = self._hand_log = np.zeros(_BINS)
        self._teach(samples, lambda part: part.prior)
        for _ in range(_ROUNDS - 1):
            self._teach(samples, self._log_odds)

    def mask(self, image: Bytes[H, W, D3], seeds: HandSeeds) -> Bytes[H, W]:
        """Return a mask uint8 of an image BGR: 255 hand, 0 background, UNKNOWN_LEVEL where neither is sure."""
        odds = self._log_odds(_Part(image, seeds, self._grey, self._empty))
        height, width = seeds.log_odds.shape
        odds = cv2.resize(odds, (width, height), interpolation=cv2.INTER_LINEAR)
        part = np.full((height, width), UNKNOWN_LEVEL, np.uint8)
        part[odds > self._limit] = 255
        part[odds < -self._limit] = 0
        between = _between(part, seeds.px_per_m)
        part[between] = np.where(odds[between] > 0, 255, 0)
        part = _connected(part, seeds.core)
        mask = np.zeros(image.shape[:2], np.uint8)
        mask[seeds.part] = part
        mask[seeds.behind(mask.shape)] = UNKNOWN_LEVEL
        return mask if self._roi is None else inside_roi(mask, self._roi)

    def _log_odds(self, part: _Part) -> Floats:
        """Return log-odds of hand in a part, coarse."""
        log_odds = self._pixel_log_odds(part, self._hand_log, self._other_log)
        likely = 1 / (1 + np.exp(-(log_odds + part.prior)))
        outside = part.before & ~part.core
        frame = counted(part.bins[part.core], likely[part.core])
        ring = counted(part.bins[outside], 1 - likely[outside])
        log_odds = self._pixel_log_odds(
            part,
            mixed(self._hand_log, log_likelihood(frame)),
            mixed(self._other_log, log_likelihood(ring)),
        )
        radius = max(round(_SMOOTH_M * part.px_per_m), 1)
        return smoothed(log_odds, part.guide(likely), radius) + part.prior

    def _pixel_log_odds(self, part: _Part, hand: Floats, other: Floats) -> Floats[H, W]:
        """Return log-odds by each pixel alone: its colour, and how it differs from the background."""
        odds = (hand - other)[part.bins]
        if part.change is not None:
            change = np.where(part.is_background, self._by_change[part.change], odds)
            odds = _CUE_WEIGHT * (odds + change)
        return odds.astype(np.float32)

    def _teach(self, samples: list[_Sample], log_odds: Callable[[_Part], Floats]) -> None:
        hand, other, moved, stayed = np.zeros((4, _BINS))
        for image, seeds in samples:
            part = _Part(image, seeds, self._grey, self._empty)
            likely = 1 / (1 + np.exp(-log_odds(part)))
            for share, colours, changes in (
                (likely * (part.before | part.core), hand, moved),
                ((1 - likely) * part.before, other, stayed),
            ):
                colours += counted(part.bins, share)
                if part.change is not None:
                    changes += counted(part.change, share * part.is_background)
        self._hand_log, self._other_log = log_likelihood(hand), log_likelihood(other)
        self._by_change = log_likelihood(moved) - log_likelihood(stayed)


class _Part:
    """What is looked at of one image, coarse: where the hand is expected."""

    def __init__(
        self, image: Array, seeds: HandSeeds, grey: bool, empty: tuple[Array, Array] | None
    ) -> None:
        scale = min(1.0, _WORK_PX_A_M / seeds.px_per_m)
        self.px_per_m = scale * seeds.px_per_m
        height, width = seeds.log_odds.shape
        size = max(round(scale * width), 2), max(round(scale * height), 2)
        self.prior = _reduced(seeds.log_odds, size)
        self.core, self.before = (
            _reduced(m.astype(np.float32), size) == 1 for m in (seeds.core, seeds.before)
        )
        small = _reduced(np.ascontiguousarray(image[seeds.part]), size)
        self.channels = _textured(small) if grey else cv2.cvtColor(small, cv2.COLOR_BGR2Lab)
        self.bins = bins_of(self.channels)
        self.change = None
        if empty is not None:
            behind, known = (_cut(picture, image.shape, seeds, size) for picture in empty)
            self.is_background = known > 0.5
            away = small.astype(np.int16) - behind
            self.change = bins_of(np.clip(128 + away, 0, 255).astype(np.uint8))

    def guide(self, likely: Floats[H, W]) -> Floats[H, W]:
        """Return one number a pixel that parts hand from background best, in units of what it varies within either."""
        values = self.channels.reshape(-1, 3).astype(np.float32)
        shares = likely.ravel(), ((1 - likely) * self.before).ravel()
        means, spreads = [], []
        for share in shares:
            total = share.sum() + 1e-9
            means.append(share @ values / total)
            away = values - means[-1]
            spreads.append((share[:, None] * away).T @ away / total)
        spread = np.mean(spreads, axis=0) + _ROUNDING * np.eye(3)
        way = np.linalg.solve(spread, means[0] - means[1])
        way /= np.sqrt(way @ spread @ way) + 1e-9
        return (values @ way.astype(np.float32)).reshape(self.bins.shape)


def _background(samples: list[_Sample]) -> tuple[Array, Array] | None:
    """Return the median image without the hand, small, int16, and where it is known (at least 3 frames without hand or arm)."""
    height, width = samples[0][0].shape[:2]
    scale = min(1.0, _LONGEST_PX / max(height, width))
    size = max(round(scale * width), 2), max(round(scale * height), 2)
    stack = np.empty((len(samples), size[1], size[0], 3), np.uint8)
    free = np.empty((len(samples), size[1], size[0]), bool)
    for i, (image, seeds) in enumerate(samples):
        taken = seeds.behind((height, width)).astype(np.float32)
        taken[seeds.part] = np.maximum(taken[seeds.part], seeds.log_odds > _AWAY)
        stack[i] = _reduced(image, size)
        free[i] = _reduced(taken, size) == 0
    often = free.sum(axis=0)
    if not (often >= _LEAST_SAMPLES).any():
        return None
    middle = np.maximum(often - 1, 0)[None] // 2
    median = np.empty((size[1], size[0], 3), np.int16)
    for channel in range(3):
        values = np.where(free, stack[..., channel].astype(np.int16), np.int16(999))
        values.sort(axis=0)
        median[..., channel] = np.take_along_axis(values, middle, axis=0)[0]
    return median, (often >= _LEAST_SAMPLES).astype(np.float32)


def _cut(picture: Array, shape: tuple[int, ...], seeds: HandSeeds, size: tuple[int, int]) -> Array:
    """Return a small picture of the whole image, `shape`, where seeds look, in their size."""
    (x, y), (height, width) = seeds.corner, seeds.log_odds.shape
    small = picture.shape[1] / shape[1], picture.shape[0] / shape[0]
    step = width / size[0] * small[0], height / size[1] * small[1]
    matrix = np.array(
        [
            [step[0], 0, (x + 0.5 * width / size[0]) * small[0] - 0.5],
            [0, step[1], (y + 0.5 * height / size[1]) * small[1] - 0.5],
        ]
    )
    how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(picture, matrix, size, flags=how, borderMode=cv2.BORDER_REPLICATE)


def _colour(image: Array) -> float:
    """Return how far an image's most coloured parts are from grey [8 bit of Lab]."""
    small = cv2.resize(image, (64, 64), interpolation=cv2.INTER_AREA)
    away = np.abs(cv2.cvtColor(small, cv2.COLOR_BGR2Lab)[..., 1:].astype(float) - 128)
    return float(np.quantile(away, 0.99))


def _textured(image: Array) -> Array:
    """Return three channels of a grey picture: brightness, that of its surroundings, and how rough it is."""
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    around = cv2.blur(grey, (5, 5))
    rough = cv2.blur(cv2.absdiff(grey, around), (5, 5))
    return np.dstack([grey, around, np.minimum(rough.astype(np.int32) * 8, 255).astype(np.uint8)])


def _reduced(image: Array, size: tuple[int, int]) -> Array:
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def _between(part: Bytes[H, W], px_per_m: float) -> Array[H, W]:
    """Return which unknown pixels lie where sure hand and sure background meet: that the outline is there is known."""
    unknown = part == UNKNOWN_LEVEL
    apart = sum(
        cv2.distanceTransform((part != level).astype(np.uint8), cv2.DIST_L2, 5)
        for level in (0, 255)
    )
    return unknown & (np.asarray(apart) <= _BLUR_M * px_per_m)


def _connected(part: Bytes[H, W], core: Array[H, W]) -> Bytes[H, W]:
    """Return a mask whose pieces of hand that touch nothing of the core are unknown."""
    hand = (part == 255).astype(np.uint8)
    _, labels = cv2.connectedComponents(hand, connectivity=8)
    kept = np.zeros(labels.max() + 1, bool)
    kept[np.unique(labels[core])] = True
    return np.where((hand > 0) & ~kept[labels], UNKNOWN_LEVEL, part).astype(np.uint8)


def counted(bins: Array[*Axes], weights: Array[*Axes]) -> Floats[N]:
    """Return how much each colour weighs of pixels with these bins, see `bins_of`."""
    return np.asarray(np.bincount(bins.ravel(), weights.ravel(), _BINS), dtype=float)


def log_likelihood(counts: Floats[N]) -> Floats[N]:
    """Return log p of each bin; of all alike where nothing was counted."""
    from scipy.ndimage import convolve1d  # only where masks are made

    cube = counts.reshape((_LEVELS,) * 3)
    for axis in range(3):
        cube = convolve1d(cube, _SPREAD, axis, mode="nearest")
    total = float(cube.sum())
    share = cube.ravel() / total if total > 0 else np.full(_BINS, 1.0 / _BINS)
    return np.log((1 - _STRANGE) * share + _STRANGE / _BINS)


def mixed(first: Floats[N], second: Floats[N]) -> Floats[N]:
    """Return the log likelihood of a mixture of equal parts."""
    return np.logaddexp(first, second) - np.log(2)


def bins_of(channels: Array[H, W, D3]) -> Array[H, W]:
    """Return the bin of each pixel."""
    reduced = channels.astype(np.int32) >> (8 - _BITS)
    return (reduced[..., 0] << (2 * _BITS)) | (reduced[..., 1] << _BITS) | reduced[..., 2]


def smoothed(values: Floats[H, W], guide: Floats[H, W], radius: int) -> Floats[H, W]:
    """Return values averaged over squares of 2 radius + 1, but not across edges of the guide (He,
    Sun & Tang 2010).

    Parameters
    ----------
    guide
        In units of the noise that is no edge.
    """
    side = (2 * radius + 1,) * 2

    def mean(image: Array) -> Array:
        return cv2.blur(image, side, borderType=cv2.BORDER_REFLECT)

    mean_g, mean_v = mean(guide), mean(values)
    slope = (mean(guide * values) - mean_g * mean_v) / (mean(guide * guide) - mean_g**2 + 1.0)
    return mean(slope) * guide + mean(mean_v - slope * mean_g)
