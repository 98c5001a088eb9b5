"""How far a solved frame can be trusted: its status and the reason, its joints' calibrated covariance, its failure probability.

The numbers are fitted to tracked hands of other people, none of one recording, by `python -m tests.experiments.honesty.confidence`:
docs/explanation/uncertainty.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from handtrack.arrays import D3, Array, Axes, C, Floats, Ints, J, K, N, P, S
from handtrack.model.articulated import FINGERS, ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.size import SizeParameters, hand_length_mm, is_unmeasured
from handtrack.observation.observation import CLOUD_NAME
from handtrack.terms.silhouettes import outline_overlap, parts_overlap, unexplained_mm2
from handtrack.tracking.frame.constants import (
    BODY_BY_HAND,
    DOUBTFUL_CLOUD,
    DOUBTFUL_OVERLAP,
    DOUBTFUL_PART,
    DOUBTFUL_PIECE_MM2,
    LOST_CLOUD,
    LOST_OVERLAP,
)
from handtrack.tracking.frame.descent import mirrored_covariance
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.frame.reason import (
    LARGEST_HAND_MM,
    NEAR_SIGMAS,
    SMALLEST_ADULT_MM,
    SMALLEST_HAND_MM,
    Reason,
)
from handtrack.tracking.frame.result import PARTS, FrameResult, Status
from handtrack.tracking.frame.terms.cloud_terms import agreement

_DOUBTFUL_KEYPOINTS, _LOST_KEYPOINTS = 0.7, 0.35  # share of points near the model; as with clouds
_ENOUGH = 5  # tracked frames to go by
FEWEST_FRAMES = 3
"""before a frame, from which anything is usual"""
HISTORY = 30
"""frames before one that tell what is usual"""
_LEAST_USUAL = (
    15.0  # energy a view: about half a hand's outline off by one sigma, each stretch on its own
)
_DOUBTFUL = 2.0  # times the usual energy: say so
_ODD_SHARES = 20.5  # χ² of five fingers' shares of a hand that one person in a thousand exceeds
_FEWEST_JOINTS = 2  # of a part that say where it is: its direction, too
_OWN_FLESH_M = 0.015
"""before a joint, a finger's own: by 10 mm 8 of 120 frames of desk_two_view have low confidence, by 15 mm none"""
_LEAST_PART_PX = 30.0  # of a part's outline: fewer pixels do not tell


def energy_ratio(energy: float, views: int, previous: Sequence[FrameResult]) -> float:
    """Return a frame's energy in units of what is usual: the lower quartile of the tracked frames before it.

    Of all frames where few are tracked: what is always so is usual. 1 where hardly anything came before. A floor
    keeps nearly perfect fits from calling each other bad. Energies are compared a view: a frame that two cameras see is not
    bad beside those that one saw.
    """
    posed = _posed(previous)
    views = max(views, 1)
    known = [r.energy / (r.views or views) for r in posed if r.fits]
    if len(known) < _ENOUGH:
        known = [r.energy / (r.views or views) for r in posed]
    if len(known) < FEWEST_FRAMES:
        return 1.0
    return energy / views / max(_lower_quartile(known), _LEAST_USUAL)


def _lower_quartile(values: Sequence[float]) -> float:
    """Return the 25th percentile of two values and more, to the bit what `np.percentile` takes a hundred times as long for."""
    place, share = divmod(0.25 * (len(values) - 1), 1.0)
    low, high = sorted(values)[int(place) : int(place) + 2]
    return low + (high - low) * share if share < 0.5 else high - (high - low) * (1.0 - share)


def _posed(previous: Sequence[FrameResult]) -> list[FrameResult]:
    """Return the frames before that tell what is usual."""
    return [r for r in previous[-HISTORY:] if r.status != Status.LOST]


@dataclass(frozen=True)
class OutlineFit:
    """How a pose fits a frame's silhouettes, where each fits worst."""

    camera: str
    overlap: float
    """intersection over union"""
    piece_camera: str
    piece_mm2: float
    """of the largest connected piece of a silhouette beside the model"""

    @property
    def words(self) -> str:
        text = f"Model and silhouette overlap by {100 * self.overlap:.0f} % in {self.camera}, where least"
        if self.piece_mm2 < 1.0:
            return f"{text}; no piece of a silhouette as thick as a finger lies beside the model."
        return (
            f"{text}; the largest piece of a silhouette beside the model is {self.piece_mm2:.0f} mm² in {self.piece_camera} (a "
            f"finger's end is {DOUBTFUL_PIECE_MM2:.0f})."
        )


