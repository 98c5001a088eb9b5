"""Hands in images: where palms are, the 21 points of the hand in a region, hands followed from frame to frame, and which of them is ours."""

from __future__ import annotations

import importlib
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from handtrack.arrays import D2, D3, D4, D7, D21, Array, Axes, Floats, H, K, N, W, array_dataclass
from handtrack.detector.weights import Weights, find_weights, read_weights
from handtrack.errors import HandtrackError, unknown_name
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import skew
from handtrack.geometry.triangulation import triangulated
from handtrack.parallel import thread_count

Network = Callable[[Floats[H, W, D3]], Mapping[str, Array[*Axes]]]
"""image float32 → outputs by name, without the axis of one image"""
BACKENDS = ("opencv", "litert")
_LITERT = "ai_edge_litert"


def open_network(data: bytes, backend: str, where: str) -> Network:
    """Return a network, to be used by one thread at a time. Raises HandtrackError naming `where` it came from."""
    if backend not in BACKENDS:
        raise unknown_name("backend", backend, BACKENDS)
    if backend == "litert" and not find_spec(_LITERT):
        raise HandtrackError(
            "LiteRT is not installed: `pip install handtrack3d[detector]` brings it; OpenCV does the same, 2.5 times slower."
        )
    try:
        return _by_litert(data) if backend == "litert" else _by_opencv(data)
    except (cv2.error, ValueError, RuntimeError, ImportError) as error:
        said = " ".join(str(error).split())
        raise HandtrackError(f"{where}: {backend} cannot run this network: {said}.") from None


def _by_opencv(data: bytes) -> Network:
    # of OpenCV's two engines the classic one alone gives several outputs, and it is only to be had for files
    engine = getattr(cv2.dnn, "ENGINE_CLASSIC", None)
    with tempfile.TemporaryDirectory(prefix="handtrack_") as folder:
        file = Path(folder) / "network.tflite"
        file.write_bytes(data)
        options = () if engine is None else (engine,)
        network = cv2.dnn.readNetFromTFLite(str(file), *options)
    names = network.getUnconnectedOutLayersNames()

    def run(image: Floats[H, W, D3]) -> Mapping[str, Array[*Axes]]:
        network.setInput(np.ascontiguousarray(image.transpose(2, 0, 1))[None])
        return {name: found[0] for name, found in zip(names, network.forward(names), strict=True)}

    return run


def _by_litert(data: bytes) -> Network:
    interpreter = importlib.import_module(f"{_LITERT}.interpreter").Interpreter(
        model_content=data, num_threads=thread_count()
    )
    interpreter.allocate_tensors()
    given = interpreter.get_input_details()[0]["index"]
    outputs = {row["name"]: row["index"] for row in interpreter.get_output_details()}

    def run(image: Floats[H, W, D3]) -> Mapping[str, Array[*Axes]]:
        interpreter.set_tensor(given, np.ascontiguousarray(image)[None])
        interpreter.invoke()
        return {name: interpreter.get_tensor(index)[0] for name, index in outputs.items()}

    return run


# Numbers and points of both squares are MediaPipe's: the networks were trained on crops made so.
_PALM_SIDE, _PALM_SHIFT = (
    2.6,
    0.5,
)  # times the box's longer side; of its height, towards the fingers
_HAND_SIDE, _HAND_SHIFT = 2.0, 0.1
_PALM_WRIST, _PALM_MIDDLE = 0, 2
_WRIST = 0
_STEADY = (0, 1, 2, 3, 5, 6, 9, 10, 13, 14, 17, 18)  # without the ends of fingers, which move most
_INDEX, _MIDDLE, _RING = 6, 10, 14  # PIP


