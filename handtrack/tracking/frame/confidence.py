"""How far a solved frame can be trusted: its joints' calibrated covariance, its failure probability, its status and the reason.

The numbers are fitted to tracked hands of other people, none of one recording, by `python -m tests.experiments.honesty.confidence`:
docs/explanation/uncertainty.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from handtrack.arrays import D3, Array, Axes, Floats, J, K, P, S, array_dataclass
from handtrack.model.articulated import FINGERS, ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.size import is_unmeasured
from handtrack.observation.observation import ImageKeypoints
from handtrack.tracking.frame.assessment import assess, odd_size, what_is_open
from handtrack.tracking.frame.constants import BODY_BY_HAND
from handtrack.tracking.frame.depth_flips import mirrored_covariance
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.frame.reason import NEAR_SIGMAS, Reason
from handtrack.tracking.frame.result import PARTS, FrameResult, Status

USUAL_PER_VIEW = 15.0
"""energy a view of what was seen at which a model fits about as well as its noise says: half a hand's outline off by one sigma"""
LEAST_MISFIT, MOST_MISFIT = 0.3, 2.0
"""exact masks of the very model have 0.4 to 0.5, other hands' 1.1 to 2.1; ragged ones 3, of which no joint is the worse"""


@dataclass(frozen=True)
class Calibration:
    """What is wrong with joints that one kind of evidence found, at a misfit of 1."""

    noise: float
    """factor on standard deviations"""
    noise_by_misfit: float
    """its exponent"""
    flesh_mm: float
    """how far another hand's joints lie beside the model's, constant offsets taken out [mm of a mean adult's hand]"""
    closed_mm: float
    """how much further the tip of a finger that is closed, whose flesh hides how far each joint bends: from its base it grows"""
    palm_mm: float
    """how much further all of a closed hand, whose knuckles and thumb flesh pushes about"""
    flesh_by_misfit: float
    """exponent of the misfit in all three"""


MASKS = Calibration(0.77, 0.0, 0.56, 9.6, 0.99, 0.0)
"""how badly masks fit tells nothing of joints: exponents of 0.26 and 0.41 bring 0.03 of a log-likelihood of 17.8 a frame"""
CLOUD = Calibration(0.7, 0.3, 1.4, 1.45, 0.56, 0.7)
"""a cloud's covariance has the hand's own shape in it already: `cloud.sigma_mm` for each patch"""
BODY = Calibration(1.7, 0.0, 8.0, 0.0, 0.0, 0.0)
"""by joints that a detector sees, which are a skeleton's of its own: `handtrack bench honesty_bodies`, one to three cameras"""

MISSED = 4.0
"""what a wrong frame costs that nobody looks at, where a look costs 1: a look pays above a probability of 1 / MISSED. The least whole
number by which four of five wrong frames of `tune` are named"""
ALWAYS = -4.67
SIGNS = {"curled": 2.39, "moved": 0.71, "open": 0.84}
"""logarithm of the odds of a gross error: ALWAYS where no sign tells of one, and what each adds times its size; none subtracts"""
MOVED_UNKNOWN = 0.6
"""the sign `moved` of a live frame, which the frames after have yet to move: its mean over frames of that half"""
PART = (-3.46, 2.17)
"""logarithm of the odds that a part is 10 mm off: always, and times the logarithm of its least sure joint's stated standard deviation in
units of 3 mm. How far later frames moved the part, or all of it, adds nothing"""

OBSERVED = ("coverage", "conic_field", "cloud_distance", "cloud_rays", "cloud_emptiness")
"""terms that see a surface, by name: what a misfit is told by"""
_UNSEEN_M = 0.003
"""standard deviation above which a direction is open rather than noisy: twice an outline's usual error"""
_BONES = {"pip": 1, "dip": 2, "tip": 3}
_THUMB = {"thumb_mcp": 1, "thumb_ip": 2}
_CLOSED_RAD = 4.0
"""sum of a finger's bends in a fist"""


def misfit(energies: Mapping[str, float], views: int) -> float:
    """Return how badly a model fits what was seen, 1 where as its noise says; 1 where no surface was seen.

    energies: of each term. As least squares judge their own noise by what is left over.
    """
    seen = [energy for name, energy in energies.items() if name in OBSERVED]
    if not seen or not views:
        return 1.0
    found = sum(seen) / (USUAL_PER_VIEW * views)
    return float(np.clip(found, LEAST_MISFIT, MOST_MISFIT))


