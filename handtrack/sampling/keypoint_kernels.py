"""Compiled cost of a key-point problem: kinematics, observations, priors. `problem` is a KeypointProblem."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import types
from numba.extending import overload

from handtrack.arrays import Floats, Ints
from handtrack.compiled import compiled, inlined
from handtrack.model.kinematics import Frames
from handtrack.model.kinematics_kernels import pose_bones
from handtrack.model.root_turn_kernels import turn_root
from handtrack.terms.bone_system import Sums
from handtrack.terms.collision_kernels import collision_sums
from handtrack.terms.loss import robust, robust_slope

_NEAREST_M = 1e-3  # a point this close to a camera's plane counts as behind it


class Workspace(NamedTuple):
    """What one evaluation writes; made once, used for all starts."""

    joint_params: Floats
    rotation: Floats
    position: Floats
    axis_world: Floats
    root: Floats
    """(5, 3, 3) the root's rotation, its left Jacobian, and how that turns with the rotation vector"""
    screw: Floats
    """(S, 6) of each joint parameter"""
    wrench: Floats
    """(B, 6) gradient by a bone's twist, then of all that hangs on it"""
    stiff: Floats
    """(B, 6, 6) Gauss-Newton's matrix likewise"""
    bent: Floats
    """(B, 6, 6) the rest of the Hessian; its rows belong to the parameter nearer to the root"""
    joint_gradient: Floats
    joint_normal: Floats
    """(S, S) lower triangle; pairs of which none is above the other stay zero"""
    joint_curvature: Floats
    collided: Ints
    """(1,) whether the two below hold anything"""
    bone_gradient: Floats
    """(6B,) of collisions"""
    bone_hessian: Floats
    twist: Floats
    """(B, 6, S) of each bone; needed where parts collide"""


def collides(overlaps):  # pragma: no cover - compiled
    """Return whether a problem has parts that may collide; known at compile time."""
    raise NotImplementedError


@overload(collides)
def _collides(overlaps):  # pragma: no cover - compiled
    if isinstance(overlaps, types.NoneType):
        return lambda overlaps: False
    return lambda overlaps: True


def collisions(overlaps, space, want_system):  # pragma: no cover - compiled
    """Return the cost of parts that overlap, for bones already placed; add their system in bone twists."""
    raise NotImplementedError


@overload(collisions)
def _collisions(overlaps, space, want_system):  # pragma: no cover - compiled
    if isinstance(overlaps, types.NoneType):
        return lambda overlaps, space, want_system: 0.0

    def cost(overlaps, space, want_system):
        frames = Frames(space.rotation, space.position, space.position[0])
        sums = Sums(6 if want_system else 0, space.bone_gradient, space.bone_hessian)
        return collision_sums(frames, overlaps, sums)

    return cost


@compiled
def workspace(problem):  # pragma: no cover - compiled
    """Return a Workspace for a problem."""
    bones, hinges = problem.tree.parent.shape[0], problem.tree.hinge_bone.shape[0]
    count = 6 + hinges
    parts = bones if collides(problem.overlaps) else 0
    return Workspace(
        np.zeros(count), np.zeros((bones, 3, 3)), np.zeros((bones, 3)), np.zeros((hinges, 3)),
        np.zeros((5, 3, 3)), np.zeros((count, 6)), np.zeros((bones, 6)), np.zeros((bones, 6, 6)),
        np.zeros((bones, 6, 6)), np.zeros(count), np.zeros((count, count)), np.zeros((count, count)),
        np.zeros(1, np.int64), np.zeros(6 * parts), np.zeros((6 * parts, 6 * parts)),
        np.zeros((parts, 6, count)),
    )  # fmt: skip


@compiled
def pose(problem, params, space):  # pragma: no cover - compiled
    """Place the bones of solver parameters (P,)."""
    q, (joint, leader, ratio) = space.joint_params, problem.links
    for s in range(q.shape[0]):
        q[s] = problem.shift[s]
    for k in range(joint.shape[0]):
        q[joint[k]] += ratio[k] * params[leader[k]]
    root = space.root
    turn_root(q[3:6], root[0], root[1], root[2:])
    pose_bones(problem.tree, q, root[0], space.rotation, space.position, space.axis_world)


@compiled
def prior_cost(problem, params):  # pragma: no cover - compiled
    cost = problem.prior_cost
    for p in range(params.shape[0]):
        d = params[p] - problem.prior_at[p]
        if d != 0.0:
            half = problem.prior_gradient[p]
            for r in range(params.shape[0]):
                half += 0.5 * problem.prior_hessian[p, r] * (params[r] - problem.prior_at[r])
            cost += d * half
    return cost