@array_dataclass
class Region:
    """A square of an image."""

    centre: Floats[D2]
    """column, row [px], pixel centres at whole numbers"""
    side: float
    """[px]"""
    turn: float
    """[rad]: turns the crop's axes into the image's"""

    def to_image(self, unit: Floats[*Axes, D2]) -> Floats[*Axes, D2]:
        """Return pixels of points of the square, which are 0 to 1 between its edges."""
        return (np.asarray(unit, float) - 0.5) * self.side @ _turning(self.turn).T + self.centre

    def crop(self, image: Array[H, W, D3], size: int) -> Floats[H, W, D3]:
        """Return the square as an image of size × size, RGB float32 from 0 to 1, black outside. image: uint8 BGR."""
        pixels = (np.array([[0, 0], [1, 0], [0, 1]]) + 0.5) / size
        origin, across, down = self.to_image(pixels)
        to_source = np.column_stack([across - origin, down - origin, origin])
        crop = cv2.warpAffine(
            image, to_source, (size, size), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        )
        return cv2.cvtColor(crop, cv2.COLOR_BGR2RGB).astype(np.float32) / np.float32(255.0)


def region_of_palm(box: Floats[D4], points: Floats[D7, D2]) -> Region:
    """Return the hand's square from a palm's box (centre and size) and its seven points [px]."""
    turn = _turn_up(points[_PALM_MIDDLE] - points[_PALM_WRIST])
    up = _turning(turn) @ np.array([0.0, -_PALM_SHIFT * box[3]])
    return Region(box[:2] + up, _PALM_SIDE * float(box[2:].max()), turn)


def region_of_hand(points: Floats[D21, D2]) -> Region:
    """Return the hand's square from its 21 points [px]."""
    knuckles = ((points[_INDEX] + points[_RING]) / 2 + points[_MIDDLE]) / 2
    turn = _turn_up(knuckles - points[_WRIST])
    turning = _turning(turn)
    turned = points[list(_STEADY)] @ turning
    least, most = turned.min(axis=0), turned.max(axis=0)
    size = most - least
    centre = (least + most) / 2 - np.array([0.0, _HAND_SHIFT * size[1]])
    return Region(turning @ centre, _HAND_SIDE * float(size.max()), turn)


def _turn_up(direction: Floats[D2]) -> float:
    """Return the turn with which a direction in the image points up in the crop."""
    return float(np.pi / 2 - np.arctan2(-direction[1], direction[0]))


def _turning(turn: float) -> Floats[D2, D2]:
    cos, sin = np.cos(turn), np.sin(turn)
    return np.array([[cos, -sin], [sin, cos]])


PALM_SIZE = 192
"""of the network's image [px]"""
_GRIDS = ((24, 2), (12, 6))  # cells a side, anchors a cell
_LEAST_SCORE = 0.5
_WHOLE = 0.4  # of a square's side: the size of hands that are whole in one of several squares; the whole image shows larger ones
_OVERLAP = 0.3  # intersection over union, beyond which two boxes are of one palm
_MOST_LOGIT = 100.0


@lru_cache(maxsize=1)
def anchors() -> Floats[N, D2]:
    """Return the 2016 points of the unit square that the network's boxes are offset from: cells of two grids, row by row."""
    parts = []
    for cells, each in _GRIDS:
        middle = (np.arange(cells) + 0.5) / cells
        grid = np.stack(np.meshgrid(middle, middle), axis=-1).reshape(-1, 2)
        parts.append(np.repeat(grid, each, axis=0))
    return np.concatenate(parts)


def palms(
    numbers: Floats[N, K], logits: Floats[N], most: int
) -> list[tuple[Floats[D4], Floats[D7, D2]]]:
    """Return up to `most` palms in the unit square that the network saw, the surest first: each
    one's box (centre, width and height), and wrist, knuckles of index, middle, ring and little
    finger, the thumb's base and knuckle.

    Boxes that overlap are averaged, with their scores as weights, rather than dropped.

    Parameters
    ----------
    numbers
        For each anchor box and seven points (18), in pixels of the network's image.
    """
    scores = 1.0 / (1.0 + np.exp(-np.clip(logits.astype(float), -_MOST_LOGIT, _MOST_LOGIT)))
    sure = np.flatnonzero(scores > _LEAST_SCORE)
    scores, decoded = scores[sure], numbers[sure].astype(float) / PALM_SIZE
    offsets = anchors()[sure]
    decoded[:, :2] += offsets
    decoded[:, 4:] += np.tile(offsets, 7)
    found: list[tuple[Floats, Floats]] = []
    while len(scores) and len(found) < most:
        best = int(scores.argmax())
        same = overlaps(decoded[:, :4], decoded[best, :4]) > _OVERLAP
        same[best] = True
        mean = np.average(decoded[same], axis=0, weights=scores[same])
        found.append((mean[:4], mean[4:].reshape(7, 2)))
        scores, decoded = scores[~same], decoded[~same]
    return found


