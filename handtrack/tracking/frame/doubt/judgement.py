"""A solved frame judged: what is stated of its joints, how probably it is wrong, its status, and the reason."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from handtrack.arrays import D3, Floats, J, K, P, array_dataclass
from handtrack.model.articulated import FINGERS, ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.size import is_unmeasured
from handtrack.observation.observation import ImageKeypoints
from handtrack.tracking.frame.assessment import assess, odd_size, what_is_open
from handtrack.tracking.frame.doubt import figures
from handtrack.tracking.frame.doubt.mirrored import mirrored_covariance
from handtrack.tracking.frame.doubt.stated import curls, misfit, stated_covariance
from handtrack.tracking.frame.doubt.wrong import (
    BODY_OFF_M,
    FRAME_OFF_M,
    Off,
    Signs,
    moved_sign,
    open_sign,
    part_of,
    probably_beyond,
    probably_off,
    spread_m,
)
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.frame.reason import NEAR_SIGMAS, Reason
from handtrack.tracking.frame.result import PARTS, FrameResult, Status

_WORDS = {**{p: f"{p} finger" for p in PARTS}, "thumb": "thumb", "palm": "palm"}


@array_dataclass
class Judgement:
    """How far a frame can be trusted."""

    status: Status
    reason: Reason | None = None
    joint_covariance: Floats[J, D3, D3] | None = None
    """[m²] as it is stated: of all that is known to be wrong; None where nothing is known of it"""
    p_off_25mm: float = float("nan")
    p_off_10mm: Floats[K] | None = None


def judged(
    terms: FrameTerms,
    params: Floats[P],
    energy: float,
    energies: Mapping[str, float],
    joint_covariance: Floats[J, D3, D3],
    previous: Sequence[FrameResult],
    moved_m: float | None = None,
) -> Judgement:
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
    stated = stated_covariance(model, hidden, joint_covariance, bad, by_cloud)
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
        signs = Signs(
            curled=float(hidden.mean()),
            moved=figures.MOVED_UNKNOWN if moved_m is None else moved_sign(moved_m),
            open=open_sign(joint_covariance),
        )
        off = probably_off(model, stated, signs)
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
        return Judgement(status, reason, stated, known)
    return Judgement(status, reason, stated, off.frame, off.parts)


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
    model: ArticulatedModel, joint_covariance: Floats[J, D3, D3], off: Off | None
) -> Reason | None:
    """Return what most probably is off, where a look costs less than what may be missed."""
    if off is None or off.frame * figures.MISSED <= 1.0:
        return None
    worst = PARTS[int(np.argmax(off.parts))]
    own = np.array([part_of(name) == worst for name in model.joint_names])
    spread_mm = 1e3 * float(spread_m(joint_covariance)[own].max())
    return Reason("off", _WORDS[worst], off.telling, spread_mm, off.frame)


def _may_be_far(model: ArticulatedModel, joint_covariance: Floats[J, D3, D3]) -> Reason | None:
    """Return which joint of a body most probably is as far off as a frame of a hand may be, for its size."""
    if model.kind != "body":
        return None
    beyond = probably_beyond(joint_covariance, BODY_OFF_M)
    worst = int(beyond.argmax())
    if beyond[worst] * figures.MISSED <= 1.0:
        return None
    spread_mm = 1e3 * float(spread_m(joint_covariance)[worst])
    name = model.joint_names[worst].replace("_", " ")
    return Reason("far off", name, number=spread_mm, other=float(beyond[worst]))
