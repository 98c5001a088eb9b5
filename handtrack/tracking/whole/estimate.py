"""All frames of a recording as one problem: what each says, and how poses follow one another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from handtrack.arrays import Array, F, Floats, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.solver.block_banded import REACH, BandedFactor, BlockBanded
from handtrack.terms.bone_system import JointSystem
from handtrack.tracking.frame.constants import POINTS_LAST
from handtrack.tracking.whole.evidence import Evidence
from handtrack.tracking.whole.motion import PLACE, Motion, moved

_SWEEPS = 10
_ENOUGH_M, _ENOUGH_RAD = 1e-4, 1e-3
"""a step that moves no pose by more is the last: 0.1 mm, also at the end of a finger; the next would be a tenth of it"""
_DAMPING, _TIGHTEN, _RELAX, _LEAST, _MOST = 1e-3, 10.0, 0.1, 1e-9, 1e6
_AT_LIMIT = 1e-9
_MOTIONS, _MOTION_SWEEPS = 5, 3
"""times that the motion is estimated with the frames' systems as they are, since reading the frames anew takes longer, and in how
many of the sweeps; then it stands, for poses to settle"""


@dataclass(frozen=True, eq=False)
class WholeEstimate:
    """Poses of frames that follow one another, and how sure they are."""

    poses: Floats[F, P]
    covariance: Floats[F, P, P]
    """of the changes of each pose as `motion.moved` makes them, errors that last counted once"""
    motion: Motion
    costs: Floats[F]
    """what each frame says against its pose"""
    sweeps: int
    why: str
    """`converged`, `sweeps` (used up), or `no descent`"""


@dataclass(frozen=True, eq=False)
class _Swept:
    """What all frames say at their poses."""

    poses: Floats[F, P]
    costs: Floats[F]
    gradient: Floats[F, P]
    hessian: Floats[F, P, P]

    def cost(self, motion: Motion) -> float:
        return float(self.costs.sum()) + motion.cost(self.poses)

    def system(self, motion: Motion) -> tuple[BlockBanded, Floats[F, P]]:
        """Return the whole problem's normal matrix and gradient."""
        matrix, gradient = BlockBanded.zero(*self.poses.shape), self.gradient.copy()
        matrix.blocks[:, 0] += self.hessian
        motion.add_to(matrix, gradient, self.poses)
        return matrix, gradient

    def foretold(self, step: Floats[F, P]) -> Floats[F]:
        """Return what each frame should cost after a step, to second order."""
        bent = np.einsum("fp,fpq,fq->f", step, self.hessian, step)
        return self.costs + (self.gradient * step).sum(axis=1) + 0.5 * bent


def estimate_whole(
    evidence: Evidence,
    frames: Sequence[int],
    poses: Floats[F, P],
    should_stop: Callable[[], bool] = lambda: False,
    tell: Callable[[float], None] = lambda share: None,
) -> WholeEstimate | None:
    """Return the poses that are most probable together, from `poses` on, solver parameters of frames in a row; None when
    stopped.

    Damped Gauss-Newton on all poses at once (banded Cholesky, linear in the frames). Each frame has a damping of its own: one
    that fits worse after a step than its system foretold is held back, the others are not. What lies at a limit and would leave
    is held there. The pushes of the motion are estimated beside (EM). tell: is called with the share that is done, frame by
    frame, since reading them takes longest.
    """
    model = evidence.model
    usual = Motion.usual(evidence.settings.prior, poses.shape[1], evidence.seconds)
    motion = usual.estimated(poses, np.zeros((len(poses), REACH + 1, *usual.pushes.shape)), usual)
    damping = np.full(len(frames), _DAMPING)
    why, sweep = "sweeps", 0

    def swept(poses: Floats[F, P]) -> _Swept:
        systems: list[JointSystem] = []
        for n, frame in enumerate(frames):
            if should_stop():
                raise _StoppedError
            systems.append(evidence.of(frame).linearize(poses[n]))
            tell((sweep + (n + 1) / len(frames)) / (_SWEEPS + 1))
        costs = np.array([system.cost for system in systems])
        gradient = np.stack([system.gradient for system in systems])
        return _Swept(poses, costs, gradient, np.stack([system.hessian for system in systems]))

    try:
        best = swept(_within(model, poses))
        for sweep in range(1, _SWEEPS + 1):
            for _ in range(_MOTIONS if sweep <= _MOTION_SWEEPS else 0):
                factor, pull = _factor(model, best, motion)
                ahead = moved(best.poses, factor.solve(pull))
                motion = motion.estimated(ahead, factor.inverse, usual)
            factor, pull = _factor(model, best, motion, damping)
            step = factor.solve(pull)
            found = swept(_within(model, moved(best.poses, step)))
            gain = best.cost(motion) - found.cost(motion)
            worse = found.costs > np.maximum(best.foretold(step), best.costs)
            damping = np.clip(damping * np.where(worse, _TIGHTEN, _RELAX), _LEAST, _MOST)
            if gain > 0:
                best = found
            elif not worse.any():
                why = "no descent"
                break
            if (np.abs(step[:, PLACE]) < _ENOUGH_M).all() and (
                np.abs(step[:, 3:]) < _ENOUGH_RAD
            ).all():
                why = "converged"
                break
    except _StoppedError:
        return None
    covariance = _stated_covariance(evidence, frames, best, motion)
    return WholeEstimate(best.poses, covariance, motion, best.costs, sweep, why)