def outline_fit(terms: FrameTerms, bones: BonePoses) -> OutlineFit | None:
    """Return how a pose fits the silhouettes; None where there are none."""
    if not terms.prepared:
        return None
    fine = terms.model.ellipsoids["fine"]
    share = outline_overlap(terms.prepared, fine, bones).iou
    pieces = unexplained_mm2(terms.prepared, terms.pixels_per_m, fine, bones)
    least, most = int(np.argmin(share)), int(np.argmax(pieces))
    names = [view.camera.name for view in terms.prepared]
    return OutlineFit(names[least], float(share[least]), names[most], float(pieces[most]))


def _beside(terms: FrameTerms, bones: BonePoses) -> Reason | None:
    """Return that a finger's end of a silhouette lies beside the model; None where none does, and for bodies."""
    fit = outline_fit(terms, bones) if terms.model.kind == "hand" else None
    if fit is None or fit.piece_mm2 < DOUBTFUL_PIECE_MM2:
        return None
    return Reason("beside", camera=fit.piece_camera, number=fit.piece_mm2, other=fit.overlap)


def part_outside(terms: FrameTerms, bones: BonePoses) -> Reason | None:
    """Return which part of the model lies outside a silhouette, and by which share; None where none does.

    A part that is hidden in a view is still inside the outline of what hides it; so wherever it really is, each mask
    covers all of it. The overlap of the whole outlines hardly changes when a finger or a body's arm is lost.
    Of three and more views two must say so: a mask may lack a finger; so it does where a detector sees in the same image
    the part's joints where the model has them.
    """
    names, parts, joints = _parts(terms.model)
    areas = parts_overlap(terms.prepared, terms.model.ellipsoids["fine"], parts, bones)
    model, both = np.moveaxis(areas, -1, 0)
    inside = np.where(model >= _LEAST_PART_PX, both / model.clip(1.0), 1.0)
    inside[_detected(terms, joints, bones)] = 1.0
    views = np.argsort(inside, axis=1)[:, 1 if inside.shape[1] > 2 else 0]
    shares = inside[np.arange(len(names)), views]
    worst = int(np.argmin(shares))
    if shares[worst] >= DOUBTFUL_PART:
        return None
    camera, part = terms.prepared[views[worst]].camera, names[worst].replace("_", " ")
    return Reason("part outside", part, camera.name, float(1 - shares[worst]))


def _detected(terms: FrameTerms, joints: Ints[N, J], bones: BonePoses) -> Array[N, C]:
    """Return in which silhouettes' images a detector sees all joints of each part, 1 in its row of `joints`, where they are."""
    near = np.zeros((joints.shape[1], len(terms.prepared)), int)  # 1 near, -1 elsewhere
    for term, seen in terms.detected:
        joint, off = terms.misses(term, bones)
        views = [prepared.camera.name == seen.camera.name for prepared in terms.prepared]
        near[np.ix_(joint, np.flatnonzero(views))] = np.where(off < NEAR_SIGMAS, 1, -1)[:, None]
    return (joints @ (near > 0) >= _FEWEST_JOINTS) & (joints @ (near < 0) == 0)


@lru_cache(maxsize=8)
def _parts(model: ArticulatedModel) -> tuple[list[str], Sequence[Ints[N]], Ints[N, J]]:
    """Return each bone's name, which are its ellipsoids and those of the bone it hangs on, and 1 for the joints of both: a fingertip alone
    is as small as a mask's errors. Without the forearm: nobody knows how much of it a sleeve hides.
    """
    carrier, skeleton = model.ellipsoids["fine"].bone, model.skeleton
    kept = [int(bone) for bone in np.unique(carrier) if not model.is_forearm(bone)]
    names = [skeleton.bone_names[bone] for bone in kept]
    parts = [
        np.flatnonzero((carrier == bone) | (carrier == skeleton.parent[bone])) for bone in kept
    ]
    joints = [np.isin(model.joint_bone, [bone, skeleton.parent[bone]]) for bone in kept]
    return names, parts, np.array(joints, int)