def calibrated_covariance(
    model: ArticulatedModel,
    curled: Floats[K],
    joint_covariance: Floats[J, D3, D3],
    how_bad: float,
    by_cloud: bool = False,
) -> Floats[J, D3, D3]:
    """Return each joint's covariance [m²] of all that is known to be wrong.

    curled: `curls`, of fingers of which nothing else tells how they bend; joint_covariance: if the model were the hand, and noise what it
    is said to be [m²]; how_bad: `misfit`; by_cloud: whether a cloud was seen.
    """
    seen = CLOUD if by_cloud else MASKS
    if model.kind == "body":
        seen, how_bad = BODY, 1.0
    closed = _along_fingers(model) @ curled**2
    flesh = seen.flesh_mm + seen.closed_mm * closed + seen.palm_mm * curled.mean() ** 2
    flesh *= 1e-3 * model.scale.overall
    noise = seen.noise**2 * how_bad ** (2 * seen.noise_by_misfit)
    flesh = flesh**2 * how_bad ** (2 * seen.flesh_by_misfit)
    scaled = noise * joint_covariance
    if noise < 1.0:  # less noise makes nothing surer that was not seen at all
        values, axes = np.linalg.eigh(joint_covariance)
        unseen = values / (values + _UNSEEN_M**2)
        values = values * (noise + (1.0 - noise) * unseen)
        scaled = np.einsum("jab,jb,jcb->jac", axes, values, axes)
    return scaled + flesh[:, None, None] * np.eye(3)


def curls(model: ArticulatedModel, joint_params: Floats[S]) -> Floats[K]:
    """Return how far each finger is closed, 0 straight … 1, thumb first."""
    return np.clip(_bends(model) @ joint_params / _CLOSED_RAD, 0.0, 1.0)


@lru_cache(maxsize=8)
def _bends(model: ArticulatedModel) -> Array:
    names = model.parameter_names
    return np.array(
        [[n.startswith(f"{finger}_") and n.endswith("_flex") for n in names] for finger in FINGERS],
        float,
    )


@lru_cache(maxsize=8)
def _along_fingers(model: ArticulatedModel) -> Array:
    """Return (J, 5), of the finger that a joint is of, how many of its three bones lead there from its base, a share."""
    found = np.zeros((len(model.joint_names), len(FINGERS)))
    for row, name in enumerate(model.joint_names):
        finger, _, place = name.partition("_")
        if finger in FINGERS:
            found[row, FINGERS.index(finger)] = _THUMB.get(name, _BONES.get(place, 0)) / 3
    return found


FRAME_OFF_M = 0.025
_OPEN_M, _CLOSED, _MOVED_M = 0.003, 0.1, 0.005
BODY_OFF_M = BODY_BY_HAND * FRAME_OFF_M


def failure_probabilities(
    model: ArticulatedModel, joint_covariance: Floats[J, D3, D3], signs: Mapping[str, float]
) -> tuple[float, Floats[K], str]:
    """Return the failure probabilities of a hand's frame beside the constant offset of another definition, and what contributes most.

    Parameters
    ----------
    joint_covariance
        calibrated [m²]
    signs
        by the names of SIGNS, each 0 where nothing tells of an error: `curled`, how far the fingers are closed, 0 … 1, on average, those
        whose joints no two cameras confirm; `moved_sign`; `open_sign`, if the model were the hand

    Returns
    -------
    tuple
        the probability that some joint is more than 25 mm off; that some joint of each of PARTS is more than 10 mm off (6,); the
        sign that adds most to the first, or `open`: the observation itself
    """
    added = {name: weight * signs[name] for name, weight in SIGNS.items()}
    gross = float(_logistic(np.array(ALWAYS + sum(added.values()))))
    tail = float(probably_beyond(joint_covariance, FRAME_OFF_M).max())
    part, spread = np.array([part_of(n) for n in model.joint_names]), spread_m(joint_covariance)
    least = np.array([spread[part == p].max() if (part == p).any() else 0.0 for p in PARTS])
    always, by_spread = PART
    parts = _logistic(always + by_spread * np.log(np.maximum(least / _OPEN_M, _CLOSED)))
    telling = "open" if tail > gross else max(added, key=lambda name: added[name])
    return 1 - (1 - tail) * (1 - gross), parts, telling


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


_WORDS = {**{p: f"{p} finger" for p in PARTS}, "thumb": "thumb", "palm": "palm"}


@array_dataclass
class FrameConfidence:
    """How far a frame can be trusted."""

    status: Status
    reason: Reason | None = None
    joint_covariance: Floats[J, D3, D3] | None = None
    """[m²] as it is stated: of all that is known to be wrong; None where nothing is known of it"""
    p_off_25mm: float = float("nan")
    p_off_10mm: Floats[K] | None = None


