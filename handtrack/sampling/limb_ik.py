"""Joint angles from joint positions, in closed form along a chain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import D2, D3, Array, Floats, Ints, K, L, M, N, S, array_dataclass
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.limits import Limits
from handtrack.sampling.chains import PreparedChain
from handtrack.sampling.limb_ik_kernels import grow

REACHED_M = 1e-9
"""an end this close to its target is on it"""


@array_dataclass
class Branches:
    """Poses of a chain grown link by link, N of them."""

    rotation: Floats[N, D3, D3]
    """of the last link, zero pose → world"""
    end: Floats[N, D3]
    """the last joint placed so far, world [m]"""
    angles: Floats[N, K]
    """of the chain's hinges [rad]"""
    source: Ints[N]
    """the pose that a branch started from"""
    choice: Ints[N, L]
    """(N, links) which target each link's end took"""
    exact: Array[N]
    """whether every joint is on its target, within limits"""

    def taken(self, rows: Array[N] | Ints[N]) -> Branches:
        """Return some of the branches."""
        return Branches(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


def rooted(
    model: ArticulatedModel,
    chain: PreparedChain,
    poses: Sequence[BonePoses],
    joint_params: Floats[N, S],
) -> Branches:
    """Return a branch for each pose that holds only the chain's first joint."""
    rotation = np.stack([bones.rotation[chain.carrier] for bones in poses]) @ chain.carrier_zero.T
    end = np.stack([bones.to_world(chain.start_bone, chain.start_point) for bones in poses])
    angles = np.ascontiguousarray(joint_params[:, chain.columns])
    for h in chain.hinges(-1):  # these move the first joint: they stay as they are
        turn = np.stack([_turn(chain.turns.axes[h], angle) for angle in angles[:, h]])
        rotation = rotation @ turn
    count = len(poses)
    none = np.empty((count, 0), dtype=np.int8)
    return Branches(rotation, end, angles, np.arange(count), none, np.ones(count, dtype=bool))


def extended(
    chain: PreparedChain,
    branches: Branches,
    link: int,
    targets: Floats[N, M, D3],
    missed: Ints[N, M],
    spare: Floats[N, K],
    take_nearest: bool = False,
    tolerance: float = REACHED_M,
) -> Branches:
    """Return the branches with one link more: all solutions for each target (N, T, 3) of its end.

    missed: 0 a target, 1 one that is only the nearest to be had, 2 none. spare: the angles that
    turns get which the targets leave open. A branch without a solution within limits ends here; with
    `take_nearest` it goes on with what is nearest, no longer exact.
    """
    hinges = chain.hinges(link)
    first = int(hinges[0]) if len(hinges) else 0
    rotation, end, angles, parent, which, miss = grow(
        chain.turns, (first, first + len(hinges)), chain.reach[link],
        (branches.rotation, branches.end, branches.angles, spare), (targets, missed), take_nearest, tolerance,
    )  # fmt: skip
    choice = np.concatenate([branches.choice[parent], which[:, None]], axis=1)
    exact = branches.exact[parent] & (miss <= tolerance)
    return Branches(rotation, end, angles, branches.source[parent], choice, exact)


def bounds_of_many(limits: Limits, joint_params: Floats[N, S]) -> Floats[N, S, D2]:
    """Return the limits that hold at joint parameters; row by row `Limits.bounds`."""
    bounds = np.tile(limits.interval, (len(joint_params), 1, 1))
    for (which, by), at, to in zip(
        limits.narrowed, limits.narrow_at, limits.narrow_to, strict=True
    ):
        share = 1.0 - (1.0 - to) * np.clip(joint_params[:, by] / at, 0.0, 1.0)
        middle = np.clip(0.0, *limits.interval[which])
        bounds[:, which] = middle + share[:, None] * (limits.interval[which] - middle)
    return bounds


def _turn(axis: Floats, angle: float) -> Floats:
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