def assess(
    terms: FrameTerms, bones: BonePoses, energy: float, previous: Sequence[FrameResult]
) -> tuple[Status, Reason | None]:
    """Return a frame's status and, unless it is tracked, the reason."""
    if not terms.views and terms.keypoints:
        return _by_keypoints(terms, bones)
    if not terms.views:
        return Status.DOUBTFUL, Reason("given keypoints")
    found = [_by_outline(terms, bones), _by_cloud(terms, bones)]
    status, reason = max(found, key=lambda one: one[0])
    if status == Status.LOST and is_where_joints_are(terms, bones):
        status = Status.DOUBTFUL  # masks or points show something else, too
    if status == Status.TRACKED and len(_posed(previous)) < FEWEST_FRAMES:
        reason = _beside(terms, bones)
        status = Status.TRACKED if reason is None else Status.DOUBTFUL
    ratio = energy_ratio(energy, terms.views, previous)
    if status == Status.TRACKED and ratio > _DOUBTFUL:
        return Status.DOUBTFUL, Reason("energy", number=ratio)
    return status, reason


def what_is_open(
    model: ArticulatedModel, joint_covariance: Floats[J, D3, D3], most_mm: float
) -> Reason | None:
    """Return what of a hand may be further off than that by its own covariance; None where nothing,
    or it is 0.

    It is the mean joint that counts (root mean square of their standard deviations): a fingertip
    alone is often hidden. A body may be as much further off as it is larger.

    Parameters
    ----------
    joint_covariance
        [m²].
    """
    spread = 1e6 * np.trace(joint_covariance, axis1=1, axis2=2)
    whole = float(np.sqrt(spread.mean()))
    if model.kind == "body":
        most_mm *= BODY_BY_HAND
        return Reason("open", "whole body", number=whole) if 0 < most_mm < whole else None
    if most_mm == 0 or whole <= most_mm:
        return None
    part = np.array([part_of(name) for name in model.joint_names])
    wide = [p for p in PARTS if (part == p).any() and spread[part == p].mean() > most_mm**2]
    if "palm" in wide or len(wide) == len(FINGERS):
        return Reason("open", "whole hand", number=whole)
    off = float(np.sqrt(spread[np.isin(part, wide)].mean()))
    named = " and ".join(filter(None, (", ".join(wide[:-1]), wide[-1])))
    kind = "" if wide == ["thumb"] else " finger"
    return Reason("open", f"{named}{kind}", number=off)


@lru_cache(maxsize=8)
def odd_size(model: ArticulatedModel) -> Reason | None:
    """Return what of a hand no person has, its length or the share of a finger; None where somebody may."""
    length_mm = hand_length_mm(model)
    if np.isnan(length_mm):
        return None
    if not SMALLEST_HAND_MM <= length_mm <= LARGEST_HAND_MM:
        return Reason("size", number=length_mm)
    size = SizeParameters(model)
    shares = {
        n: d for n, d in zip(size.names, size.deviations(model.scale), strict=True) if n in FINGERS
    }
    if sum(d**2 for d in shares.values()) <= _ODD_SHARES:
        return None
    worst = max(shares, key=lambda name: abs(shares[name]))
    finger = worst if worst == "thumb" else f"{worst} finger"
    return Reason("size", finger, number=model.scale.parts[worst])


def hand_words(model: ArticulatedModel) -> str:
    """Return how long a hand is, how well that is known and whether people have such, in a clause; empty where its size was given
    and is not odd.
    """
    odd, std_mm = odd_size(model), model.scale.std.get("length_mm")
    if odd is None and std_mm is None:
        return ""
    length_mm = hand_length_mm(model)
    known = "" if std_mm is None else f" ± {max(std_mm, 1.0):.0f}"
    people = "within the adult range" if length_mm >= SMALLEST_ADULT_MM else "a child's size"
    if is_unmeasured(model.scale):
        people = "held at the population's size, for too little of the hand was measured"
    if odd is not None:
        people = (
            "which nobody has"
            if not odd.part
            else f"with a share of the {odd.part} that nobody has"
        )
    return f"hand {length_mm:.0f} mm{known}, {people}"


