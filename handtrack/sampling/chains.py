"""Chains: limbs and fingers as links between joints, with the hinges that move each link's end."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from handtrack.arrays import D2, D3, Array, C, Floats, Ints, J, K, L, M, P, array_dataclass, indices
from handtrack.errors import HandtrackError, check_name, index_of
from handtrack.model.articulated import FINGERS, ArticulatedModel, keypoint_names

_SAME_POINT_M = 1e-9
_HELD = -1
_TO_FLIP = 2  # freedoms that move a link's end anywhere on its sphere (2003 paper, §3.1)
_LIMBS = {"arm": ("shoulder", "elbow", "wrist", "hand"), "leg": ("hip", "knee", "ankle", "toe")}


@array_dataclass
class Chain:
    """Joints that are jumped together, and their geometry at the zero pose, where rotations are a product of turns about fixed axes.

    Hinge by hinge in kinematic order, K of them; L links. A link's end is moved by its own hinges, all of
    which pass through its start: a bone's twist belongs to the link after it, for it does not move the
    bone's own end.
    """

    name: str
    joints: tuple[str, ...]
    """the one nearest to the root first"""
    parameters: tuple[str, ...]
    """the solver parameters that move this chain and nothing else"""
    carrier: int
    """the bone that carries the chain: parent of the first hinge's bone"""
    carrier_zero: Floats[D3, D3]
    """its rotation at the zero pose"""
    columns: Ints[K]
    """joint parameter of each hinge"""
    axes: Floats[K, D3]
    """of the hinges at the zero pose, world"""
    leader: Ints[K]
    """the hinge that this one follows; itself when free; −1 when it keeps its angle"""
    ratio: Floats[K]
    """to the leader's angle"""
    interval: Floats[K, D2]
    """limits [rad]"""
    link: Ints[K]
    """the link that a hinge moves; −1: it moves the first joint or other limbs and is left alone; L: it moves no
    joint of the chain"""
    reach: Floats[L, D3]
    """from a link's start to its end at the zero pose [m]"""

    @property
    def own(self) -> Array[K]:
        """Return which hinges the chain moves."""
        return (self.link >= 0) & (self.link < len(self.reach))

    def hinges(self, link: int) -> Ints[M]:
        """Return the places among the chain's hinges of those that move a link's end."""
        return np.flatnonzero(self.link == link)


@lru_cache(maxsize=8)
def chains_of(model: ArticulatedModel, wanted: tuple[str, ...] = ("all",)) -> tuple[Chain, ...]:
    """Return the chains that a model's joints offer: fingers of a hand; neck, arms and legs of a
    body.

    Parameters
    ----------
    wanted
        Only those of these names.

    Raises
    ------
    HandtrackError
        For a name that none has.
    """
    names = keypoint_names()[1:]
    offered = [(finger, names[4 * i : 4 * i + 4]) for i, finger in enumerate(FINGERS)]
    offered.append(("neck", ("neck", "head_top")))
    for side in ("left", "right"):
        for limb, joints in _LIMBS.items():
            named = tuple(f"{side}_{joint}" for joint in joints)
            there = tuple(joint for joint in named if joint in model.joint_names)
            if there[:3] == named[:3]:
                offered.append((f"{side}_{limb}", _flipping(model, there)))
    there = {name: joints for name, joints in offered if set(joints) <= set(model.joint_names)}
    names = tuple(there) if wanted == ("all",) else tuple(dict.fromkeys(wanted))
    for name in names:
        check_name("chain", name, there, "mixture.chains")
    return tuple(chain_along(model, name, there[name]) for name in names)


def _flipping(model: ArticulatedModel, joints: tuple[str, ...]) -> tuple[str, ...]:
    """Return a limb's joints without those at its end that fewer than two hinges of their own swing: they cannot flip."""
    moved = moved_joints(model)[indices(model.joint_names, joints)]
    swung = (moved[1:] & ~moved[:-1]).sum(axis=1) >= _TO_FLIP
    return joints[: 2 + int(np.flatnonzero(swung)[-1])] if swung.any() else joints[:2]


