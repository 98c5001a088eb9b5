"""Whether a solved frame is to be trusted: its status, and the reason where it is not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from handtrack.arrays import D3, Array, C, Floats, Ints, J, N
from handtrack.model.articulated import FINGERS, ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.size import SizeParameters, hand_length_mm, is_unmeasured
from handtrack.observation.observation import ImageKeypoints
from handtrack.terms.silhouettes.outline_overlap import outline_overlap, parts_overlap
from handtrack.terms.silhouettes.unexplained import unexplained_mm2
from handtrack.tracking.frame.constants import (
    BODY_BY_HAND,
    DOUBTFUL_CLOUD,
    DOUBTFUL_OVERLAP,
    DOUBTFUL_PART,
    DOUBTFUL_PIECE_MM2,
    LOST_CLOUD,
    LOST_OVERLAP,
)
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.frame.reason import (
    LARGEST_HAND_MM,
    NEAR_SIGMAS,
    SMALLEST_ADULT_MM,
    SMALLEST_HAND_MM,
    Reason,
)
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.frame.terms.cloud_terms import agreement

_DOUBTFUL_KEYPOINTS, _LOST_KEYPOINTS = 0.7, 0.35  # share of points near the model; as with clouds
_ENOUGH = 5  # tracked frames to go by
FEWEST_FRAMES = 3
"""before a frame, from which anything is usual"""
_HISTORY = 30  # frames that tell what is usual
_LEAST_USUAL = (
    15.0  # energy a view: about half a hand's outline off by one sigma, each stretch on its own
)
_DOUBTFUL = 2.0  # times the usual energy: say so
_ODD_SHARES = 20.5  # χ² of five fingers' shares of a hand that one person in a thousand exceeds
_FEWEST_JOINTS = 2  # of a part that say where it is: its direction, too
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
    return energy / views / max(float(np.percentile(known, 25)), _LEAST_USUAL)


def _posed(previous: Sequence[FrameResult]) -> list[FrameResult]:
    """Return the frames before that tell what is usual."""
    return [r for r in previous[-_HISTORY:] if r.status != Status.LOST]


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
    fine = terms.model.flesh["fine"]
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
    worst, reason = DOUBTFUL_PART, None
    names, parts = _parts(terms.model)
    overlaps = parts_overlap(terms.prepared, terms.model.flesh["fine"], parts, bones)
    detected = _detected(terms, names, bones)
    for bone, found, by_joints in zip(names, overlaps, detected, strict=True):
        inside = np.where(found.model >= _LEAST_PART_PX, found.both / found.model.clip(1.0), 1.0)
        inside[by_joints] = 1.0
        view = int(np.argsort(inside)[1 if len(inside) > 2 else 0])
        if inside[view] < worst:
            worst = inside[view]
            camera = terms.prepared[view].camera
            reason = Reason("part outside", bone.replace("_", " "), camera.name, float(1 - worst))
    return reason


def _detected(terms: FrameTerms, names: Sequence[str], bones: BonePoses) -> Array[N, C]:
    """Return in which silhouettes' images each bone, and the one it hangs on, are where a detector sees all of their joints."""
    model, skeleton = terms.model, terms.model.skeleton
    detected = np.zeros((len(names), len(terms.prepared)), bool)
    if not any(isinstance(term.observed, ImageKeypoints) for term in terms.keypoints):
        return detected
    near = np.zeros((len(model.joint_names), len(terms.prepared)), int)  # 1 near, -1 elsewhere
    for term in terms.keypoints:
        if isinstance(term.observed, ImageKeypoints):
            joint, off = terms.misses(term, bones)
            views = [p.camera.name == term.observed.camera.name for p in terms.prepared]
            near[np.ix_(joint, np.flatnonzero(views))] = np.where(off < NEAR_SIGMAS, 1, -1)[:, None]
    for row, bone in enumerate(map(skeleton.bone, names)):
        part = near[np.isin(model.joint_bone, [bone, skeleton.parent[bone]])]
        detected[row] = ((part > 0).sum(axis=0) >= _FEWEST_JOINTS) & (part >= 0).all(axis=0)
    return detected


@lru_cache(maxsize=8)
def _parts(model: ArticulatedModel) -> tuple[list[str], Sequence[Ints[N]]]:
    """Return each bone's name, and which are its ellipsoids and those of the bone it hangs on: a fingertip alone is as small
    as a mask's errors. Without the forearm: nobody knows how much of it a sleeve hides.
    """
    carrier, skeleton = model.flesh["fine"].bone, model.skeleton
    kept = [int(bone) for bone in np.unique(carrier) if not model.is_forearm(bone)]
    names = [skeleton.bone_names[bone] for bone in kept]
    parts = [
        np.flatnonzero((carrier == bone) | (carrier == skeleton.parent[bone])) for bone in kept
    ]
    return names, parts


def assess(
    terms: FrameTerms, bones: BonePoses, energy: float, previous: Sequence[FrameResult]
) -> tuple[Status, Reason | None]:
    """Return a frame's status and, unless it is tracked, the reason."""
    if not terms.views and any(isinstance(t.observed, ImageKeypoints) for t in terms.keypoints):
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
    """Return what of a hand may be further off than that by its own covariance; None where nothing, or it is 0.

    joint_covariance: [m²]. It is the mean joint that counts (root mean square of their standard deviations): a
    fingertip alone is often hidden. A body may be as much further off as it is larger.
    """
    spread = 1e6 * np.trace(joint_covariance, axis1=1, axis2=2)
    whole = float(np.sqrt(spread.mean()))
    if model.kind == "body":
        most_mm *= BODY_BY_HAND
        return Reason("open", "whole body", number=whole) if 0 < most_mm < whole else None
    if most_mm == 0 or whole <= most_mm:
        return None
    bases = {"wrist", "thumb_cmc", *(f"{finger}_mcp" for finger in FINGERS[1:])}
    part = np.array(["palm" if n in bases else n.split("_")[0] for n in model.joint_names])
    wide = [
        p for p in ("palm", *FINGERS) if (part == p).any() and spread[part == p].mean() > most_mm**2
    ]
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
    found = outline_overlap(terms.prepared, terms.model.flesh["fine"], bones)
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
    if share[worst] < DOUBTFUL_OVERLAP:
        return Status.DOUBTFUL, overlap
    outside = part_outside(terms, bones)
    return (Status.DOUBTFUL, outside) if outside else (Status.TRACKED, None)


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
    detected = (t.observed for t in terms.keypoints if isinstance(t.observed, ImageKeypoints))
    return (
        len({one.camera.name for one in detected}) > 1
        and _by_keypoints(terms, bones)[0] == Status.TRACKED
    )


def _by_cloud(terms: FrameTerms, bones: BonePoses) -> tuple[Status, Reason | None]:
    if terms.cloud is None:
        return Status.TRACKED, None
    found = agreement(terms.cloud.as_seen_at(terms.model, bones), terms.model, bones)
    reason = Reason("cloud", number=found.explained)
    # points of other things tell nothing of a hand whose surface was measured
    if np.fmax(found.explained, found.measured) < LOST_CLOUD:
        return Status.LOST, reason
    if found.explained < DOUBTFUL_CLOUD:
        return Status.DOUBTFUL, reason
    return Status.TRACKED, None