def _by_outline(terms: FrameTerms, bones: BonePoses) -> tuple[Status, Reason | None]:
    if not terms.prepared:
        return Status.TRACKED, None
    found = outline_overlap(terms.prepared, terms.model.ellipsoids["fine"], bones)
    filled = found.model + found.mask > 0
    if not filled.any():
        return Status.LOST, Reason("out of view")
    share = found.iou
    worst = int(np.argmin(share))
    camera = terms.prepared[worst].camera
    filled_mask = (
        found.mask[worst] > 0.5 * camera.size[0] * camera.size[1]
    )  # as Silhouette.fills_image
    kind = "filled mask" if filled_mask else "overlap"
    overlap = Reason(kind, camera=camera.name, number=float(share[worst]))
    if np.median(share[filled]) < LOST_OVERLAP:
        return Status.LOST, overlap
    reason = overlap if share[worst] < DOUBTFUL_OVERLAP else part_outside(terms, bones)
    return Status.DOUBTFUL if reason else Status.TRACKED, reason


def _by_keypoints(terms: FrameTerms, bones: BonePoses) -> tuple[Status, Reason | None]:
    """Judge by the share of points that lie where they are seen; robust terms let go of the others."""
    near, known = 0, 0
    for term in terms.keypoints:
        _, off = terms.misses(term, bones)
        near, known = near + int((off < NEAR_SIGMAS).sum()), known + len(off)
    share = near / max(known, 1)
    reason = Reason("keypoints", number=share, other=known)
    if share < _LOST_KEYPOINTS:
        return Status.LOST, reason
    if share < _DOUBTFUL_KEYPOINTS:
        return Status.DOUBTFUL, reason
    return Status.TRACKED, None


def is_where_joints_are(terms: FrameTerms, bones: BonePoses) -> bool:
    """Return whether detectors see the joints in two cameras or more where the model has them: whatever does not fit, the hand is not
    elsewhere.
    """
    return (
        len({seen.camera.name for _, seen in terms.detected}) > 1
        and _by_keypoints(terms, bones)[0] == Status.TRACKED
    )


def _by_cloud(terms: FrameTerms, bones: BonePoses) -> tuple[Status, Reason | None]:
    if terms.cloud is None:
        return Status.TRACKED, None
    bones = terms.then(CLOUD_NAME, bones)
    found = agreement(terms.cloud.visible_at(bones), bones)
    reason = Reason("cloud", number=found.explained)
    # points of other things tell nothing of a hand whose surface was measured
    if np.fmax(found.explained, found.measured) < LOST_CLOUD:
        return Status.LOST, reason
    if found.explained < DOUBTFUL_CLOUD:
        return Status.DOUBTFUL, reason
    return Status.TRACKED, None


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
JOINTS = Calibration(0.77, 0.0, 2.0, 7.8, 1.0, 0.0)
"""joints that a detector sees, which err alike in all cameras. Fitted to 23 made recordings and the bundled two videos alike it would be 0.81,
2.27, 7.86, 0.93; to made ones alone as MASKS, but then 60 % of
the videos' joints are in their 90 % region, not 83 %"""
CLOUD = Calibration(0.7, 0.3, 1.4, 1.45, 0.56, 0.7)
"""a cloud's covariance has the hand's own shape in it already: `cloud.sigma_mm` for each patch"""
BODY = Calibration(1.7, 0.0, 8.0, 0.0, 0.0, 0.0)
"""by joints that a detector sees, which are a skeleton's of its own: `handtrack bench honesty_bodies`, one to three cameras"""

