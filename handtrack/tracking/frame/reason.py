"""Why a frame is doubtful or lost: kind, place and numbers, and the one place where they become words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

NEAR_M = 0.006
"""a cloud's point this near to the surface was measured on it: three times the usual error of a point"""
SMALLEST_HAND_MM, LARGEST_HAND_MM = 100.0, 225.0
"""from wrist to middle fingertip, of a child of two (Snyder et al. 1977) and of men: 3 standard deviations above the mean of 4,082 of
them, 193 ± 10 (ANSUR II, Gordon et al. 2014)"""
SMALLEST_ADULT_MM = 151.0
"""3 standard deviations below the mean of women, 181 ± 10 mm (ANSUR II): a shorter hand is a child's"""
NEAR_SIGMAS = 4.0
"""a keypoint this near is where it was seen; twice that a normal error rarely is, for detectors err more often"""


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
        causes = "masks may lack it where it is shaded or curled, or"
    else:
        size = f"{reason.number:.0f} mm from wrist to fingertip, not {SMALLEST_HAND_MM:g} to {LARGEST_HAND_MM:g}"
        causes = "unit,"
    return f"nobody has such a hand: {size}; {causes} lenses (was a coefficient lost?) or the cameras' places may be wrong"


SIGNS = {
    "open": "what was seen leaves it open",
    "curled": "closed fingers hide each other",
    "moved": "the frames after moved it",
}
"""what tells that a pose may be wrong, in words: the telling sign stands in the place of a camera's name"""

KINDS: dict[str, Callable[[Reason], str]] = {
    "unseen": lambda r: "no camera saw anything in this frame",
    "cloud elsewhere": lambda r: (
        f"the cloud has hardly any points within {r.number:g} mm of where the hand was expected"
    ),
    "given": lambda r: "the pose is the given one; its texture is carried from here on",
    "given keypoints": lambda r: "nothing was seen; only given keypoints hold the pose",
    "out of view": lambda r: "neither model nor silhouette is in any view",
    "overlap": lambda r: (
        f"model and silhouette overlap by {_percent(r.number)} in {r.camera}"
    ),
    "filled mask": lambda r: (
        f"more than half of the image is hand in {r.camera}: is the mask inverted, or white all over?"
    ),
    "part outside": lambda r: (
        f"{_percent(r.number)} of the {r.part} and the bone before it lie outside the silhouette in {r.camera}"
    ),
    "beside": lambda r: (
        f"a piece of {r.number:.0f} mm² of the silhouette in {r.camera} lies beside the model, as large as a finger's end or larger, "
        f"though they overlap by {_percent(r.other)} where least"
    ),
    "start": lambda r: (
        f"it fits, but tracking began with a pose that was {_percent(r.number)} sure, and too few frames in a row have confirmed it"
    ),
    "keypoints": lambda r: (
        f"{_percent(r.number)} of {r.other:.0f} keypoints lie within {NEAR_SIGMAS:g} sigma of the model"
    ),
    "cloud": lambda r: (
        f"{_percent(r.number)} of the cloud's points lie within {1e3 * NEAR_M:g} mm of the model"
    ),
    "poor cloud": _poor_cloud,
    "energy": lambda r: (
        f"the model fits {r.number:.1f} times worse than usual; a finger may be lost"
    ),
    "size": _odd_size,
    "off": lambda r: (
        f"the {r.part} may be off, ± {r.number:.0f} mm by what is stated (P = {r.other:.2f} that a joint is 25 mm off): "
        f"{SIGNS.get(r.camera, SIGNS['open'])}"
    ),
    "far off": lambda r: (
        f"the {r.part} may be off, ± {r.number:.0f} mm by what is stated (P = {r.other:.2f} that it is 230 mm off): what was seen "
        "leaves it open"
    ),
    "other way": lambda r: (
        f"by another way through the recording, {_percent(r.number)} probable, its {r.part} is {r.other:.0f} mm away"
    ),
    "open": lambda r: f"what was seen leaves the {r.part} open: ± {r.number:.0f} mm",
}  # fmt: skip
"""what each kind says; the only place where a doubt is worded"""

BRIEF: dict[str, Callable[[Reason], str]] = {
    "unseen": lambda r: "not seen",
    "cloud elsewhere": lambda r: "cloud elsewhere",
    "given": lambda r: "the pose given",
    "given keypoints": lambda r: "held by given keypoints alone",
    "out of view": lambda r: "out of view",
    "overlap": lambda r: f"{r.camera} overlap {r.number:.2f}",
    "filled mask": lambda r: f"{r.camera}'s mask fills the image",
    "part outside": lambda r: f"{r.part}, {_percent(r.number)} outside in {r.camera}",
    "beside": lambda r: f"{r.number:.0f} mm² of {r.camera} beside the model",
    "start": lambda r: f"first pose {_percent(r.number)} sure",
    "keypoints": lambda r: f"{_percent(r.number)} of keypoints near",
    "cloud": lambda r: f"{_percent(r.number)} of the cloud near",
    "poor cloud": lambda r: f"poor cloud, {_percent(r.number)} measured",
    "energy": lambda r: f"fits {r.number:.1f} times worse than usual",
    "size": lambda r: f"odd {r.part or 'length of hand'}",
    "off": lambda r: f"{r.part}, P {r.other:.2f} off, ± {r.number:.0f} mm",
    "far off": lambda r: f"{r.part}, P {r.other:.2f} far off, ± {r.number:.0f} mm",
    "other way": lambda r: f"{r.part}, {_percent(r.number)} for {r.other:.0f} mm away",
    "open": lambda r: f"{r.part} open, ± {r.number:.0f} mm",
}
"""the same in a few words"""