def overlaps(boxes: Floats[*Axes, D4], box: Floats[D4]) -> Floats[*Axes]:
    """Return intersection over union of boxes (centre, size) with one."""
    low = np.maximum(boxes[..., :2] - boxes[..., 2:] / 2, box[:2] - box[2:] / 2)
    high = np.minimum(boxes[..., :2] + boxes[..., 2:] / 2, box[:2] + box[2:] / 2)
    common = np.prod(np.maximum(high - low, 0.0), axis=-1)
    union = np.prod(boxes[..., 2:], axis=-1) + np.prod(box[2:]) - common
    return common / np.maximum(union, 1e-12)


_HAND_SIZE = 224  # of the landmark network's image [px]
_UNEXPECTED = (cv2.error, KeyError, ValueError, IndexError)
"""what networks of another shape lead to"""
_LEAST_PRESENCE = 0.5
_LEAST_SIDE = 8.0  # [px]: a smaller region shows nothing


@array_dataclass
class DetectedHand:
    """A hand in an image."""

    points: Floats[D21, D2]
    """column, row [px] as OpenCV counts: wrist, thumb CMC MCP IP tip, then of each finger MCP PIP DIP tip"""
    presence: float
    """probability that it is a hand"""
    right: float
    """probability that it is a right hand, in an image that is not mirrored"""

    @property
    def region(self) -> Region:
        """Where to look for it in the next frame."""
        return region_of_hand(self.points)


def _centres(length: int, side: float) -> Floats[N]:
    """Return where the centres of squares lie along an image's side that cover it, so close that a hand is whole in one of them [px]."""
    beyond = max(length - side, 0.0)
    count = int(np.ceil(beyond / ((1.0 - _WHOLE) * side))) + 1
    return (length - 1.0) / 2 + np.linspace(-beyond / 2, beyond / 2, count) * (count > 1)


