"""How probable it is that a pose is wrong: the tail of what is stated, and a gross error that no covariance knows of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D3, Axes, Floats, J, K
from handtrack.model.articulated import FINGERS, ArticulatedModel
from handtrack.tracking.frame.constants import BODY_BY_HAND
from handtrack.tracking.frame.doubt import figures
from handtrack.tracking.frame.result import PARTS

FRAME_OFF_M = 0.025
_OPEN_M, _CLOSED, _MOVED_M = 0.003, 0.1, 0.005
BODY_OFF_M = BODY_BY_HAND * FRAME_OFF_M


@dataclass(frozen=True)
class Signs:
    """What of a solved frame tells that it may be wrong: each is 0 where nothing does, and grows."""

    curled: float = 0.0
    """how far the fingers are closed, 0 … 1, on average: those whose joints no two cameras confirm"""
    moved: float = 0.0
    """`moved_sign`"""
    open: float = 0.0
    """`open_sign`, if the model were the hand"""


@dataclass(frozen=True)
class Off:
    """How probably a frame is wrong."""

    frame: float
    """that some joint is more than 25 mm off, beside the constant offset of another definition"""
    parts: Floats[K]
    """(6,) that some joint of each of PARTS is so more than 10 mm off"""
    telling: str
    """the sign that says most of it, or `open`: what was seen itself"""


def probably_off(model: ArticulatedModel, joint_covariance: Floats[J, D3, D3], signs: Signs) -> Off:
    """Return the probabilities of a hand's frame. joint_covariance: as stated [m²]."""
    added = {name: weight * getattr(signs, name) for name, weight in figures.SIGNS.items()}
    gross = float(_logistic(np.array(figures.ALWAYS + sum(added.values()))))
    tail = float(probably_beyond(joint_covariance, FRAME_OFF_M).max())
    part, spread = np.array([part_of(n) for n in model.joint_names]), spread_m(joint_covariance)
    least = np.array([spread[part == p].max() if (part == p).any() else 0.0 for p in PARTS])
    always, by_spread = figures.PART
    parts = _logistic(always + by_spread * np.log(np.maximum(least / _OPEN_M, _CLOSED)))
    telling = "open" if tail > gross else max(added, key=lambda name: added[name])
    return Off(1 - (1 - tail) * (1 - gross), parts, telling)


def moved_sign(moved_m: float) -> float:
    """Return the logarithm of how far the frames after moved a joint, in units of 5 mm; 0 below."""
    return float(np.log(max(moved_m / _MOVED_M, 1.0)))


def open_sign(joint_covariance: Floats[J, D3, D3]) -> float:
    """Return the logarithm of the largest of joints' standard deviations, in units of 3 mm; 0 below. joint_covariance: [m²]."""
    return float(np.log(max(spread_m(joint_covariance).max() / _OPEN_M, 1.0)))


def part_of(joint: str) -> str:
    """Return which of PARTS a joint belongs to: palm, or its finger beyond the base."""
    finger, _, place = joint.partition("_")
    return (
        finger
        if (finger in FINGERS and place not in ("cmc", "mcp")) or joint == "thumb_mcp"
        else "palm"
    )


def _logistic(odds: Floats[*Axes]) -> Floats[*Axes]:
    return 1.0 / (1.0 + np.exp(-odds))


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
