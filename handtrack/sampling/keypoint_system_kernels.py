"""Compiled gradient and exact Hessian of a key-point problem. Derived in docs/how-to/one_camera.md.

`problem` is a KeypointProblem. A point X has the second derivatives ω_s × (∂X/∂θ_t) for a hinge s above t, so the exact
Hessian is, like Gauss-Newton's, a sum of 6 × 6 matrices over all that hangs on a bone, and costs hardly more. Of
collisions only Gauss-Newton's part is added.
"""

from __future__ import annotations

import numba
import numpy as np
from numba import types
from numba.extending import overload

from handtrack.model.kinematics_kernels import twist_columns
from handtrack.sampling.keypoint_kernels import (
    collisions,
    place,
    point_forces,
    pose,
    prior_cost,
)
from handtrack.terms.bone_kernels import pull_back
from handtrack.terms.bone_system import Sums


@numba.njit(cache=True, nogil=True)
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


@numba.njit(cache=True, nogil=True)
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


@numba.njit(cache=True, nogil=True, inline="always")
def _screws(problem, space):  # pragma: no cover - compiled
    """Fill the screw (S, 6) of every joint parameter: world axes, about the root."""
    screw, at, axes, turn = space.screw, space.position, space.axis_world, space.root_jacobian
    for s in range(3):
        for i in range(3):
            screw[s, i] = 1.0 if i == s else 0.0
            screw[s, 3 + i] = 0.0
            screw[3 + s, i] = 0.0
            screw[3 + s, 3 + i] = turn[i, s]
    for h in range(problem.hinge_bone.shape[0]):
        b = problem.hinge_bone[h]
        w0, w1, w2 = axes[h, 0], axes[h, 1], axes[h, 2]
        r0, r1, r2 = at[b, 0] - at[0, 0], at[b, 1] - at[0, 1], at[b, 2] - at[0, 2]
        screw[6 + h, 0] = r1 * w2 - r2 * w1
        screw[6 + h, 1] = r2 * w0 - r0 * w2
        screw[6 + h, 2] = r0 * w1 - r1 * w0
        screw[6 + h, 3], screw[6 + h, 4], screw[6 + h, 5] = w0, w1, w2


@numba.njit(cache=True, nogil=True, inline="always")
def _dress(problem, space, t, b, first, last, gradient, normal, curvature):  # pragma: no cover
    """Fill gradient and both matrices' row of joint parameter t, which moves bone b and all after it.

    The parameters above it are the root's and the chain's entries first … last − 1.
    """
    screw, wrench = space.screw, space.wrench
    stiff, bent, by_stiff, by_bent = space.stiff, space.bent, space.by_stiff, space.by_bent
    slope = 0.0
    for i in range(6):
        slope += screw[t, i] * wrench[b, i]
        x, y = 0.0, 0.0
        for j in range(6):
            x += stiff[b, i, j] * screw[t, j]
            y += bent[b, i, j] * screw[t, j]
        by_stiff[i], by_bent[i] = x, y
    gradient[t] = slope
    for n in range(6 + last - first):
        s = n if n < 6 else 6 + problem.chain[first + n - 6]
        if s > t:
            break
        x, y = 0.0, 0.0
        for i in range(6):
            x += screw[s, i] * by_stiff[i]
            y += screw[s, i] * by_bent[i]
        normal[t, s] = x
        curvature[t, s] = y