def frame_confidence(
    terms: FrameTerms,
    params: Floats[P],
    energy: float,
    energies: Mapping[str, float],
    joint_covariance: Floats[J, D3, D3],
    previous: Sequence[FrameResult],
    moved_m: float | None = None,
) -> FrameConfidence:
    """Return what is to be said of a frame at solver parameters.

    energies: of each term; joint_covariance: [m²] if the model were the hand; moved_m: how far the frames after moved a joint,
    None as long as they are not known. Then a misfit alone is a doubt, which another search may end; later it is one sign of many,
    and tells least: of 85 such frames 8 were wrong.
    """
    model, joint = terms.model, terms.model.joint_params(params)
    bad, by_cloud = misfit(energies, terms.views), terms.cloud is not None
    hidden = curls(model, joint)
    if model.has_keypoints21:
        hidden = hidden * (1.0 - _confirmed(terms, model.bones(params)))
    stated = calibrated_covariance(model, hidden, joint_covariance, bad, by_cloud)
    stated += mirrored_covariance(terms, params)
    if is_unmeasured(
        model.scale
    ):  # a size that nothing measured may be another, about where the hand is
        joints = model.joint_positions(model.bones(params))
        rescaled = model.scale.std["overall"] * (joints - joints.mean(axis=0))
        stated += rescaled[:, :, None] * rescaled[:, None, :]
    status, reason = assess(terms, model.bones(params), energy, previous)
    if moved_m is not None and reason is not None and reason.kind == "energy":
        status, reason = Status.TRACKED, None
    off = None
    if model.has_keypoints21:
        moved = MOVED_UNKNOWN if moved_m is None else moved_sign(moved_m)
        signs = {
            "curled": float(hidden.mean()),
            "moved": moved,
            "open": open_sign(joint_covariance),
        }
        off = failure_probabilities(model, stated, signs)
    if status == Status.TRACKED:
        odd, most = odd_size(model), terms.settings.tracker.doubtful_mm
        reason = odd if odd is not None and not odd.part else None
        reason = reason or what_is_open(model, stated, most)
        if most > 0:
            reason = reason or _may_be_off(model, stated, off) or _may_be_far(model, stated)
        status = Status.TRACKED if reason is None else Status.DOUBTFUL
    if off is None:
        beyond = probably_beyond(stated, FRAME_OFF_M).max()
        known = float(beyond) if model.kind == "body" else float("nan")
        return FrameConfidence(status, reason, stated, known)
    return FrameConfidence(status, reason, stated, *off[:2])


def _confirmed(terms: FrameTerms, bones: BonePoses) -> Floats[K]:
    """Return of which share of each finger's joints, thumb first, detections of two cameras lie where the model has them."""
    names = terms.model.joint_names
    cameras = np.zeros(len(names))
    for term in terms.keypoints:
        if isinstance(term.observed, ImageKeypoints):
            joint, off = terms.misses(term, bones)
            np.add.at(cameras, joint, off < NEAR_SIGMAS)
    own = [[name.partition("_")[0] == finger for name in names] for finger in FINGERS]
    return np.array([(cameras[rows] > 1).mean() for rows in own])


def _may_be_off(
    model: ArticulatedModel,
    joint_covariance: Floats[J, D3, D3],
    off: tuple[float, Floats[K], str] | None,
) -> Reason | None:
    """Return what most probably is off, where a look costs less than what may be missed."""
    if off is None or off[0] * MISSED <= 1.0:
        return None
    frame, parts, telling = off
    worst = PARTS[int(np.argmax(parts))]
    own = np.array([part_of(name) == worst for name in model.joint_names])
    spread_mm = 1e3 * float(spread_m(joint_covariance)[own].max())
    return Reason("off", _WORDS[worst], telling, spread_mm, frame)


def _may_be_far(model: ArticulatedModel, joint_covariance: Floats[J, D3, D3]) -> Reason | None:
    """Return which joint of a body most probably is as far off as a frame of a hand may be, for its size."""
    if model.kind != "body":
        return None
    beyond = probably_beyond(joint_covariance, BODY_OFF_M)
    worst = int(beyond.argmax())
    if beyond[worst] * MISSED <= 1.0:
        return None
    spread_mm = 1e3 * float(spread_m(joint_covariance)[worst])
    name = model.joint_names[worst].replace("_", " ")
    return Reason("far off", name, number=spread_mm, other=float(beyond[worst]))
