"""When a cloud alone must hold the hand and is poor: its depths are doubted, and the frame says so.

Or a simpler hand takes its place, as in the 2004 paper, section 3.5.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from handtrack.arrays import Floats
from handtrack.geometry.rotation import wrapped
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.model_file import load_model
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.solver.covariance import joint_position_jacobian
from handtrack.tracking.frame.cloud_terms import SeenCloud
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.initialize import carried_over

NEAR_M = 0.006
"""a point this near to the surface was measured on it: three times the usual error"""
POOR, GOOD = 0.8, 0.88
"""agreement below which a cloud's depths are doubted, and above which they are believed again"""


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

    def told(self, result: FrameResult) -> FrameResult:
        """Return a frame that was solved with doubted depths as one that is in doubt itself, and why."""
        note = (
            f"poor cloud: {100 * self.measured:.0f} % of the hand in view was measured, "
            f"{100 * self.explained:.0f} % of the points lie on it"
        )
        if is_simplified(result):
            note = f"{note}; {result.note}"
        status = max(result.status, Status.DOUBTFUL)
        return replace(result, status=status, note=note, unknown=False, poor_cloud=True)


def agreement(seen: SeenCloud, model: ArticulatedModel, bones: BonePoses) -> Agreement | None:
    """Return how well cloud and model agree at a pose; None where nothing of the surface in view is known.

    It does not ask how sure the fingers are: those of a fist are hidden even from the best sensor. What is asked is
    whether that was measured which could be.
    """
    term = seen.emptiness  # of the hand alone
    if term is None or not len(term.bone):
        return None
    surface = bones.to_world(term.bone, term.local)
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
    held = len(fingers) > 0 and bool(np.isinf(fingers).all())
    return held and result.status == Status.DOUBTFUL and not result.unknown


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
    """Return the simpler hand, `glove9` or `ball6`, that stands where the whole one stands with joint parameters (S,)."""
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
    """Return the settings for a poor cloud: doubted depths, and nothing extrapolated or looked for.

    A velocity from two poor poses would be mostly their errors; a lost finger cannot be looked for, nor a lost hand: among
    wrong points another pose often fits better.
    """
    cloud = replace(settings.cloud, doubt_depth=True)
    follow = replace(
        settings.tracker,
        prediction="none",
        escape=False,
        recovery=False,
    )
    calm = replace(settings.model, fallback="none")
    return replace(settings, model=calm, cloud=cloud, tracker=follow)


def held(
    model: ArticulatedModel,
    settings: TrackerSettings,
    params: Floats,
    last: Sequence[FrameResult],
    step: Callable[..., FrameResult],
    on_iteration: Callable[[int, Floats, float], None] | None = None,
) -> FrameResult:
    """Return the frame by a poor cloud: from where the hand was last, its depths doubted; in a first frame from params (P,).

    step: solves the frame with a model and settings, from the last results or a start, telling its iterations.
    """
    calm, kind = steadier(settings), settings.model.fallback
    if kind == "auto":
        return step(model, calm, last, None if last else params, on_iteration)
    joint = last[0].parameters if last else model.joint_params(params)
    few = simplified(model, joint, kind)
    last = [replace(r, parameters=few.model.joint_params(few.start)) for r in last]

    def watch(k: int, x: Floats, cost: float) -> None:
        if on_iteration is not None:
            on_iteration(k, model.transform.solver_params(few.whole(x)), cost)

    found = step(few.model, calm, last, few.start, watch)
    whole = few.whole(few.model.transform.solver_params(found.parameters))
    whole[3:6] = wrapped(whole[3:6])
    return _in_whole(model, found, whole, few)


def _in_whole(
    model: ArticulatedModel, found: FrameResult, joint: Floats, held: Simplified
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
        note=held.note,
        covariance=None,
        unknown=False,
    )
