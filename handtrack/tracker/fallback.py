"""When a cloud is too poor for all joints: nine freedoms or six in place of all, the fingers held. 2004 paper, section 3.5."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from handtrack.arrays import Floats
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.metaballs import MetaballSurface
from handtrack.model.model_file import load_model
from handtrack.model.transform import ParameterTransform
from handtrack.solver.covariance import joint_position_jacobian
from handtrack.tracker.cloud_terms import SeenCloud
from handtrack.tracker.initialize import carried_over
from handtrack.tracker.result import FrameResult, Status
from handtrack.tracker.settings import TrackerSettings

NEAR_M = 0.006
"""a point this near to the surface was measured on it: three times the usual error"""
POOR, GOOD = 0.8, 0.88
"""agreement below which a cloud is too poor for all joints, and above which it is good enough again"""
_PATCH_MM = 16.0  # errors of a poor cloud hang together over the breadth of a matching window, not over a pixel or two
_STEADIER = 4.0  # times the usual strength of the pull to where the hand was
_CURL = {"mcp_flex": 1.0, "pip_flex": 1.0, "dip_flex": 2.0 / 3.0}
_ALONE = ("thumb_cmc_flex", "thumb_cmc_abd", "wrist_flex", "wrist_abd")


@dataclass(frozen=True)
class Agreement:
    """How well a cloud and the hand found in it agree."""

    explained: float
    """share of the points that lie within NEAR_M of the surface"""
    measured: float
    """share of the surface in view that has a point within NEAR_M"""

    @property
    def share(self) -> float:
        """Return the harmonic mean of both (the F-score of reconstructions): high only where both are."""
        return 2.0 * self.explained * self.measured / max(self.explained + self.measured, 1e-9)

    def is_poor(self, before: Sequence[FrameResult]) -> bool:
        """Return whether all joints would be too many; once it is so, the cloud must be clearly better to end it."""
        return self.share < (GOOD if before and is_simplified(before[-1]) else POOR)

    def is_still_poor(self, before: Sequence[FrameResult]) -> bool:
        """Return whether it was poor and has not become better: fingers are not worth looking for."""
        return bool(before) and is_simplified(before[-1]) and self.share < POOR

    @property
    def note(self) -> str:
        return (
            f"poor cloud: {100 * self.measured:.0f} % of the hand in view was measured, "
            f"{100 * self.explained:.0f} % of the points lie on it"
        )


def agreement(seen: SeenCloud, model: ArticulatedModel, bones: BonePoses) -> Agreement | None:
    """Return how well cloud and model agree at a pose; None where nothing of the surface in view is known.

    It does not ask how sure the fingers are: those of a fist are hidden even from the best sensor. What is asked is
    whether that was measured which could be.
    """
    if seen.emptiness is None:
        return None
    term = seen.emptiness
    hand = np.ones(len(term.bone), bool)
    if model.has_forearm:
        hand = term.bone != model.skeleton.bone("forearm")
    if not hand.any():
        return None
    surface = bones.to_world(term.bone[hand], term.local[hand])
    points = seen.prepared.points[:, : seen.prepared.count].T
    near = KDTree(points).query(surface, distance_upper_bound=NEAR_M)[0] < NEAR_M
    off = np.abs(MetaballSurface.of(model).distance(bones, np.ascontiguousarray(points)))
    return Agreement(
        explained=float(np.mean(off < NEAR_M)),
        measured=float(near.mean()),
    )


def is_simplified(result: FrameResult) -> bool:
    """Return whether a frame was estimated without its fingers: it says nothing of any of them, and is not lost."""
    fingers = result.parameter_std[6:]
    return result.status == Status.DOUBTFUL and len(fingers) > 0 and bool(np.isinf(fingers).all())


@dataclass(frozen=True)
class Simplified:
    """A simpler hand in the place of a whole one."""

    model: ArticulatedModel
    start: Floats
    """its solver parameters (P',) where the whole hand stands"""
    whole: Callable[[Floats], Floats]
    """its solver parameters → the whole hand's joint parameters (S,), fingers held"""
    note: str


def simplified(model: ArticulatedModel, joint: Floats, kind: str) -> Simplified:
    """Return the simpler hand that stands where the whole one stands with joint parameters (S,).

    kind: `auto` is the whole hand's own flesh with the freedoms of glove9: palm, the thumb's base, one bend of the four
    fingers, which otherwise stay as they are. `glove9` and `ball6` are the definitions of that name.
    """
    if kind == "auto":
        few = replace(model, coupling="9", transform=_nine(model, joint))
        start = few.clipped(few.transform.solver_params(joint))
        note = "palm, thumb's base and one bend of the fingers are estimated, the rest is held"
        return Simplified(few, start, few.joint_params, note)
    few = load_model(kind, model.side, model.scale)

    def whole(params: Floats) -> Floats:
        held = joint.copy()
        held[:6] = few.joint_params(params)[:6]
        return held

    start = carried_over(model, model.transform.solver_params(joint), few)
    return Simplified(
        few, start, whole, f"the palm alone is estimated ({kind}), the fingers are held"
    )


def steadier(settings: TrackerSettings) -> TrackerSettings:
    """Return the settings for a poor cloud: errors that hang together, and a hand that stays where it was.

    A velocity from two poor poses would be mostly their errors; a lost finger cannot be looked for, nor a lost hand: among
    wrong points another pose often fits better.
    """
    cloud = replace(settings.cloud, patch_mm=max(settings.cloud.patch_mm, _PATCH_MM))
    follow = replace(
        settings.tracker,
        prediction="none",
        smoothing=_STEADIER * settings.tracker.smoothing,
        escape=False,
        jumps=False,
    )
    calm = replace(settings.model, fallback="none")
    return replace(settings, model=calm, cloud=cloud, tracker=follow)


def in_whole(
    model: ArticulatedModel, found: FrameResult, joint: Floats, held: Simplified, note: str
) -> FrameResult:
    """Return what the simpler hand found as a result of the whole one, whose joint parameters (S,) are given.

    Nothing is said of the fingers: their standard deviations are infinite, and their joints may be as far off as their
    limits let them.
    """
    std = np.full(len(joint), np.inf)
    std[:6] = found.parameter_std[:6]
    params = model.transform.solver_params(joint)
    bones, jacobian, _ = model.linearize(params)
    limits = model.limits.bounds(joint)
    spread = np.zeros(len(joint))
    spread[6:] = np.diff(limits[6:], axis=1)[:, 0] ** 2 / 12.0  # anywhere between them
    palm = np.where(np.isfinite(std[:6]), std[:6], 1.0) ** 2
    spread[:6] = palm
    moves = joint_position_jacobian(model, bones, jacobian)
    return replace(
        found,
        parameters=joint,
        status=max(found.status, Status.DOUBTFUL),
        parameter_std=np.full_like(std, np.inf) if found.status == Status.LOST else std,
        joint_covariance=np.einsum("jas,s,jbs->jab", moves, spread, moves),
        T_world_bone=bones.T_world_bone,
        joint_positions=model.joint_positions(bones),
        keypoints21=model.keypoints21(bones) if model.has_keypoints21 else None,
        note=f"{note}; {held.note}",
    )


def _nine(model: ArticulatedModel, joint: Floats) -> ParameterTransform:
    """Return glove9's freedoms on all joint parameters (S,) around where they are; a forearm keeps its own."""
    names = [*model.parameter_names[:6], *(n for n in model.parameter_names if n in _ALONE), "curl"]
    matrix, offset = np.zeros((len(joint), len(names))), joint.copy()
    for s, name in enumerate(model.parameter_names):
        if name in names:
            matrix[s, names.index(name)], offset[s] = 1.0, 0.0
        elif not name.startswith("thumb"):
            matrix[s, -1] = _CURL.get(name.partition("_")[2], 0.0)
    return ParameterTransform(tuple(names), matrix, offset)