def chain_along(model: ArticulatedModel, name: str, joints: Sequence[str]) -> Chain:
    """Return the chain through named joints of a model; HandtrackError for an unknown joint, and where a link's length is not fixed by the
    skeleton.
    """
    skeleton, matrix = model.skeleton, model.transform.matrix
    columns, link = _hinges_between(model, joints)
    zero = model.bones(model.params_from({}))
    points = model.joint_positions(zero)
    places = np.array(indices(model.joint_names, joints))
    bone = skeleton.hinge_bone[columns - 6]
    axes = np.einsum("kij,kj->ki", zero.rotation[bone], skeleton.hinge_axis[columns - 6])
    inside = (link >= 0) & (link < len(joints) - 1)
    for k in np.flatnonzero(inside):
        arm = points[places[link[k]]] - zero.position[bone[k]]
        if np.linalg.norm(np.cross(axes[k], arm)) > 1e-6:
            raise HandtrackError(
                f"chain '{name}': '{model.parameter_names[columns[k]]}' changes the distance between "
                f"{joints[link[k]]} and {joints[link[k] + 1]}; name the joint between them as well."
            )
    own = _leading_only(model, columns[inside])
    # −1: a hinge whose parameter reaches outside keeps its angle
    leader, ratio = np.full(len(columns), _HELD), np.ones(len(columns))
    for p in _leading_only(model, columns[link >= 0]):
        led = np.flatnonzero(matrix[columns, p])
        leader[led] = led[0]
        ratio[led] = matrix[columns[led], p] / matrix[columns[led[0]], p]
    carrier = int(skeleton.parent[bone[0]])
    return Chain(
        name=name,
        joints=tuple(joints),
        parameters=tuple(model.transform.names[p] for p in own),
        carrier=carrier,
        carrier_zero=zero.rotation[carrier],
        columns=columns,
        axes=axes,
        leader=leader,
        ratio=ratio,
        interval=model.limits.interval[columns],
        link=link,
        reach=np.diff(points[places], axis=0),
    )


def moved_joints(model: ArticulatedModel) -> Array[J, K]:
    """Return (J, H) which hinges move which joints: those before one, unless it lies on their axis in every pose."""
    skeleton = model.skeleton
    zero = model.bones(model.params_from({}))
    bone = skeleton.hinge_bone
    axis = np.einsum("hij,hj->hi", zero.rotation[bone], skeleton.hinge_axis)
    arm = model.joint_positions(zero)[:, None] - zero.position[bone]
    on_axis = np.linalg.norm(np.cross(axis, arm), axis=2) < _SAME_POINT_M
    moved = np.zeros_like(on_axis, dtype=bool)
    for j, carrier in enumerate(model.joint_bone):
        before = skeleton.hinges_above(int(carrier))
        swinging = before[
            ~on_axis[j, before]
        ]  # hinges before the last of these swing the joint off their own axes
        if len(swinging):
            moved[j, before[before <= swinging[-1]]] = True
    return moved


def _hinges_between(model: ArticulatedModel, joints: Sequence[str]) -> tuple[Ints, Ints]:
    """Return the joint parameters (K,) of a chain's hinges in kinematic order, and the link of each."""
    index = [index_of("joint", joint, model.joint_names, "a chain") for joint in joints]
    moved = moved_joints(model)
    own = moved[index]
    hinge_bone = model.skeleton.hinge_bone
    moving = np.flatnonzero(own[-1] & ~own[0])
    if not len(moving):
        raise HandtrackError(
            f"chain {' – '.join(joints)}: no hinge moves its last joint but not its first; a chain runs "
            "outwards from the root, over at least one hinge."
        )
    link = np.where(own.any(axis=0), np.argmax(own, axis=0), len(joints)) - 1
    root = hinge_bone[np.flatnonzero(own[1] & ~own[0])[-1:]]
    if len(
        root
    ):  # a twist of the trunk moves the neck's end, but other limbs too: it is none of the neck's
        beyond = [root[0] in model.skeleton.ancestors(int(bone)) for bone in model.joint_bone]
        link[moved[~np.array(beyond)].any(axis=0)] = -1
    path = np.isin(hinge_bone, model.skeleton.ancestors(int(model.joint_bone[index[-1]])))
    used = hinge_bone[path & (link >= 0) & own[-1]]
    hinges = np.flatnonzero(path & (hinge_bone >= used[0]) & (hinge_bone <= used[-1]))
    return hinges + 6, link[hinges]


def _leading_only(model: ArticulatedModel, columns: Ints[K]) -> list[int]:
    """Return the solver parameters that lead some of these joint parameters and no others."""
    joint, leader, _ = model.transform.links
    inside = np.isin(joint, columns)
    return sorted({*leader[inside].tolist()} - {*leader[~inside].tolist()})


_LEADING = 0.95  # share of the total variance that the leading directions make up


def chain_votes(
    model: ArticulatedModel, params: Floats[P], covariance: Floats[P, P], chains: Sequence[Chain]
) -> Floats[C]:
    """Return the probability of each chain to be jumped at a minimum with a covariance.

    A chain's vote is Σ_k λ_k Σ_p u_k[p]², over the leading eigenpairs of the covariance in units of the limits' ranges
    and over the chain's own parameters p. Without any uncertainty all chains are alike. 2003 paper, §4. A model without
    chains has no votes.
    """
    if not chains:
        return np.zeros(0)
    low, high = model.bounds(params).T
    width = np.where(high > low, high - low, np.inf)
    scaled = covariance / (width[:, None] * width)
    values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    total = values.sum()
    if not total > 0.0:
        return np.full(len(chains), 1.0 / len(chains))
    count = int(np.searchsorted(np.cumsum(values), _LEADING * total)) + 1
    share = (vectors[:, :count] ** 2) @ values[:count]
    names = model.transform.names
    votes = np.array([sum(share[names.index(p)] for p in c.parameters) for c in chains])
    if not votes.sum() > 0.0:
        return np.full(len(chains), 1.0 / len(chains))
    return votes / votes.sum()
