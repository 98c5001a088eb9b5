"""How probable it is that a pose is wrong: the tail of what is stated, and a gross error that no covariance knows of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D3, Floats, J, K
from handtrack.model.articulated import FINGERS, ArticulatedModel
from handtrack.tracking.frame.constants import BODY_BY_HAND
from handtrack.tracking.frame.doubt import figures
from handtrack.tracking.frame.result import PARTS

FRAME_OFF_M, PART_OFF_M = 0.025, 0.010
BODY_OFF_M = BODY_BY_HAND * FRAME_OFF_M


@dataclass(frozen=True)
class Signs:
    """What of a solved frame tells that it may be wrong: each is 0 where nothing does, and grows."""

    outline: float = 0.0
    """1 − intersection over union of model and mask in the worst view"""
    few: float = 0.0
    """1 / number of views"""
    open: float = 0.0
    """logarithm of the least sure joint's stated standard deviation, in units of 3 mm; 0 below"""
    curled: float = 0.0
    """how far the fingers are closed, 0 … 1, on average"""
    moved: float = 0.0
    """logarithm of how far the frames after moved a joint, in units of 5 mm; 0 below"""


@dataclass(frozen=True)
class Off:
    """How probably a frame is wrong."""

    frame: float
    """that some joint is more than 25 mm off"""
    parts: Floats[K]
    """(6,) that some joint of each of PARTS is more than 10 mm off"""
    telling: str
    """the sign that says most of it"""


def probably_off(model: ArticulatedModel, joint_covariance: Floats[J, D3, D3], signs: Signs) -> Off:
    """Return the probabilities of a hand's frame. joint_covariance: as stated [m²]."""
    odds, telling = gross_odds(signs)
    part = np.array([part_of(name) for name in model.joint_names])
    own = [part == name for name in PARTS]
    tail = probably_beyond(joint_covariance, FRAME_OFF_M).max()
    near = np.array(
        [probably_beyond(joint_covariance[p], PART_OFF_M).max() if p.any() else 0.0 for p in own]
    )
    always, frame = figures.PART
    gross = _logistic(always + frame * odds)
    return Off(float(1 - (1 - tail) * (1 - _logistic(odds))), 1 - (1 - near) * (1 - gross), telling)


def gross_odds(signs: Signs) -> tuple[float, str]:
    """Return the logarithm of the odds of an error that no covariance knows of, and the sign that says most of it."""
    parts = {name: weight * getattr(signs, name) for name, weight in figures.SIGNS.items()}
    return figures.ALWAYS + sum(parts.values()), max(parts, key=lambda name: parts[name])


def part_of(joint: str) -> str:
    """Return which of PARTS a joint belongs to: palm, or its finger beyond the base."""
    finger, _, place = joint.partition("_")
    return (
        finger
        if (finger in FINGERS and place not in ("cmc", "mcp")) or joint == "thumb_mcp"
        else "palm"
    )


def _logistic(odds: float) -> float:
    return float(1.0 / (1.0 + np.exp(-odds)))


def spread_m(covariance: Floats[J, D3, D3]) -> Floats[J]:
    """Return each joint's standard deviation [m], of its place in space."""
    return np.sqrt(np.trace(covariance, axis1=1, axis2=2))


def probably_beyond(covariance: Floats[J, D3, D3], off_m: float) -> Floats[J]:
    """Return how probably each joint's normal error is longer than that: χ² of the same mean and variance (Satterthwaite 1946)."""
    from scipy.special import gammaincc  # slow to import

    trace = np.trace(covariance, axis1=1, axis2=2)
    square = np.einsum("jab,jab->j", covariance, covariance)
    scale, freedom = square / trace, trace**2 / square
    return gammaincc(0.5 * freedom, 0.5 * off_m**2 / scale)
