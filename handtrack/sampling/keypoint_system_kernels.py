"""Compiled gradient and exact Hessian of a key-point problem. Derived in docs/how-to/one_camera.md.

`problem` is a KeypointProblem. A point X has the second derivatives ω_s × (∂X/∂θ_t) for a hinge s above t, so the exact
Hessian is, like Gauss-Newton's, a sum of 6 × 6 matrices over all that hangs on a bone, and costs hardly more. Of
collisions only Gauss-Newton's part is added.
"""

from __future__ import annotations

import numpy as np
from numba import types
from numba.extending import overload

from handtrack.compiled import compiled, inlined
from handtrack.model.kinematics_kernels import screws, twist_columns
from handtrack.sampling.keypoint_kernels import (
    collisions,
    place,
    point_forces,
    pose,
    prior_cost,
)
from handtrack.terms.bone_kernels import pull_back
from handtrack.terms.bone_system import Sums


@compiled
def _spread(d, m, half, out):  # pragma: no cover - compiled
    """Add Bᵀ M B to out (6, 6), for a point's matrix M (3, 3) and B = [1, −[d]×], the point's motion by a twist."""
    d0, d1, d2 = d[0], d[1], d[2]
    for i in range(3):
        m0, m1, m2 = m[i, 0], m[i, 1], m[i, 2]
        out[i, 0] += m0
        out[i, 1] += m1
        out[i, 2] += m2
        half[i, 0] = d1 * m2 - d2 * m1
        half[i, 1] = d2 * m0 - d0 * m2
        half[i, 2] = d0 * m1 - d1 * m0
    for j in range(3):
        h0, h1, h2 = half[0, j], half[1, j], half[2, j]
        for i in range(3):
            x = half[i, j]
            out[i, 3 + j] += x
            out[3 + j, i] += x
        out[3, 3 + j] += d1 * h2 - d2 * h1
        out[4, 3 + j] += d2 * h0 - d0 * h2
        out[5, 3 + j] += d0 * h1 - d1 * h0


@compiled
def _add_turning(d, f, out):  # pragma: no cover - compiled
    """Add Q (6, 6): for screws s above t, s·Q t = (F × ω_s) · (∂X/∂θ_t), what a force F does as its lever turns."""
    out[3, 1] += f[2]
    out[3, 2] -= f[1]
    out[4, 0] -= f[2]
    out[4, 2] += f[0]
    out[5, 0] += f[1]
    out[5, 1] -= f[0]
    along = d[0] * f[0] + d[1] * f[1] + d[2] * f[2]
    for i in range(3):
        for j in range(3):
            out[3 + i, 3 + j] += d[i] * f[j]
        out[3 + i, 3 + i] -= along


@inlined
def _dress(problem, space, t, by_stiff, by_bent):  # pragma: no cover - compiled
    """Fill gradient and both matrices' row of joint parameter t, from the bone it moves and those above."""
    b, first, last = 0, 0, 0
    if t >= 6:
        b = problem.tree.hinge_bone[t - 6]
        first, last = problem.chain_start[b], problem.chain_start[b + 1]
    screw, wrench = space.screw, space.wrench
    stiff, bent = space.stiff, space.bent
    slope = 0.0
    for i in range(6):
        slope += screw[t, i] * wrench[b, i]
        x, y = 0.0, 0.0
        for j in range(6):
            x += stiff[b, i, j] * screw[t, j]
            y += bent[b, i, j] * screw[t, j]
        by_stiff[i], by_bent[i] = x, y
    space.joint_gradient[t] = slope
    for n in range(6 + last - first):
        s = n if n < 6 else 6 + problem.chain[first + n - 6]
        if s > t:
            break
        x, y = 0.0, 0.0
        for i in range(6):
            x += screw[s, i] * by_stiff[i]
            y += screw[s, i] * by_bent[i]
        space.joint_normal[t, s] = x
        space.joint_curvature[t, s] = y


