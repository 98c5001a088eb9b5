"""How far a frame can be trusted, and why it is doubtful or lost: kind, place and numbers, and the one place where they become words."""

from __future__ import annotations

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

    @property
    def words(self) -> str:
        """As people read it; files have `doubtful`."""
        return "low confidence" if self == Status.DOUBTFUL else self.name.lower()


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
        return self._filled(KINDS[self.kind][0])

    @property
    def brief(self) -> str:
        """The reason in a few words and a number, for lists."""
        return self._filled(KINDS[self.kind][1])

    def _filled(self, text: str) -> str:
        """Return one of the texts of KINDS with what it says in braces."""
        share, other_share = (f"{100 * value:.0f} %" for value in (self.number, self.other))
        held = f"; the palm alone is estimated ({self.part}), the fingers are held"
        odd_length = f"{self.number:.0f} mm from wrist to fingertip, not {SMALLEST_HAND_MM:g} to {LARGEST_HAND_MM:g}; the unit,"
        odd_part = f"its {self.part} is {self.number:.2f} times as long as usual for its length; masks may miss it where it is shaded or curled;"
        return text.format(
            **vars(self),
            share=share,
            other_share=other_share,
            held=held if self.part else "",
            length=self.part or "hand length",
            size=odd_part if self.part else odd_length,
            sign=SIGNS.get(self.camera, SIGNS["open"]),
        )


SIGNS = {
    "open": "the observations do not constrain it",
    "moved": "later frames moved it",
    "free": "a finger fits elsewhere about as well",
}
"""why a pose may be wrong, in words: the sign stands in the place of a camera's name"""

KINDS: dict[str, tuple[str, str]] = {
    "unseen": ("no camera has an observation of this frame", "no observation"),
    "cloud elsewhere": (
        "the cloud has hardly any points within {number:g} mm of where the hand was expected",
        "cloud elsewhere",
    ),
    "given": ("input pose; its texture is carried from here on", "input pose"),
    "given keypoints": (
        "no observation; only what was set by hand constrains the pose",
        "set by hand alone",
    ),
    "out of view": ("model and silhouette are outside all views", "out of view"),
    "overlap": (
        "model and silhouette overlap by {share} in {camera}",
        "{camera} overlap {number:.2f}",
    ),
    "filled mask": (
        "the mask covers more than half of the image in {camera}; it may be inverted or all white",
        "{camera}'s mask fills the image",
    ),
    "part outside": (
        "{share} of the {part} and the bone before it lie outside the silhouette in {camera}",
        "{part}, {share} outside in {camera}",
    ),
    "beside": (
        "{number:.0f} mm² of the silhouette in {camera} are not covered by the model, a fingertip or more; the lowest overlap is "
        "{other_share}",
        "{number:.0f} mm² of {camera} uncovered",
    ),
    "start": (
        "it fits, but the first pose had a confidence of {share}, and too few consecutive frames have confirmed it",
        "first pose, confidence {share}",
    ),
    "keypoints": (
        f"{{share}} of {{other:.0f}} keypoints lie within {NEAR_SIGMAS:g} sigma of the model",
        "{share} of keypoints fit",
    ),
    "cloud": (
        f"{{share}} of the cloud's points lie within {1e3 * NEAR_M:g} mm of the model",
        "{share} of the cloud fits",
    ),
    "poor cloud": (
        "poor cloud: {share} of the hand in view was measured, {other_share} of the points lie on it{held}",
        "poor cloud, {share} measured",
    ),
    "energy": (
        "the residual is {number:.1f} times the usual one; a finger may be lost",
        "residual {number:.1f} times the usual",
    ),
    "size": (
        "implausible hand size: {size} lens coefficients or camera poses may be wrong",
        "implausible {length}",
    ),
    "off": (
        "the {part} may be wrong, ± {number:.0f} mm (P = {other:.2f} that a joint's error exceeds 25 mm): {sign}",
        "{part}, P(error > 25 mm) {other:.2f}, ± {number:.0f} mm",
    ),
    "far off": (
        "the {part} may be wrong, ± {number:.0f} mm (P = {other:.2f} that its error exceeds 230 mm): the observations do not constrain "
        "it",
        "{part}, P(error > 230 mm) {other:.2f}, ± {number:.0f} mm",
    ),
    "other way": (
        "an alternative trajectory ({share} probable) has the {part} {other:.0f} mm away",
        "{part}, alternative {other:.0f} mm away, {share}",
    ),
    "open": (
        "the observations do not constrain the {part}: ± {number:.0f} mm",
        "{part} unconstrained, ± {number:.0f} mm",
    ),
}
"""what each kind says, and the same in a few words; the only place where low confidence is worded"""