class HandDetector:
    """The two networks. To be used by one thread at a time."""

    def __init__(self, weights: Weights, backend: str | None = None) -> None:
        """backend: opencv or litert; the quicker one that is there, unless given. Raises HandtrackError."""
        self.backend = backend or ("litert" if find_spec(_LITERT) else "opencv")
        self.weights = weights
        where = str(weights.path)
        self._palm = open_network(weights.palm, self.backend, where)
        self._landmarks = open_network(weights.landmarks, self.backend, where)

    @classmethod
    def open(cls, weights: Path | None = None, backend: str | None = None) -> HandDetector:
        """Return the detector with given, named or installed weights. Raises HandtrackError where there are none."""
        return cls(read_weights(find_weights(weights)), backend)

    def find(self, image: Array[H, W, D3], most: int, closely: bool = False) -> list[Region]:
        """Return where up to `most` hands may be, the surest first. image: uint8 BGR.

        closely: where the whole image shows none, squares half as large are searched, too; regions then come square by square, and one hand
        may be in several.
        """
        height, width = image.shape[:2]
        side = float(max(width, height))
        middle = np.array([width - 1.0, height - 1.0]) / 2
        found = self._palms_in(image, Region(middle, side, 0.0), most)
        if found or not closely:
            return found
        side *= 0.5
        across, down = (_centres(length, side) for length in (width, height))
        squares = [Region(np.array([x, y]), side, 0.0) for y in down for x in across]
        return [region for square in squares for region in self._palms_in(image, square, most)]

    def _palms_in(self, image: Array[H, W, D3], square: Region, most: int) -> list[Region]:
        try:
            out = self._palm(square.crop(image, PALM_SIZE))
            numbers, logits = out["Identity"].reshape(-1, 18), out["Identity_1"].reshape(-1)
            found = palms(numbers, logits, most)
        except _UNEXPECTED:
            raise self._unexpected("palm") from None
        return [
            region_of_palm(
                np.concatenate([square.to_image(box[:2]), box[2:] * square.side]),
                square.to_image(points),
            )
            for box, points in found
        ]

    def hand(self, image: Array[H, W, D3], region: Region) -> DetectedHand | None:
        """Return the hand in a region of an image uint8 BGR, None where there is none."""
        if not (np.isfinite(region.centre).all() and region.side >= _LEAST_SIDE):
            return None
        try:
            out = self._landmarks(region.crop(image, _HAND_SIZE))
            found = out["Identity"].reshape(21, 3)[:, :2].astype(float)
            presence, right = (float(out[f"Identity_{i}"].reshape(())) for i in (1, 2))
        except _UNEXPECTED:
            raise self._unexpected("landmark") from None
        if not (presence >= _LEAST_PRESENCE and np.isfinite(found).all()):
            return None
        return DetectedHand(region.to_image(found / _HAND_SIZE), presence, right)

    def _unexpected(self, network: str) -> HandtrackError:
        return HandtrackError(
            f"{self.weights.path}: the {network} network answers in another form than expected; these are weights of another "
            "detector. Name Google's hand_landmarker.task with --weights."
        )


# ---- The hands of one view from frame to frame: each is looked for where it was, and anew where none is left


_LOOK_EVERY = 10  # images between looks for hands that are not followed: a tenth more work
_CLOSELY_EVERY = 10  # looks between those that are close, which take eight times as long
_MOST = 2  # hands of one person
_SAME = 0.15  # of the region's side: hands whose points are nearer in the median are one


class HandFollower:
    """Follows up to two hands in the images of one view; each has a number for as long as it is followed."""

    def __init__(self, detector: HandDetector) -> None:
        self._detector = detector
        self._hands: dict[int, DetectedHand] = {}
        self._next_number = 0
        self._since_look = 0
        self._looks = 0

    def step(self, image: Array[H, W, D3] | None) -> dict[int, DetectedHand]:
        """Return the hands in the next image uint8 BGR, by their numbers; none in a missing one, after which they are
        looked for where they were.
        """
        if image is None:
            return {}
        before, self._hands = self._hands, {}
        for number, last in before.items():
            self._take(number, self._detector.hand(image, last.region))
        self._since_look += 1
        if not self._hands or (self._since_look >= _LOOK_EVERY and len(self._hands) < _MOST):
            self._look(image)
        return dict(self._hands)

    def look_in(self, image: Array[H, W, D3], region: Region) -> dict[int, DetectedHand]:
        """Look for one more hand in a region of the image of the last step, and return all hands in it."""
        if len(self._hands) < _MOST:
            hand = self._detector.hand(image, region)
            self._next_number += self._take(self._next_number, hand)
        return dict(self._hands)

    def _look(self, image: Array[H, W, D3]) -> None:
        closely = self._looks % _CLOSELY_EVERY == 0
        self._since_look, self._looks = 0, self._looks + 1
        for region in self._detector.find(image, _MOST, closely):
            self.look_in(image, region)

    def _take(self, number: int, hand: DetectedHand | None) -> bool:
        """Keep a hand, unless it is one that is followed already."""
        if hand is None or any(_same(hand, other) for other in self._hands.values()):
            return False
        self._hands[number] = hand
        return True


def _same(hand: DetectedHand, other: DetectedHand) -> bool:
    apart = np.linalg.norm(hand.points - other.points, axis=1)
    return float(np.median(apart)) < _SAME * other.region.side


# ---- Which of the hands seen is ours: by its side, and by lying in all views on one another's epipolar lines