MISSED = 5.0
"""what a wrong frame costs that nobody looks at, where a look costs 1: a look pays above a probability of 1 / MISSED. By 5
a quarter of the frames are looked at, and three of four wrong ones found; by 7, a third and four of five"""
ALWAYS = -5.97
SIGNS = {"moved": 0.31, "open": 1.92, "free": 0.77}
"""logarithm of the odds that a frame is wrong: ALWAYS where no sign tells of it, and what each adds times its size; none subtracts. The
tail of what is stated tells less than its width does: of errors above 25 mm few are noise"""
ELSEWHERE = 0.06
"""what the odds of other paths, in units of one in a thousand, add to the logarithm of the odds of being off (`with_paths`)"""
UNKNOWN = {"moved": 0.63, "free": 0.74}
"""signs of a live frame, which the frames after have yet to move, and which has no time to put fingers elsewhere: means over frames of
both halves"""
PART = (-3.99, 2.43)
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
    """Return how badly a model fits what was seen, 1 where as its noise says; 1 where no surface
    was seen.

    As least squares judge their own noise by what is left over.

    Parameters
    ----------
    energies
        Of each term.
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
    seen: Calibration,
) -> Floats[J, D3, D3]:
    """Return each joint's covariance [m²] of all that is known to be wrong.

    Parameters
    ----------
    curled
        `curls`, of fingers of which nothing else tells how they bend.
    joint_covariance
        If the model were the hand, and noise what it is said to be [m²].
    how_bad
        `misfit`.
    seen
        Of the evidence.
    """
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
_RARE, _NEVER = 1e-3, 1e-9
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
        `moved_sign` and `free_sign`, by the names of SIGNS, each 0 where nothing tells of an error

    Returns
    -------
    tuple
        the probability that some joint is more than 25 mm off; that some joint of each of PARTS is more than 10 mm off (6,); the
        sign that adds most to the first, one of SIGNS
    """
    signs = {**signs, "open": open_sign(joint_covariance)}
    added = {name: weight * signs[name] for name, weight in SIGNS.items()}
    wrong = float(_logistic(np.array(ALWAYS + sum(added.values()))))
    part, spread = np.array([part_of(n) for n in model.joint_names]), spread_m(joint_covariance)
    least = np.array([spread[part == p].max() if (part == p).any() else 0.0 for p in PARTS])
    always, by_spread = PART
    parts = _logistic(always + by_spread * np.log(np.maximum(least / _OPEN_M, _CLOSED)))
    return wrong, parts, max(added, key=lambda name: added[name])


def moved_sign(moved_m: float) -> float:
    """Return the logarithm of how far the frames after moved a joint, in units of 5 mm; 0 below."""
    return float(np.log(max(moved_m / _MOVED_M, 1.0)))


def open_sign(joint_covariance: Floats[J, D3, D3]) -> float:
    """Return the logarithm of the largest of joints' standard deviations, in units of 3 mm; 0 below. joint_covariance: [m²]."""
    return float(np.log(max(spread_m(joint_covariance).max() / _OPEN_M, 1.0)))


def with_paths(off: Floats[K], elsewhere: Floats[K]) -> Floats[K]:
    """Return probabilities of being off once other paths through the recording are known.

    Parameters
    ----------
    elsewhere
        How probable those paths are by which each is off.

    Notes
    -----
    One sign of many: most modes are wrong by what made the frame's own pose wrong, so that it is seldom one of them that is right.
    """
    sign = _odds(np.maximum(elsewhere, _RARE)) - _odds(np.array(_RARE))
    return _logistic(_odds(off) + ELSEWHERE * sign)


def part_of(joint: str) -> str:
    """Return which of PARTS a joint belongs to: palm, or its finger beyond the base."""
    finger, _, place = joint.partition("_")
    return (
        finger
        if (finger in FINGERS and place not in ("cmc", "mcp")) or joint == "thumb_mcp"
        else "palm"
    )


def _odds(probability: Floats[*Axes]) -> Floats[*Axes]:
    """Return the logarithm of the odds."""
    known = np.clip(probability, _NEVER, 1.0 - _NEVER)
    return np.log(known / (1.0 - known))


def _logistic(odds: Floats[*Axes]) -> Floats[*Axes]:
    return 1.0 / (1.0 + np.exp(-odds))


def spread_m(covariance: Floats[J, D3, D3]) -> Floats[J]:
    """Return each joint's standard deviation [m], of its place in space."""
    return np.sqrt(np.trace(covariance, axis1=1, axis2=2))


def probably_beyond(covariance: Floats[J, D3, D3], off_m: float) -> Floats[J]:
    """Return how probably each joint's normal error is longer than that: χ² of the same mean and variance (Satterthwaite 1946)."""
    from scipy.special import gammaincc

    trace = np.trace(covariance, axis1=1, axis2=2)
    square = np.einsum("jab,jab->j", covariance, covariance)
    scale, freedom = square / trace, trace**2 / square
    return gammaincc(0.5 * freedom, 0.5 * off_m**2 / scale)


_WORDS = {**{p: f"{p} finger" for p in PARTS}, "thumb": "thumb", "palm": "palm"}