@compiled
def keypoint_system(problem, params, space, gradient, normal, curvature):  # pragma: no cover
    """Return the cost; fill gradient (P,), Gauss-Newton matrix (P, P), and what the exact Hessian has beyond it."""
    pose(problem, params, space)
    parent = problem.tree.parent
    force, arm, wrench = np.empty(3), np.empty(3), space.wrench
    stiffness, bend, half = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    by_stiff, by_bent = np.empty(6), np.empty(6)
    wrench[:] = 0.0
    space.stiff[:] = 0.0
    space.bent[:] = 0.0
    cost = 0.0
    for k in range(problem.point.shape[0]):
        b = problem.point_bone[k]
        x, y, z = place(problem, space, k, b)
        cost += point_forces(problem, k, x, y, z, force, stiffness, bend)
        if not cost < np.inf:
            return np.inf
        arm[0] = x - space.position[0, 0]
        arm[1] = y - space.position[0, 1]
        arm[2] = z - space.position[0, 2]
        for i in range(3):
            j, m = (i + 1) % 3, (i + 2) % 3
            wrench[b, i] += force[i]
            wrench[b, 3 + i] += arm[j] * force[m] - arm[m] * force[j]
        _spread(arm, stiffness, half, space.stiff[b])
        _spread(arm, bend, half, space.bent[b])
        _add_turning(arm, force, space.bent[b])
    # sums over all that hangs on a bone: twists share one frame
    for b in range(parent.shape[0] - 1, 0, -1):
        p = parent[b]
        for i in range(6):
            wrench[p, i] += wrench[b, i]
            for j in range(6):
                space.stiff[p, i, j] += space.stiff[b, i, j]
                space.bent[p, i, j] += space.bent[b, i, j]
    screws(problem.tree, space.root[1], space.axis_world, space.position, space.screw)
    g, n, c = space.joint_gradient, space.joint_normal, space.joint_curvature
    if space.collided.sum() > 0:  # what a collision left between limbs, and in the twists
        n[:] = 0.0
        space.bone_gradient[:] = 0.0
        space.bone_hessian[:] = 0.0
        space.collided[0] = 0
    for t in range(g.shape[0]):
        _dress(problem, space, t, by_stiff, by_bent)
    cost += add_collisions(problem.overlaps, problem, space)
    turn = space.root[2:]
    for i in range(3):  # the root's rotation vector: its axes J e_j turn with it
        for j in range(i + 1):
            for m in range(3):
                c[3 + i, 3 + j] += turn[i, m, j] * wrench[0, 3 + m]
    _pull_back(problem, params, space, gradient, normal, curvature)
    return cost + prior_cost(problem, params)


def add_collisions(overlaps, problem, space):  # pragma: no cover - compiled
    """Return the cost of parts that overlap; add to the joint gradient (S,) and Gauss-Newton matrix (lower triangle)."""
    raise NotImplementedError


@overload(add_collisions)
def _add_collisions(overlaps, problem, space):  # pragma: no cover - compiled
    if isinstance(overlaps, types.NoneType):
        return lambda overlaps, problem, space: 0.0

    def add(overlaps, problem, space):
        cost = collisions(overlaps, space, True)
        if cost > 0.0:
            space.collided[0] = 1
            twist_columns(problem.tree, space.screw, space.twist)
            g, h = pull_back(Sums(6, space.bone_gradient, space.bone_hessian), space.twist)
            for s in range(g.shape[0]):
                space.joint_gradient[s] += g[s]
                for t in range(s + 1):
                    space.joint_normal[s, t] += h[s, t]
        return cost

    return add


@compiled
def _pull_back(problem, params, space, gradient, normal, curvature):  # pragma: no cover
    """Bring joint parameters' sums to solver parameters and add the priors."""
    g, n, c = space.joint_gradient, space.joint_normal, space.joint_curvature
    (joint, leader, ratios), size = problem.links, params.shape[0]
    for p in range(size):
        slope = problem.prior_gradient[p]
        for r in range(size):
            slope += problem.prior_hessian[p, r] * (params[r] - problem.prior_at[r])
            normal[p, r] = problem.prior_hessian[p, r]
            curvature[p, r] = 0.0
        gradient[p] = slope
    for a in range(joint.shape[0]):
        s, p, ratio = joint[a], leader[a], ratios[a]
        gradient[p] += ratio * g[s]
        for b in range(joint.shape[0]):
            t, r = joint[b], leader[b]
            if t > s:
                continue
            both = ratio * ratios[b]
            x, y = both * n[s, t], both * c[s, t]
            normal[p, r] += x
            curvature[p, r] += y
            if s != t:
                normal[r, p] += x
                curvature[r, p] += y
