"""2D joints of one camera as somebody's file gives them: hands by side and frame."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from handtrack.arrays import D2, D3, D21, Floats, N
from handtrack.capture.images.openpose import LAYOUTS, write_points
from handtrack.capture.joints.body_points import GivenBodies
from handtrack.capture.joints.joint_names import JOINTS, known_joint
from handtrack.errors import HandtrackError

LARGEST = 1 << 29  # bytes of one file: hours
_LAST_FRAME = 10_000_000
Hand = Floats[D21, D3]
"""column and row [px], confidence 0 to 1; NaN and 0 where a point is missing"""


class UnknownPoints(HandtrackError):
    """Points by names that say neither a hand's joints nor a body's."""

    def __init__(self, message: str, names: tuple[str, ...]) -> None:
        super().__init__(message)
        self.names = names


@dataclass(frozen=True)
class GivenJoints:
    """What a file says."""

    family: str
    hands: Mapping[str, Mapping[int, Hand]]
    """by side (right, left, or empty where nothing says it), then by frame."""
    is_share: bool = False
    """whether columns and rows are shares of the image, 0 to 1 from edge to edge."""
    layout: str | None = None
    """the session's keypoint_layout; None: hand_left or hand_right."""
    unknown: tuple[str, ...] = ()
    """names of points that are none of a hand's 21."""
    notes: tuple[str, ...] = field(default=())
    bodies: GivenBodies | None = None

    @property
    def has_hand(self) -> bool:
        """Whether a hand is in some frame."""
        return any(self.hands.values())

    def hand(self, side: str | None, where: str) -> tuple[str, Mapping[int, Hand]]:
        """Return the side and the frames of the hand asked for; where nothing is asked for, of the one that is there.

        Raises HandtrackError where there are two, or not that one.
        """
        there = {name: frames for name, frames in self.hands.items() if frames}
        if not there:
            raise HandtrackError(f"{where}: no hand in any frame.")
        if side is None and len(there) > 1:
            raise HandtrackError(
                f"{where}: two hands, {' and '.join(map(str, there))}; say which with --side."
            )
        chosen = next(iter(there)) if side is None or side not in there else side
        if side is not None and chosen not in (side, ""):
            raise HandtrackError(f"{where}: no {side} hand; there is a {chosen} one.")
        return chosen, there[chosen]


def hand_of(names: Sequence[str], points: Floats[N, D2], confidence: Floats[N]) -> Hand:
    """Return 21 points from some, by our names. points: column, row [px]."""
    hand = np.full((len(JOINTS), 3), np.nan)
    hand[:, 2] = 0.0
    for name, place, sure in zip(names, points, confidence, strict=True):
        if np.isfinite(place).all() and sure > 0:
            hand[JOINTS.index(name)] = (*place, min(float(sure), 1.0))
    return hand


def named_points(
    names: Iterable[str], where: str
) -> tuple[dict[str, dict[int, str]], tuple[str, ...]]:
    """Return by side which of a file's points are which of our joints, and the names of all others.

    Raises HandtrackError where hardly any is known, and where two are the same.
    """
    sides: dict[str, dict[int, str]] = {}
    unknown = list[str]()
    every = list(names)
    for i, name in enumerate(every):
        known = known_joint(name)
        if known is None:
            unknown.append(name)
            continue
        taken = sides.setdefault(known[1], {})
        if known[0] in taken.values():
            other = next(every[k] for k, joint in taken.items() if joint == known[0])
            raise HandtrackError(
                f"{where}: '{other}' and '{name}' are both {known[0]}; rename one of them."
            )
        taken[i] = known[0]
    if not any(len(taken) >= 3 for taken in sides.values()):
        raise UnknownPoints(
            f"{where}: its points ({', '.join(every[:8])}, …) are no hand's; expected names such as {', '.join(JOINTS[:3])}, "
            f"index_mcp, or the numbers 0 to 20 in OpenPose's order. A table can say which of them are which.",
            tuple(every),
        )
    return sides, tuple(unknown)


def frame_of(value: float, where: str) -> int:
    """Return a frame number. Raises HandtrackError for what is none."""
    if not (np.isfinite(value) and value == int(value) and 0 <= value < _LAST_FRAME):
        raise HandtrackError(f"{where}: frame {value:g}; expected a whole number from 0.")
    return int(value)


def in_pixels(hand: Floats[N, D3], size: tuple[int, int]) -> Floats[N, D3]:
    """Return points given as shares of an image, from edge to edge, in pixels, which count from the first one's centre.

    size: width, height [px].
    """
    points = hand.copy()
    points[:, :2] = points[:, :2] * size - 0.5
    return points


def write_joints(frames: Mapping[int, Floats[N, D3]], layout: str, folder: Path) -> None:
    """Write a file a frame, as a session reads them by a `keypoint_layout`, to a new folder. frames: in pixels."""
    folder.mkdir(parents=True)
    for frame, points in frames.items():
        path = folder / f"{frame:06d}.json"
        write_points(path, np.nan_to_num(points), LAYOUTS[layout], "handtrack new")
