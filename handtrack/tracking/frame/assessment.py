"""Whether a solved frame is to be trusted, and why not, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import Floats
from handtrack.model.articulated import FINGERS, ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import ImageKeypoints
from handtrack.terms.silhouettes.outline_overlap import outline_overlap
from handtrack.tracking.frame.cloud_terms import explained_share
from handtrack.tracking.frame.constants import (
    DOUBTFUL_CLOUD,
    DOUBTFUL_OVERLAP,
    DOUBTFUL_PART,
    LOST_CLOUD,
    LOST_OVERLAP,
)
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.frame.result import FrameResult, Status

_NEAR_M = 0.006  # three times the usual error of a point
_NEAR_SIGMAS = 4.0  # twice that a normal error rarely is, for detectors err more often
_DOUBTFUL_KEYPOINTS, _LOST_KEYPOINTS = 0.7, 0.35  # share of points near the model; as with clouds
_ENOUGH, _FEWEST = 5, 3  # tracked frames to go by; any frames at all
_HISTORY = 30  # frames that tell what is usual
_LEAST_USUAL = (
    15.0  # energy a view: about half a hand's outline off by one sigma, each stretch on its own
)
_SUSPICIOUS = 1.4  # times the usual energy: worth looking for a lost finger
_DOUBTFUL = 2.0  # times the usual energy: say so
_LEAST_PART_PX = 30.0  # of a part's outline: fewer pixels do not tell


def energy_ratio(energy: float, views: int, previous: Sequence[FrameResult]) -> float:
    """Return a frame's energy in units of what is usual: the lower quartile of the tracked frames before it.

    Of all frames where few are tracked: what is always so is usual. 1 where hardly anything came before. A floor
    keeps nearly perfect fits from calling each other bad.
    """
    posed = [r for r in previous[-_HISTORY:] if r.status != Status.LOST]
    known = [r.energy for r in posed if r.fits]
    if len(known) < _ENOUGH:
        known = [r.energy for r in posed]
    if len(known) < _FEWEST:
        return 1.0
    return energy / max(float(np.percentile(known, 25)), _LEAST_USUAL * max(views, 1))


def is_suspicious(energy: float, views: int, previous: Sequence[FrameResult]) -> bool:
    """Return whether a frame fits worse than usual, or is one of the first, which nothing vouches for."""
    return len(previous) < _FEWEST or energy_ratio(energy, views, previous) > _SUSPICIOUS


def part_outside(terms: FrameTerms, bones: BonePoses) -> str:
    """Return, in words, which part of the model lies outside a silhouette; empty where none does.

    A part that is hidden in a view is still inside the outline of what hides it; so wherever it really is, each mask
    covers all of it. The overlap of the whole outlines hardly changes when a finger or a body's arm is lost.
    Of three and more views two must say so: a mask may lack a finger.
    """
    flesh, skeleton = terms.model.flesh["fine"], terms.model.skeleton
    worst, words = DOUBTFUL_PART, ""
    for bone in np.unique(flesh.bone):
        if terms.model.is_forearm(bone):
            continue  # nobody knows how much of it a sleeve hides
        # with the bone it hangs on: a fingertip alone is as small as a mask's errors
        part = (flesh.bone == bone) | (flesh.bone == skeleton.parent[bone])
        found = outline_overlap(terms.prepared, flesh.subset(part), bones)
        inside = np.where(found.model >= _LEAST_PART_PX, found.both / found.model.clip(1.0), 1.0)
        view = int(np.argsort(inside)[1 if len(inside) > 2 else 0])
        if inside[view] < worst:
            worst = inside[view]
            name, camera = skeleton.bone_names[bone].replace("_", " "), terms.prepared[view].camera
            outside = f"{100 * (1 - worst):.0f} % of the {name} and the bone before it"
            words = f"{outside} lie outside the silhouette in {camera.name}"
    return words


def assess(
    terms: FrameTerms, bones: BonePoses, energy: float, previous: Sequence[FrameResult]
) -> tuple[Status, str]:
    """Return a frame's status and, unless it is tracked, the reason."""
    if not terms.views and any(isinstance(t.observed, ImageKeypoints) for t in terms.keypoints):
        return _by_keypoints(terms, bones)
    if not terms.views:
        return Status.DOUBTFUL, "nothing was seen; only given keypoints hold the pose"
    status, reason = _by_outline(terms, bones)
    by_cloud, why = _by_cloud(terms, bones)
    if by_cloud > status:
        status, reason = by_cloud, why
    if status != Status.TRACKED:
        return status, reason
    ratio = energy_ratio(energy, terms.views, previous)
    if ratio > _DOUBTFUL:
        return (
            Status.DOUBTFUL,
            f"the model fits {ratio:.1f} times worse than usual; a finger may be lost",
        )
    return Status.TRACKED, ""


