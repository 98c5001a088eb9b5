"""The interpretation tree: all poses that put the same joints on the same viewing rays of one camera, link by link in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import (
    D2,
    D3,
    Array,
    Floats,
    Ints,
    J,
    K,
    L,
    M,
    N,
    P,
    S,
    array_dataclass,
    check_shape,
    indices,
)
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import rotation_matrix
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses, bone_poses
from handtrack.model.transform import ParameterTransform
from handtrack.sampling.chains import Chain
from handtrack.sampling.limb_ik_kernels import grow, pierce

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
    chain: Chain,
    poses: Sequence[BonePoses],
    joint_params: Floats[N, S],
) -> Branches:
    """Return a branch for each pose that holds only the chain's first joint."""
    rotation = np.stack([bones.rotation[chain.carrier] for bones in poses]) @ chain.carrier_zero.T
    first = model.joint_names.index(chain.joints[0])
    bone, point = model.joint_bone[first], model.joint_point[first]
    end = np.stack([bones.to_world(bone, point) for bones in poses])
    angles = np.ascontiguousarray(joint_params[:, chain.columns])
    for h in chain.hinges(-1):  # these move the first joint: they stay as they are
        rotation = rotation @ rotation_matrix(angles[:, h, None] * chain.turns.axes[h])
    count = len(poses)
    none = np.empty((count, 0), dtype=np.int8)
    return Branches(rotation, end, angles, np.arange(count), none, np.ones(count, dtype=bool))


def extended(
    chain: Chain,
    branches: Branches,
    link: int,
    targets: Floats[N, M, D3],
    missed: Ints[N, M],
    spare: Floats[N, K],
    take_nearest: bool = False,
    tolerance: float = REACHED_M,
) -> Branches:
    """Return the branches with one link more: all solutions for each target (N, T, 3) of its end.

    A branch without a solution within limits ends here; with `take_nearest` it goes on with what is
    nearest, no longer exact.

    Parameters
    ----------
    missed
        0 a target, 1 one that is only the nearest to be had, 2 none.
    spare
        The angles that turns get which the targets leave open.
    """
    hinges = chain.hinges(link)
    first = int(hinges[0]) if len(hinges) else 0
    rotation, end, angles, parent, which, miss = grow(
        chain.turns,
        (first, first + len(hinges)),
        chain.reach[link],
        (branches.rotation, branches.end, branches.angles, spare),
        (targets, missed),
        take_nearest,
        tolerance,
    )
    choice = np.concatenate([branches.choice[parent], which[:, None]], axis=1)
    exact = branches.exact[parent] & (miss <= tolerance)
    return Branches(rotation, end, angles, branches.source[parent], choice, exact)


MOVED_RAD = 0.2
"""an angle by which a flip in depth differs at least from the pose"""


def interpretation_tree(
    model: ArticulatedModel,
    params: Floats[P],
    chains: Sequence[Chain],
    camera: Camera,
    targets_px: Floats[J, D2] | None = None,
    take_nearest: bool = False,
    rng: np.random.Generator | None = None,
) -> Floats[L, P]:
    """Return all poses that differ from `params` by forwards/backwards flips along chains. 2003 paper, §3.

    For each link the sphere about its start, as large as the link is long, is pierced by the viewing ray of
    its end: two depths. Of several angles for the same joint positions the nearest to the given ones count. Chains
    that do not carry each other are solved once, and the leaves are all their combinations.

    Parameters
    ----------
    targets_px
        where the model's joints are seen (NaN where they are not: there, and by default, the given pose's own projection counts)
    take_nearest
        where a ray misses its sphere, a hinge cannot follow or a limit is in the way, go on with what is nearest and leave the
        rest to descent; else the branch ends there
    rng
        draws the twist of a stretched limb within its limits; without it the given one stays
    """
    _check_apart(model, chains)
    joint = model.joint_params(params)
    positions = model.joint_positions(model.bones(params))
    pixels = camera.project(positions)
    if targets_px is not None:
        check_shape(targets_px, pixels.shape, "image positions of the joints")
        pixels = np.where(np.isfinite(targets_px).all(axis=1, keepdims=True), targets_px, pixels)
    rays = camera.rays(pixels)
    leaves = joint[None]
    for number, chain in enumerate(chains):
        carried = _is_carried(chain, chains[:number])
        given = leaves if carried else joint[None]
        branches = _chain_leaves(model, chain, given, camera.centre, rays, take_nearest, rng)
        # the branches of one leaf, or of any leaf alike where the chain's base is the same in all of them
        row, branch = branches.source, np.arange(len(branches.source))
        if not carried:
            row = np.repeat(np.arange(len(leaves)), len(branch))
            branch = np.tile(branch, len(leaves))
        leaves = leaves[row]
        leaves[:, chain.columns[chain.own]] = branches.angles[branch][:, chain.own]
    return _solver_params(model.transform, leaves, params)


