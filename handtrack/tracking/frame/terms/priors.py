"""What is assumed of a pose before anything is seen, and how joints go together: one builder for tracking, searches and first poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats, P, S
from handtrack.model.articulated import ArticulatedModel
from handtrack.terms.loss import Loss
from handtrack.terms.priors import GaussianPrior, LinearPrior
from handtrack.terms.term import ParameterTerm
from handtrack.tracking.frame.settings import PriorSettings

# (parameter, ratio, other, sigma in degrees): parameter ≈ ratio · other. The last two joints of a finger share
# a tendon (2/3: the 2004 paper; Lin, Wu & Huang 2000). Neighbouring fingers move each other, index and thumb
# least, ring most: Häger-Ross & Schieber (2000), "Quantifying the independence of human finger movements",
# J. Neurosci. 20(22). The widths are about twice the spread of such differences in everyday postures. Knuckle and middle joint
# bend together in the first synergy of grasping (Santello, Flanders & Soechting 1998, J. Neurosci. 18(23)), though a hook or a
# flat hand bent at the knuckles parts them: a wide Gaussian, so that what a fist hides is closed where its knuckles are bent.
# The ratio of the last two joints differs: 0.76 in index fingers that move freely (Hahn et al. 1995, J. Biomech. 28(10)), less about a thin bar
# than about a thick one (Shimawaki et al. 2019, Appl. Bionics Biomech. 2839648, by CT). A spread of 0.2 covers them.
_RATIO_SPREAD = 0.2
_TOGETHER = (
    [("thumb_ip_flex", 2 / 3, "thumb_mcp_flex", 25.0)]
    + [
        (f"{f}_dip_flex", 2 / 3, f"{f}_pip_flex", 14.0)
        for f in ("index", "middle", "ring", "little")
    ]
    + [
        (f"{a}_{joint}_flex", 1.0, f"{b}_{joint}_flex", sigma)
        for a, b, sigma in (
            ("index", "middle", 35.0),
            ("middle", "ring", 20.0),
            ("ring", "little", 20.0),
        )
        for joint in ("mcp", "pip")
    ]
    + [(f"{f}_pip_flex", 1.0, f"{f}_mcp_flex", 45.0) for f in ("index", "middle", "ring", "little")]
)

# (parameter, sigma in degrees): trunk, neck and hips of a body are upright and straight more often than not. Our own round
# numbers, not taken from a study; the joints' ranges are two to three times as wide. Enough to say which of two poses that look the
# same is the usual one. Limbs are left free.
_UPRIGHT = (
    ("spine_flex", 25.0),
    ("spine_lean", 15.0),
    ("spine_twist", 20.0),
    ("neck_flex", 25.0),
    ("neck_lean", 15.0),
    ("neck_twist", 30.0),
    *((f"{side}_hip_abd", 20.0) for side in ("left", "right")),
    *((f"{side}_hip_twist", 20.0) for side in ("left", "right")),
    *((f"{side}_ankle_flex", 25.0) for side in ("left", "right")),
)


# What is heavy turns less abruptly: in the CMU clip 01_01 (jumping; retargeted to body34, 24 frames a second) the unknown acceleration
# of these angles is 1 to 2 degrees a frame (root mean square), that of the other joints of arms and legs 1.5 to 6.
_HEAVY = ("root_r", "spine_", "neck_", "clavicle_", "hip_abd", "hip_twist")
_HEAVY_SHARE = 0.4


def agility(model: ArticulatedModel) -> Floats[S]:
    """Return how abruptly each joint parameter moves, as a share of `prior.motion_sigma_*`; 1 for a hand."""
    if model.kind != "body":
        return np.ones(len(model.parameter_names))
    heavy = [any(part in name for part in _HEAVY) for name in model.parameter_names]
    return np.where(heavy, _HEAVY_SHARE, 1.0)


def posture_prior(model: ArticulatedModel, strength: float) -> LinearPrior | None:
    """Return the prior for a model's joint parameters; None for a model that is neither a hand nor a body."""
    names = model.parameter_names
    table = [*_TOGETHER, *((name, 0.0, name, sigma) for name, sigma in _UPRIGHT)]
    known = [row for row in table if row[0] in names and row[2] in names]
    if not known:
        return None
    rows, ratios = np.zeros((2, len(known), len(names)))
    for n, (name, ratio, other, _) in enumerate(known):
        rows[n, names.index(name)] = 1.0
        rows[n, names.index(other)] -= ratio
        ratios[n, names.index(other)] = _RATIO_SPREAD if name.endswith("_dip_flex") else 0.0
    sigmas = np.deg2rad([row[3] for row in known])[:, None]
    return LinearPrior(rows / sigmas, weight=strength, ratios=ratios / sigmas)


SEARCH_REST_RAD = np.deg2rad(50.0)
"""width of the pull to the relaxed hand while a search compares poses: half a finger's range; `bench auto_start`"""
POINTS_REST_RAD, _BODY_REST_RAD = np.deg2rad(40.0), np.deg2rad(80.0)
"""the same where a pose is fitted to 21 points, which leave only a finger's turn about itself open; of a body, whose joints go further, as
weak as in tracking"""


def points_rest(model: ArticulatedModel) -> float:
    """Return the width [rad] of the pull to rest where a pose is fitted to all joints."""
    return _BODY_REST_RAD if model.kind == "body" else POINTS_REST_RAD


def pose_priors(
    model: ArticulatedModel,
    rest_rad: float,
    posture: float = 1.0,
    posture_loss: Loss | None = None,
) -> list[ParameterTerm]:
    """Return the priors of a pose by itself: relaxed; hard-to-measure freedoms, such as the
    clavicles', near rest; joints that go together.

    Parameters
    ----------
    rest_rad
        Standard deviation of joint angles from the relaxed hand's; 0 leaves that prior out.
    posture
        Strength of what is known of joints that go together.
    posture_loss
        How it counts where it does not hold.
    """
    terms: list[ParameterTerm] = []
    if rest_rad > 0:
        sigma = np.full(len(model.parameter_names), rest_rad)
        sigma[:6] = np.inf
        terms.append(GaussianPrior(model.rest, sigma, "rest"))
    if model.stabilise is not None:
        terms.append(GaussianPrior(model.rest, model.stabilise, "stabilise"))
    together = posture_prior(model, posture) if posture > 0 else None
    if together is not None:
        terms.append(together if posture_loss is None else replace(together, loss=posture_loss))
    return terms


def motion_sigma(prior: PriorSettings, size: int) -> Floats[P]:
    """Return how far so many parameters may be from their prediction for the next frame, a standard deviation [m, rad]."""
    sigma = np.full(size, np.deg2rad(prior.motion_sigma_deg))
    sigma[:3] = prior.motion_sigma_mm * 1e-3
    return sigma


def motion_prior(
    expected: Floats[S], prior: PriorSettings, smoothing: float, frames_ahead: int
) -> GaussianPrior:
    """Return the pull to the pose that is expected, so many frames after the last one."""
    spread = np.sqrt(max(frames_ahead, 1)) / np.sqrt(smoothing)
    return GaussianPrior(expected, motion_sigma(prior, len(expected)) * spread, "motion")
