"""The interpretation tree: all poses that put the same joints on the same viewing rays of one camera, link by link in closed form."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import D2, D3, Floats, J, K, L, N, P, S, indices
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import rotation_matrix
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import bone_poses
from handtrack.model.transform import ParameterTransform
from handtrack.sampling.chains import Chain
from handtrack.sampling.limb_ik_kernels import grow, pierce

REACHED_M = 1e-9
"""an end this close to its target is on it"""


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
    its end: two depths. Of several angles for the same joint positions the nearest to the given ones count. No chain
    moves another, so each is solved once, and the leaves are all their combinations.

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
    joint = model.joint_params(params)
    positions = model.joint_positions(model.bones(params))
    pixels = camera.project(positions)
    if targets_px is not None:
        pixels = np.where(np.isfinite(targets_px).all(axis=1, keepdims=True), targets_px, pixels)
    rays = camera.rays(pixels)
    leaves = joint[None]
    for chain in chains:
        angles = _chain_leaves(model, chain, joint, camera.centre, rays, take_nearest, rng)
        leaves = np.repeat(leaves, len(angles), axis=0)
        own = np.tile(angles[:, chain.own], (len(leaves) // max(len(angles), 1), 1))
        leaves[:, chain.columns[chain.own]] = own
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
    joint: Floats[S],
    centre: Floats[D3],
    rays: Floats[J, D3],
    take_nearest: bool,
    rng: np.random.Generator | None,
) -> Floats[N, K]:
    """Return the angles of a chain's hinges in all its leaves, from joint parameters: branches grow link by link, from its first joint."""
    given = np.ascontiguousarray(joint[None, chain.columns])
    bones = bone_poses(model.skeleton, joint)
    turn = bones.rotation[[chain.carrier]] @ chain.carrier_zero.T
    for h in chain.hinges(-1):  # these move the first joint: they stay as they are
        turn = turn @ rotation_matrix(given[:, h, None] * chain.axes[h])
    first, *seen = indices(model.joint_names, chain.joints)
    end = bones.to_world(model.joint_bone[first], model.joint_point[first])[None]
    spare = given
    if rng is not None:
        low, high = np.clip(chain.interval.T, -np.pi, np.pi)
        spare = rng.uniform(low, high, size=spare.shape)
    # of each branch: which of the two depths each link's end took, and whether all are on their rays, within limits
    angles, choice, exact = given, np.empty((1, 0), np.int8), np.ones(1, bool)
    for link, joint_seen in enumerate(seen):
        hinges, reach = chain.hinges(link), chain.reach[link]
        begin = int(hinges[0]) if len(hinges) else 0
        length = float(np.linalg.norm(reach))
        tolerance = max(REACHED_M, 1e-7 * length)
        targets, missed = np.empty((len(end), 2, 3)), np.empty((len(end), 2), np.int8)
        pierce(end, centre, rays[joint_seen], length, targets, missed, take_nearest)
        turn, end, angles, parent, which, miss = grow(
            (chain.axes, chain.leader, chain.ratio, chain.interval),
            (begin, begin + len(hinges)),
            reach,
            (turn, end, angles, np.repeat(spare, len(end), axis=0)),
            (targets, missed),
            take_nearest,
            tolerance,
        )
        choice = np.column_stack([choice[parent], which])
        exact = exact[parent] & (miss <= tolerance)
    if np.isin(chain.columns, model.limits.narrowed).any():
        poses = np.repeat(joint[None], len(angles), axis=0)
        poses[:, chain.columns] = angles
        low, high = np.moveaxis(model.limits.bounds(poses)[:, chain.columns], -1, 0)
        moved = np.clip(angles, low, high)
        inside = np.all(np.abs(moved - angles) < REACHED_M, axis=1)
        if take_nearest:
            angles, exact = moved, exact & inside
        else:
            angles, choice, exact = angles[inside], choice[inside], exact[inside]
    # of each choice of depths the branch that is exact and closest to the angles given
    best_first = np.lexsort((np.linalg.norm(angles - given, axis=1), ~exact))
    _, leaves = np.unique(choice[best_first], axis=0, return_index=True)
    return angles[best_first[leaves]]


def _solver_params(transform: ParameterTransform, joint_params: Floats, params: Floats) -> Floats:
    """Return the solver parameters (L, P) of leaves that keep the couplings; what leads nothing stays."""
    found = np.tile(params, (len(joint_params), 1))
    for p, column in enumerate(transform.matrix.T):
        led = np.flatnonzero(column)
        if len(led):
            found[:, p] = joint_params[:, led[0]] / column[led[0]]
    return found