@inlined
def _point_cost(problem, k, x, y, z):  # pragma: no cover - compiled
    """Return ½ Σ ρ over the observations of point k at a place; infinite behind a camera."""
    cost = 0.0
    for o in range(problem.seen_start[k], problem.seen_start[k + 1]):
        c = problem.camera[o]
        if c < 0:
            squared = (
                (x - problem.target[o, 0]) ** 2
                + (y - problem.target[o, 1]) ** 2
                + (z - problem.target[o, 2]) ** 2
            )
        else:
            turn, shift = problem.camera_rotation, problem.camera_translation
            a = turn[c, 0, 0] * x + turn[c, 0, 1] * y + turn[c, 0, 2] * z + shift[c, 0]
            b = turn[c, 1, 0] * x + turn[c, 1, 1] * y + turn[c, 1, 2] * z + shift[c, 1]
            d = turn[c, 2, 0] * x + turn[c, 2, 1] * y + turn[c, 2, 2] * z + shift[c, 2]
            if d < _NEAREST_M:
                return np.inf
            u = problem.camera_focal[c, 0] * a / d + problem.camera_middle[c, 0]
            v = problem.camera_focal[c, 1] * b / d + problem.camera_middle[c, 1]
            squared = (u - problem.target[o, 0]) ** 2 + (v - problem.target[o, 1]) ** 2
        squared *= problem.information[o]
        cost += 0.5 * robust(problem.loss, squared)[0]
    return cost


@compiled
def keypoint_cost(problem, params, space):  # pragma: no cover - compiled
    """Return the cost at solver parameters (P,)."""
    pose(problem, params, space)
    cost = prior_cost(problem, params)
    for k in range(problem.point.shape[0]):
        b = problem.point_bone[k]
        x, y, z = place(problem, space, k, b)
        cost += _point_cost(problem, k, x, y, z)
    if cost < np.inf:
        cost += collisions(problem.overlaps, space, False)
    return cost


@inlined
def place(problem, space, k, b):  # pragma: no cover - compiled
    turn, at, p = space.rotation, space.position, problem.point
    x = at[b, 0] + turn[b, 0, 0] * p[k, 0] + turn[b, 0, 1] * p[k, 1] + turn[b, 0, 2] * p[k, 2]
    y = at[b, 1] + turn[b, 1, 0] * p[k, 0] + turn[b, 1, 1] * p[k, 1] + turn[b, 1, 2] * p[k, 2]
    z = at[b, 2] + turn[b, 2, 0] * p[k, 0] + turn[b, 2, 1] * p[k, 1] + turn[b, 2, 2] * p[k, 2]
    return x, y, z


@inlined
def point_forces(problem, k, x, y, z, force, stiffness, bend):  # pragma: no cover - compiled
    """Return a point's cost; fill its gradient (3,), Gauss-Newton matrix and the rest of the Hessian (3, 3)."""
    cost = 0.0
    for i in range(3):
        force[i] = 0.0
        for j in range(3):
            stiffness[i, j] = 0.0
            bend[i, j] = 0.0
    for o in range(problem.seen_start[k], problem.seen_start[k + 1]):
        c, info = problem.camera[o], problem.information[o]
        if c < 0:
            d0, d1, d2 = (
                x - problem.target[o, 0],
                y - problem.target[o, 1],
                z - problem.target[o, 2],
            )
            squared = info * (d0 * d0 + d1 * d1 + d2 * d2)
            value, weight = robust(problem.loss, squared)
            weight *= info
            f0, f1, f2 = d0, d1, d2
            for i in range(3):
                stiffness[i, i] += weight
        else:
            turn, shift = problem.camera_rotation, problem.camera_translation
            fu, fv = problem.camera_focal[c, 0], problem.camera_focal[c, 1]
            a = turn[c, 0, 0] * x + turn[c, 0, 1] * y + turn[c, 0, 2] * z + shift[c, 0]
            b = turn[c, 1, 0] * x + turn[c, 1, 1] * y + turn[c, 1, 2] * z + shift[c, 1]
            d = turn[c, 2, 0] * x + turn[c, 2, 1] * y + turn[c, 2, 2] * z + shift[c, 2]
            if d < _NEAREST_M:
                return np.inf
            u = fu * a / d + problem.camera_middle[c, 0] - problem.target[o, 0]
            v = fv * b / d + problem.camera_middle[c, 1] - problem.target[o, 1]
            squared = info * (u * u + v * v)
            value, weight = robust(problem.loss, squared)
            weight *= info
            uz, vz = -fu * a / (d * d), -fv * b / (d * d)
            nu = (
                fu / d * turn[c, 0, 0] + uz * turn[c, 2, 0],
                fu / d * turn[c, 0, 1] + uz * turn[c, 2, 1],
                fu / d * turn[c, 0, 2] + uz * turn[c, 2, 2],
            )
            nv = (
                fv / d * turn[c, 1, 0] + vz * turn[c, 2, 0],
                fv / d * turn[c, 1, 1] + vz * turn[c, 2, 1],
                fv / d * turn[c, 1, 2] + vz * turn[c, 2, 2],
            )
            f0, f1, f2 = u * nu[0] + v * nv[0], u * nu[1] + v * nv[1], u * nu[2] + v * nv[2]
            pull = (f0, f1, f2)
            for i in range(3):
                for j in range(3):
                    stiffness[i, j] += weight * (nu[i] * nu[j] + nv[i] * nv[j])
                    # a pixel's second derivatives all go with depth: u ∇²u + v ∇²v = −(f zᵀ + z fᵀ)/depth
                    bend[i, j] -= weight / d * (pull[i] * turn[c, 2, j] + turn[c, 2, i] * pull[j])
        cost += 0.5 * value
        force[0] += weight * f0
        force[1] += weight * f1
        force[2] += weight * f2
        second = robust_slope(problem.loss, squared)
        if second != 0.0:
            steep = 2.0 * second * info * info
            along = (f0, f1, f2)
            for i in range(3):
                for j in range(3):
                    bend[i, j] += steep * along[i] * along[j]
    return cost