class _StoppedError(Exception):
    """Asked to."""


def _stated_covariance(
    evidence: Evidence, frames: Sequence[int], swept: _Swept, motion: Motion
) -> Floats[F, P, P]:
    """Return each pose's covariance where what was seen errs alike from frame to frame: a model's own flesh, and where a
    detector sees its joints, are wrong in the next frame too.

    Of the other frames one in (1 + ρ)/(1 − ρ) is new; and what they say of a direction does not add to what its own frame
    says of it: the surer of both counts.
    """
    old = 2.0 * POINTS_LAST / (1.0 + POINTS_LAST)
    seen = np.stack(
        [evidence.of(frame).seen(pose) for frame, pose in zip(frames, swept.poses, strict=True)]
    )
    others = replace(swept, hessian=swept.hessian - old * seen)
    spread = _factor(evidence.model, others, motion)[0].inverse[:, 0]
    return np.array(
        [_surer(own, np.linalg.inv(cov)) for own, cov in zip(seen, spread, strict=True)]
    )


def _surer(own: Floats[P, P], others: Floats[P, P]) -> Floats[P, P]:
    """Return the covariance in which each direction is as well known as by the surer of two informations, those in which both
    are diagonal; others: without a direction that nothing holds, and with a small part of own.
    """
    root = np.linalg.cholesky(own + others)
    share = np.linalg.solve(root, np.linalg.solve(root, own).T)
    values, vectors = np.linalg.eigh(0.5 * (share + share.T))
    back = np.linalg.solve(root.T, vectors)
    return (back / np.maximum(values, 1.0 - values)) @ back.T


def _factor(
    model: ArticulatedModel, swept: _Swept, motion: Motion, damping: Floats[F] | None = None
) -> tuple[BandedFactor, Floats[F, P]]:
    """Return the factor of the system, and its right side, in which nothing moves that a limit stops."""
    matrix, gradient = swept.system(motion)
    own = np.diagonal(matrix.blocks[:, 0], axis1=1, axis2=2)
    extra = _LEAST * own if damping is None else damping[:, None] * own
    stopped = _stopped(model, swept.poses, gradient)
    free = ~stopped
    for k in range(matrix.blocks.shape[1]):
        rows = free[k:] if k else free
        both = rows[:, :, None] & free[: len(rows), None, :]
        matrix.blocks[: len(rows), k] *= both
    every = np.arange(gradient.shape[1])
    matrix.blocks[:, 0, every, every] += np.where(free, extra, 1.0 + own)
    return matrix.factor(), np.where(free, -gradient, 0.0)


def _stopped(model: ArticulatedModel, poses: Floats[F, P], gradient: Floats[F, P]) -> Array[F, P]:
    """Return what lies at a limit that it would leave."""
    low, high = np.moveaxis(np.array([model.bounds(pose) for pose in poses]), 2, 0)
    return ((poses <= low + _AT_LIMIT) & (gradient > 0)) | (
        (poses >= high - _AT_LIMIT) & (gradient < 0)
    )


def _within(model: ArticulatedModel, poses: Floats[F, P]) -> Floats[F, P]:
    return np.array([model.clipped(pose) for pose in poses])