@numba.njit(cache=True, nogil=True)
def keypoint_system(problem, params, space, gradient, normal, curvature):  # pragma: no cover
    """Return the cost; fill gradient (P,), Gauss-Newton matrix (P, P), and what the exact Hessian has beyond it."""
    pose(problem, params, space)
    bones = problem.parent.shape[0]
    force, arm, wrench = space.force, space.arm, space.wrench
    wrench[:] = 0.0
    space.stiff[:] = 0.0
    space.bent[:] = 0.0
    cost = 0.0
    for k in range(problem.point.shape[0]):
        b = problem.point_bone[k]
        x, y, z = place(problem, space, k, b)
        cost += point_forces(problem, k, x, y, z, force, space.stiffness, space.bend)
        if not cost < np.inf:
            return np.inf
        arm[0] = x - space.position[0, 0]
        arm[1] = y - space.position[0, 1]
        arm[2] = z - space.position[0, 2]
        for i in range(3):
            j, m = (i + 1) % 3, (i + 2) % 3
            wrench[b, i] += force[i]
            wrench[b, 3 + i] += arm[j] * force[m] - arm[m] * force[j]
        _spread(arm, space.stiffness, space.half, space.stiff[b])
        _spread(arm, space.bend, space.half, space.bent[b])
        _add_turning(arm, force, space.bent[b])
    for b in range(bones - 1, 0, -1):  # sums over all that hangs on a bone: twists share one frame
        p = problem.parent[b]
        for i in range(6):
            wrench[p, i] += wrench[b, i]
            for j in range(6):
                space.stiff[p, i, j] += space.stiff[b, i, j]
                space.bent[p, i, j] += space.bent[b, i, j]
    _screws(problem, space)
    g, n, c = space.joint_gradient, space.joint_normal, space.joint_curvature
    if space.collided.sum() > 0:  # what a collision left between limbs, and in the twists
        n[:] = 0.0
        space.bone_gradient[:] = 0.0
        space.bone_hessian[:] = 0.0
        space.collided[0] = 0
    for t in range(6):
        _dress(problem, space, t, 0, 0, 0, g, n, c)
    for h in range(problem.hinge_bone.shape[0]):
        b = problem.hinge_bone[h]
        first, last = problem.chain_start[b], problem.chain_start[b + 1]
        _dress(problem, space, 6 + h, b, first, last, g, n, c)
    cost += add_collisions(problem.overlaps, problem, space, g, n)
    turn = space.root_slope
    for i in range(3):  # the root's rotation vector: its axes J e_j turn with it
        for j in range(i + 1):
            for m in range(3):
                c[3 + i, 3 + j] += turn[i, m, j] * wrench[0, 3 + m]
    _pull_back(problem, params, g, n, c, gradient, normal, curvature)
    return cost + prior_cost(problem, params)


def add_collisions(overlaps, problem, space, gradient, normal):  # pragma: no cover - compiled
    """Return the cost of parts that overlap; add gradient (S,) and Gauss-Newton matrix (lower triangle)."""
    raise NotImplementedError


@overload(add_collisions)
def _add_collisions(overlaps, problem, space, gradient, normal):  # pragma: no cover - compiled
    if isinstance(overlaps, types.NoneType):
        return lambda overlaps, problem, space, gradient, normal: 0.0

    def add(overlaps, problem, space, gradient, normal):
        cost = collisions(overlaps, space, True)
        if cost > 0.0:
            space.collided[0] = 1
            twist_columns(
                space.root_jacobian, problem.parent, problem.hinge_bone, space.axis_world,
                space.position, space.twist,
            )  # fmt: skip
            g, h = pull_back(Sums(6, space.bone_gradient, space.bone_hessian), space.twist)
            for s in range(gradient.shape[0]):
                gradient[s] += g[s]
                for t in range(s + 1):
                    normal[s, t] += h[s, t]
        return cost

    return add


@numba.njit(cache=True, nogil=True)
def _pull_back(problem, params, g, n, c, gradient, normal, curvature):  # pragma: no cover
    """Bring joint parameters' sums to solver parameters and add the priors."""
    size = params.shape[0]
    for p in range(size):
        slope = problem.prior_gradient[p]
        for r in range(size):
            slope += problem.prior_hessian[p, r] * (params[r] - problem.prior_at[r])
            normal[p, r] = problem.prior_hessian[p, r]
            curvature[p, r] = 0.0
        gradient[p] = slope
    for a in range(problem.joint.shape[0]):
        s, p, ratio = problem.joint[a], problem.leader[a], problem.ratio[a]
        gradient[p] += ratio * g[s]
        for b in range(problem.joint.shape[0]):
            t, r = problem.joint[b], problem.leader[b]
            if t > s:
                continue
            both = ratio * problem.ratio[b]
            x, y = both * n[s, t], both * c[s, t]
            normal[p, r] += x
            curvature[p, r] += y
            if s != t:
                normal[r, p] += x
                curvature[r, p] += y