def what_is_open(model: ArticulatedModel, joint_covariance: Floats, most_mm: float) -> str:
    """Return, in words, what of a hand may be further off than that by its own covariance; empty where nothing, or it is 0.

    joint_covariance: (J, 3, 3) [m²]. It is the mean joint that counts (root mean square of their standard deviations): a
    fingertip alone is often hidden. Of a body nothing is said, whose joints are not known to millimetres.
    """
    spread = 1e6 * np.trace(joint_covariance, axis1=1, axis2=2)
    whole = float(np.sqrt(spread.mean()))
    if most_mm == 0 or model.kind == "body" or whole <= most_mm:
        return ""
    bases = {"wrist", "thumb_cmc", *(f"{finger}_mcp" for finger in FINGERS[1:])}
    part = np.array(["palm" if n in bases else n.split("_")[0] for n in model.joint_names])
    wide = [
        p for p in ("palm", *FINGERS) if (part == p).any() and spread[part == p].mean() > most_mm**2
    ]
    if "palm" in wide or len(wide) == len(FINGERS):
        return f"what was seen leaves the whole hand open: ± {whole:.0f} mm"
    off = float(np.sqrt(spread[np.isin(part, wide)].mean()))
    named = " and ".join(filter(None, (", ".join(wide[:-1]), wide[-1])))
    kind = "" if wide == ["thumb"] else " finger"
    return f"what was seen leaves the {named}{kind} open: ± {off:.0f} mm"


def _by_outline(terms: FrameTerms, bones: BonePoses) -> tuple[Status, str]:
    if not terms.prepared:
        return Status.TRACKED, ""
    found = outline_overlap(terms.prepared, terms.model.flesh["fine"], bones)
    filled = found.model + found.mask > 0
    if not filled.any():
        return Status.LOST, "neither model nor silhouette is in any view"
    share = found.iou
    worst = int(np.argmin(share))
    camera = terms.prepared[worst].camera.name
    overlap = f"model and silhouette overlap by {100 * share[worst]:.0f} % in {camera}"
    if np.median(share[filled]) < LOST_OVERLAP:
        return Status.LOST, overlap
    if share[worst] < DOUBTFUL_OVERLAP:
        return Status.DOUBTFUL, overlap
    outside = part_outside(terms, bones)
    return (Status.DOUBTFUL, outside) if outside else (Status.TRACKED, "")


def _by_keypoints(terms: FrameTerms, bones: BonePoses) -> tuple[Status, str]:
    """Judge by the share of points that lie where they are seen; robust terms let go of the others."""
    near, known = 0, 0
    for term in terms.keypoints:
        rows = term.rows(bones)
        width = 2 if isinstance(term.observed, ImageKeypoints) else 3
        off = np.linalg.norm(rows.residual.reshape(-1, width), axis=1)
        near, known = near + int((off < _NEAR_SIGMAS).sum()), known + len(off)
    share = near / max(known, 1)
    reason = (
        f"{100 * share:.0f} % of {known} keypoints lie within {_NEAR_SIGMAS:g} sigma of the model"
    )
    if share < _LOST_KEYPOINTS:
        return Status.LOST, reason
    if share < _DOUBTFUL_KEYPOINTS:
        return Status.DOUBTFUL, reason
    return Status.TRACKED, ""


def _by_cloud(terms: FrameTerms, bones: BonePoses) -> tuple[Status, str]:
    if terms.cloud is None:
        return Status.TRACKED, ""
    share = explained_share(terms.cloud, terms.model, bones, _NEAR_M)
    reason = (
        f"{100 * share:.0f} % of the cloud's points lie within {1e3 * _NEAR_M:g} mm of the model"
    )
    if share < LOST_CLOUD:
        return Status.LOST, reason
    if share < DOUBTFUL_CLOUD:
        return Status.DOUBTFUL, reason
    return Status.TRACKED, ""