def frame_confidence(
    result: FrameResult,
    terms: FrameTerms,
    params: Floats[P],
    energy: float,
    previous: Sequence[FrameResult],
    refined: Mapping[str, float] | None = None,
) -> FrameResult:
    """Return a frame at solver parameters with what is to be said of it.

    Parameters
    ----------
    result
        With the energies of its terms, and the covariance of its joints [m²] if the model were the hand.
    refined
        Signs of a frame that the frames after have refined, `moved` and `free`; None as long as they are not known. Then a misfit
        alone is a doubt, which another search may end; later it is one sign of many, and tells
        least: of 85 such frames 8 were wrong.
    """
    model, bones = terms.model, terms.model.bones(params)
    bad = misfit(result.energies, terms.views)
    seen = CLOUD if terms.cloud is not None else JOINTS if terms.detected else MASKS
    seen = BODY if model.kind == "body" else seen
    hidden = curls(model, model.joint_params(params))
    if model.has_keypoints21 and terms.detected:
        hidden = hidden * (1.0 - _confirmed(terms, bones))
    reported = calibrated_covariance(model, hidden, result.joint_covariance, bad, seen)
    reported += mirrored_covariance(terms, params)
    if is_unmeasured(model.scale):  # it may be another, about where the hand is
        joints = model.joint_positions(bones)
        rescaled = model.scale.std["overall"] * (joints - joints.mean(axis=0))
        reported += rescaled[:, :, None] * rescaled[:, None, :]
    off_25, off_10, may_be_off = float("nan"), None, None
    if model.has_keypoints21:
        off_25, off_10, telling = failure_probabilities(model, reported, refined or UNKNOWN)
        part = PARTS[int(np.argmax(off_10))]
        own = np.array([part_of(name) == part for name in model.joint_names])
        may_be_off = _unsure("off", off_25, _WORDS[part], reported[own], telling)
    elif model.kind == "body":
        off_25 = float(probably_beyond(reported, FRAME_OFF_M).max())
        beyond = probably_beyond(reported, BODY_OFF_M)
        joint = int(beyond.argmax())
        name = model.joint_names[joint].replace("_", " ")
        may_be_off = _unsure("far off", float(beyond[joint]), name, reported[[joint]])
    status, reason = assess(terms, bones, energy, previous)
    if refined is not None and reason is not None and reason.kind == "energy":
        status, reason = Status.TRACKED, None
    if status == Status.TRACKED:
        odd, most = odd_size(model), terms.settings.tracker.doubtful_mm
        reason = odd if odd is not None and not odd.part else None
        reason = reason or what_is_open(model, reported, most)
        reason = reason or (may_be_off if most > 0 else None)
        status = Status.TRACKED if reason is None else Status.DOUBTFUL
    result = replace(result, joint_covariance=reported, p_off_25mm=off_25, p_off_10mm=off_10)
    return assessed_as(result, status, reason)


def assessed_as(result: FrameResult, status: Status, reason: Reason | None = None) -> FrameResult:
    """Return a frame of that status; parameters of a lost hand may be anything."""
    std = result.parameter_std
    std = np.full_like(std, np.inf) if status == Status.LOST else std
    return replace(result, status=status, reason=reason, parameter_std=std)


def _confirmed(terms: FrameTerms, bones: BonePoses) -> Floats[K]:
    """Return of which share of each finger's joints, thumb first, detections of two cameras lie where the model has them, and no other flesh
    before them: a detector's guesses of what is hidden confirm nothing.
    """
    names, places = terms.model.joint_names, terms.model.joint_positions(bones)
    cameras, flesh = np.zeros(len(names)), terms.model.ellipsoids["fine"].posed(bones)
    for term, seen in terms.detected:
        joint, off = terms.misses(term, bones)
        hidden = flesh.hide(places[joint], seen.camera.centre, _OWN_FLESH_M)
        np.add.at(cameras, joint, (off < NEAR_SIGMAS) & ~hidden)
    own = [[name.partition("_")[0] == finger for name in names] for finger in FINGERS]
    return np.array([(cameras[rows] > 1).mean() for rows in own])


def _unsure(
    kind: str, probability: float, part: str, joint_covariance: Floats[J, D3, D3], sign: str = ""
) -> Reason | None:
    """Return that a part, of joints of that covariance, so probably is off; None where a look costs more than what may be missed."""
    if probability * MISSED <= 1.0:
        return None
    return Reason(kind, part, sign, 1e3 * float(spread_m(joint_covariance).max()), probability)