def chain_flips(
    model: ArticulatedModel,
    params: Floats[P],
    chain: Chain,
    camera: Camera,
    least_rad: float = MOVED_RAD,
) -> Floats[L, P]:
    """Return the poses in which one chain alone is flipped along a camera's viewing rays, as near
    as limits allow.

    Parameters
    ----------
    least_rad
        By how much some angle of a flip differs at least [rad]; a link that lies across the line of
        sight has none.
    """
    leaves = interpretation_tree(model, params, [chain], camera, take_nearest=True)
    moved = np.abs(leaves - params).max(axis=1) > least_rad
    flips = [model.clipped(leaf) for leaf in leaves[moved]]
    return np.array(flips).reshape(-1, len(params))


def _chain_leaves(
    model: ArticulatedModel,
    chain: Chain,
    given: Floats,
    centre: Floats,
    rays: Floats,
    take_nearest: bool,
    rng: np.random.Generator | None,
) -> Branches:
    """Return one chain's branches from joint parameters (N, S)."""
    poses = [bone_poses(model.skeleton, row) for row in given]
    branches = rooted(model, chain, poses, given)
    spare = branches.angles
    if rng is not None:
        low, high = np.clip(chain.turns.interval.T, -np.pi, np.pi)
        spare = rng.uniform(low, high, size=spare.shape)
    for link, end in enumerate(indices(model.joint_names, chain.joints[1:])):
        length = float(np.linalg.norm(chain.reach[link]))
        count = len(branches.end)
        points = np.empty((count, 2, 3))
        missed = np.empty((count, 2), dtype=np.int8)
        pierce(branches.end, centre, rays[end], length, points, missed, take_nearest)
        branches = extended(
            chain,
            branches,
            link,
            points,
            missed,
            np.ascontiguousarray(spare[branches.source]),
            take_nearest,
            max(REACHED_M, 1e-7 * length),
        )
    branches = _inside(model, chain, branches, given, take_nearest)
    return branches.taken(_closest(branches, given[branches.source][:, chain.columns]))


def _inside(
    model: ArticulatedModel,
    chain: Chain,
    branches: Branches,
    given: Floats,
    take_nearest: bool,
) -> Branches:
    """Return the branches within those limits too that narrow with another parameter."""
    if not np.isin(chain.columns, model.limits.narrowed).any():
        return branches
    joint = given[branches.source]
    joint[:, chain.columns] = branches.angles
    low, high = np.moveaxis(model.limits.bounds(joint)[:, chain.columns], -1, 0)
    moved = np.clip(branches.angles, low, high)
    inside = np.all(np.abs(moved - branches.angles) < REACHED_M, axis=1)
    if not take_nearest:
        return branches.taken(inside)
    return replace(branches, angles=moved, exact=branches.exact & inside)


def _closest(branches: Branches, given: Floats) -> Ints:
    """Return of each set of joint positions the branch that is exact and closest to the angles given (N, K)."""
    far = np.linalg.norm(branches.angles - given, axis=1)
    same = np.column_stack([branches.source, branches.choice])
    order = np.lexsort((far, ~branches.exact, *same.T[::-1]))
    first = np.ones(len(order), dtype=bool)
    first[1:] = (same[order[1:]] != same[order[:-1]]).any(axis=1)
    return order[first]


def _solver_params(transform: ParameterTransform, joint_params: Floats, params: Floats) -> Floats:
    """Return the solver parameters (L, P) of leaves that keep the couplings; what leads nothing stays."""
    found = np.tile(params, (len(joint_params), 1))
    for p, column in enumerate(transform.matrix.T):
        led = np.flatnonzero(column)
        if len(led):
            found[:, p] = joint_params[:, led[0]] / column[led[0]]
    return found


def _is_carried(chain: Chain, earlier: Sequence[Chain]) -> bool:
    """Return whether a chain's base moves with one of the earlier chains."""
    return any(np.isin(other.columns[other.own], chain.base_columns).any() for other in earlier)


def _check_apart(model: ArticulatedModel, chains: Sequence[Chain]) -> None:
    """Raise unless no two chains share a hinge and those that carry others come first."""
    taken: dict[int, str] = {}
    for chain in chains:
        name = chain.name
        for other in chains[chains.index(chain) + 1 :]:
            if np.isin(other.columns[other.own], chain.base_columns).any():
                raise HandtrackError(
                    f"chains '{name}' and '{other.name}': the second carries the first; name it first."
                )
        for column in chain.columns[chain.own]:
            if int(column) in taken:
                raise HandtrackError(
                    f"chains '{taken[int(column)]}' and '{name}' both move "
                    f"'{model.parameter_names[column]}'; the chains of one tree are apart from each other."
                )
            taken[int(column)] = name