_AGREE = 0.1  # of the hand's square: pixels by which one hand may miss its epipolar lines, hidden fingers and time included
_LEAST_SHOWN = 0.5  # of a hand's points, to look for it: the network guesses the rest
_MOST_LOG_ODDS = 4.6  # of a side: no view is surer than 99 %


class HandObservation(NamedTuple):
    """A hand in one view of one frame."""

    camera: Camera
    hand: DetectedHand
    log_odds: float
    """that it is of the side asked for"""


def log_odds(right: float, side: str) -> float:
    """Return the log-odds of a side, right or left, from the probability of a right hand; bounded."""
    share = np.clip(right if side == "right" else 1.0 - right, 1e-9, 1.0 - 1e-9)
    return float(np.clip(np.log(share / (1.0 - share)), -_MOST_LOG_ODDS, _MOST_LOG_ODDS))


def our_hands(seen: Mapping[str, list[HandObservation]]) -> dict[str, HandObservation]:
    """Return by view the hand that is ours, as far as there is one.

    Each hand is tried: from every other view joins the one nearest to its epipolar lines, if near enough. The hand with the
    highest log-odds of our side over all views is ours, unless they are against it.
    """
    best: dict[str, HandObservation] = {}
    highest = 0.0
    for name, hands in seen.items():
        for hand in hands:
            joined = {name: hand} | {
                other: near
                for other, theirs in seen.items()
                if other != name and (near := _nearest(hand, theirs)) is not None
            }
            total = sum(one.log_odds for one in joined.values())
            if total > highest:
                best, highest = joined, total
    return best


def region_by_others(camera: Camera, ours: Sequence[HandObservation]) -> Region | None:
    """Return where a camera must show the hand that others see; None where fewer than two do, or where most of it is out of the image.

    The network of palms overlooks many that the network of points finds: of a marked real hand it saw a third in one camera, this
    one all.
    """
    if len(ours) < 2:
        return None
    pixels = np.array([one.hand.points for one in ours])
    points = camera.project(triangulated([one.camera for one in ours], pixels))
    shown = ((points > -0.5) & (points < np.array(camera.size) - 0.5)).all(axis=1)
    return region_of_hand(points) if shown.mean() >= _LEAST_SHOWN else None


def _nearest(hand: HandObservation, others: list[HandObservation]) -> HandObservation | None:
    misses = [(epipolar_miss(hand, other), i) for i, other in enumerate(others)]
    miss, nearest = min(misses, default=(np.inf, -1))
    return others[nearest] if miss < _AGREE else None


def epipolar_miss(one: HandObservation, other: HandObservation) -> float:
    """Return by how much of their squares two views' hands miss one another's epipolar lines, in the median of the points."""
    a, b = (seen.camera.undistort_points(seen.hand.points) for seen in (one, other))
    there = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    if not there.any():
        return float("inf")
    fundamental = _fundamental(one.camera, other.camera)
    in_other = _to_lines(b[there], a[there], fundamental) / other.hand.region.side
    in_one = _to_lines(a[there], b[there], fundamental.T) / one.hand.region.side
    return float(np.median((in_one + in_other) / 2))


def _to_lines(
    points: Floats[K, D2], theirs: Floats[K, D2], fundamental: Floats[D3, D3]
) -> Floats[K]:
    """Return distances [px] of points from the lines that points of the other image lie on."""
    lines = cv2.computeCorrespondEpilines(theirs, 1, fundamental)[:, 0]
    return np.abs((points * lines[:, :2]).sum(axis=1) + lines[:, 2])


def _fundamental(a: Camera, b: Camera) -> Floats[D3, D3]:
    """Return F with x_bᵀ F x_a = 0 for pixels of the two undistorted cameras."""
    rotation = b.rotation @ a.rotation.T
    cross = skew(b.translation - rotation @ a.translation)
    return np.linalg.inv(b.matrix).T @ cross @ rotation @ np.linalg.inv(a.matrix)
