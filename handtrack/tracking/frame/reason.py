"""How far a frame can be trusted, and why it is doubtful or lost: kind, place and numbers, and the one place where they become words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

NEAR_M = 0.006
"""a cloud's point this near to the surface was measured on it: three times the usual error of a point"""
SMALLEST_HAND_MM, LARGEST_HAND_MM = 100.0, 225.0
"""from wrist to middle fingertip, of a child of two (Snyder et al. 1977) and of men: 3 standard deviations above the mean of 4,082 of
them, 193 ± 10 (ANSUR II, Gordon et al. 2014)"""
SMALLEST_ADULT_MM = 151.0
"""3 standard deviations below the mean of women, 181 ± 10 mm (ANSUR II): a shorter hand is a child's"""
NEAR_SIGMAS = 4.0
"""a keypoint this near is where it was seen; twice that a normal error rarely is, for detectors err more often"""


class Status(IntEnum):
    """How far a frame's pose can be trusted, and where it comes from."""

    TRACKED = 0
    DOUBTFUL = 1
    LOST = 2
    KEYFRAME = 3


@dataclass(frozen=True)
class Reason:
    """Why a frame is not simply tracked."""

    kind: str
    """one of KINDS"""
    part: str = ""
    """of the model, in words; for a poor cloud the simpler model that took the hand's place, if one did"""
    camera: str = ""
    """its name; of `off` the sign that tells most, one of SIGNS"""
    number: float = float("nan")
    """what was measured: a share, a ratio, or millimetres, as the kind says"""
    other: float = float("nan")
    """a second number: how many, or a second share"""

    @property
    def words(self) -> str:
        """The reason in a clause, without a full stop."""
        return KINDS[self.kind](self)

    @property
    def brief(self) -> str:
        """The reason in a few words and a number, for lists."""
        return BRIEF[self.kind](self)


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _poor_cloud(reason: Reason) -> str:
    text = (
        f"poor cloud: {_percent(reason.number)} of the hand in view was measured, "
        f"{_percent(reason.other)} of the points lie on it"
    )
    if not reason.part:
        return text
    return f"{text}; the palm alone is estimated ({reason.part}), the fingers are held"


def _odd_size(reason: Reason) -> str:
    if reason.part:
        size = f"its {reason.part} is {reason.number:.2f} times as long as usual for its length"
        causes = "masks may miss it where it is shaded or curled;"
    else:
        size = f"{reason.number:.0f} mm from wrist to fingertip, not {SMALLEST_HAND_MM:g} to {LARGEST_HAND_MM:g}"
        causes = "the unit,"
    return f"implausible hand size: {size}; {causes} lens coefficients or camera poses may be wrong"


SIGNS = {
    "open": "the observations do not constrain it",
    "curled": "closed fingers occlude each other",
    "moved": "later frames moved it",
}
"""why a pose may be wrong, in words: the sign stands in the place of a camera's name"""

KINDS: dict[str, Callable[[Reason], str]] = {
    "unseen": lambda r: "no camera has an observation of this frame",
    "cloud elsewhere": lambda r: (
        f"the cloud has hardly any points within {r.number:g} mm of where the hand was expected"
    ),
    "given": lambda r: "input pose; its texture is carried from here on",
    "given keypoints": lambda r: "no observation; only the input keypoints constrain the pose",
    "out of view": lambda r: "model and silhouette are outside all views",
    "overlap": lambda r: f"model and silhouette overlap by {_percent(r.number)} in {r.camera}",
    "filled mask": lambda r: (
        f"the mask covers more than half of the image in {r.camera}: is it inverted or all white?"
    ),
    "part outside": lambda r: (
        f"{_percent(r.number)} of the {r.part} and the bone before it lie outside the silhouette in {r.camera}"
    ),
    "beside": lambda r: (
        f"{r.number:.0f} mm² of the silhouette in {r.camera} are not covered by the model, a fingertip or more; "
        f"the lowest overlap is {_percent(r.other)}"
    ),
    "start": lambda r: (
        f"it fits, but the first pose had a confidence of {_percent(r.number)}, and too few consecutive frames have confirmed it"
    ),
    "keypoints": lambda r: (
        f"{_percent(r.number)} of {r.other:.0f} keypoints lie within {NEAR_SIGMAS:g} sigma of the model"
    ),
    "cloud": lambda r: (
        f"{_percent(r.number)} of the cloud's points lie within {1e3 * NEAR_M:g} mm of the model"
    ),
    "poor cloud": _poor_cloud,
    "energy": lambda r: f"the residual is {r.number:.1f} times the usual one; a finger may be lost",
    "size": _odd_size,
    "off": lambda r: (
        f"the {r.part} may be wrong, ± {r.number:.0f} mm (P = {r.other:.2f} that a joint's error exceeds 25 mm): "
        f"{SIGNS.get(r.camera, SIGNS['open'])}"
    ),
    "far off": lambda r: (
        f"the {r.part} may be wrong, ± {r.number:.0f} mm (P = {r.other:.2f} that its error exceeds 230 mm): "
        "the observations do not constrain it"
    ),
    "other way": lambda r: (
        f"an alternative trajectory ({_percent(r.number)} probable) has the {r.part} {r.other:.0f} mm away"
    ),
    "open": lambda r: f"the observations do not constrain the {r.part}: ± {r.number:.0f} mm",
}
"""what each kind says; the only place where low confidence is worded"""

BRIEF: dict[str, Callable[[Reason], str]] = {
    "unseen": lambda r: "no observation",
    "cloud elsewhere": lambda r: "cloud elsewhere",
    "given": lambda r: "input pose",
    "given keypoints": lambda r: "input keypoints alone",
    "out of view": lambda r: "out of view",
    "overlap": lambda r: f"{r.camera} overlap {r.number:.2f}",
    "filled mask": lambda r: f"{r.camera}'s mask fills the image",
    "part outside": lambda r: f"{r.part}, {_percent(r.number)} outside in {r.camera}",
    "beside": lambda r: f"{r.number:.0f} mm² of {r.camera} uncovered",
    "start": lambda r: f"first pose, confidence {_percent(r.number)}",
    "keypoints": lambda r: f"{_percent(r.number)} of keypoints near",
    "cloud": lambda r: f"{_percent(r.number)} of the cloud near",
    "poor cloud": lambda r: f"poor cloud, {_percent(r.number)} measured",
    "energy": lambda r: f"residual {r.number:.1f} times the usual",
    "size": lambda r: f"implausible {r.part or 'hand length'}",
    "off": lambda r: f"{r.part}, P(error > 25 mm) {r.other:.2f}, ± {r.number:.0f} mm",
    "far off": lambda r: f"{r.part}, P(error > 230 mm) {r.other:.2f}, ± {r.number:.0f} mm",
    "other way": lambda r: f"{r.part}, alternative {r.other:.0f} mm away, {_percent(r.number)}",
    "open": lambda r: f"{r.part} unconstrained, ± {r.number:.0f} mm",
}
"""the same in a few words"""
