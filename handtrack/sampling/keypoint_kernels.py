"""Compiled cost, gradient and exact Hessian of a key-point problem. Derived in docs/how-to/one_camera.md.

`problem` is a KeypointProblem. A point X has the second derivatives ω_s × (∂X/∂θ_t) for a hinge s above t, so the exact
Hessian is, like Gauss-Newton's, a sum of 6 × 6 matrices over all that hangs on a bone, and costs hardly more.
"""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled, inlined
from handtrack.model.kinematics_kernels import pose_bones, screws, turn_root
from handtrack.terms.loss import robust, robust_slope

_NEAREST_M = 1e-3  # a point this close to a camera's plane counts as behind it


@compiled
def pose(problem, params):  # pragma: no cover - compiled
    """Place the bones of solver parameters (P,); return their rotation, position, hinges' axes, and for the root (5, 3, 3) its rotation, its
    left Jacobian, and how that turns with the rotation vector.
    """
    bones, hinges = problem.tree[0].shape[0], problem.tree[3].shape[0]
    rotation, position = np.empty((bones, 3, 3)), np.empty((bones, 3))
    axes, root, q = np.empty((hinges, 3)), np.empty((5, 3, 3)), np.zeros(6 + hinges)
    joint, leader, ratio = problem.links
    for k in range(joint.shape[0]):
        q[joint[k]] += ratio[k] * params[leader[k]]
    turn_root(q[3:6], root[0], root[1], root[2:])
    pose_bones(problem.tree, q, root[0], rotation, position, axes)
    return rotation, position, axes, root


@compiled
def prior_cost(problem, params):  # pragma: no cover - compiled
    at, cost, slope, bend = problem.prior
    for p in range(params.shape[0]):
        d = params[p] - at[p]
        if d != 0.0:
            half = slope[p]
            for r in range(params.shape[0]):
                half += 0.5 * bend[p, r] * (params[r] - at[r])
            cost += d * half
    return cost


@inlined
def _to_camera(cameras, c, x, y, z):  # pragma: no cover - compiled
    """Return a point in the frame of camera c."""
    turn, shift, _, _ = cameras
    return (
        turn[c, 0, 0] * x + turn[c, 0, 1] * y + turn[c, 0, 2] * z + shift[c, 0],
        turn[c, 1, 0] * x + turn[c, 1, 1] * y + turn[c, 1, 2] * z + shift[c, 1],
        turn[c, 2, 0] * x + turn[c, 2, 1] * y + turn[c, 2, 2] * z + shift[c, 2],
    )


@inlined
def _point_cost(problem, k, x, y, z):  # pragma: no cover - compiled
    """Return ½ Σ ρ over the observations of point k at a place; infinite behind a camera."""
    cost, (_, _, focal, middle) = 0.0, problem.cameras
    begin, camera, target, information = problem.views
    for o in range(begin[k], begin[k + 1]):
        c = camera[o]
        if c < 0:
            squared = (x - target[o, 0]) ** 2 + (y - target[o, 1]) ** 2 + (z - target[o, 2]) ** 2
        else:
            a, b, d = _to_camera(problem.cameras, c, x, y, z)
            if d < _NEAREST_M:
                return np.inf
            u, v = focal[c, 0] * a / d + middle[c, 0], focal[c, 1] * b / d + middle[c, 1]
            squared = (u - target[o, 0]) ** 2 + (v - target[o, 1]) ** 2
        squared *= information[o]
        cost += 0.5 * robust(problem.loss, squared)[0]
    return cost


@compiled
def keypoint_cost(problem, params):  # pragma: no cover - compiled
    """Return the cost at solver parameters (P,)."""
    rotation, position, _, _ = pose(problem, params)
    cost = prior_cost(problem, params)
    for k in range(problem.points[0].shape[0]):
        x, y, z = place(problem.points, rotation, position, k)
        cost += _point_cost(problem, k, x, y, z)
    return cost


@inlined
def place(points, turn, at, k):  # pragma: no cover - compiled
    b, p = points[0][k], points[1]
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
    turn, _, focal, middle = problem.cameras
    begin, camera, target, information = problem.views
    for o in range(begin[k], begin[k + 1]):
        c, info = camera[o], information[o]
        if c < 0:
            d0, d1, d2 = x - target[o, 0], y - target[o, 1], z - target[o, 2]
            squared = info * (d0 * d0 + d1 * d1 + d2 * d2)
            value, weight = robust(problem.loss, squared)
            weight *= info
            f0, f1, f2 = d0, d1, d2
            for i in range(3):
                stiffness[i, i] += weight
        else:
            fu, fv = focal[c, 0], focal[c, 1]
            a, b, d = _to_camera(problem.cameras, c, x, y, z)
            if d < _NEAREST_M:
                return np.inf
            u = fu * a / d + middle[c, 0] - target[o, 0]
            v = fv * b / d + middle[c, 1] - target[o, 1]
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


@compiled
def keypoint_system(problem, params):  # pragma: no cover - compiled
    """Return the cost, gradient (P,), Gauss-Newton matrix (P, P), and what the exact Hessian has beyond it."""
    rotation, position, axes, root = pose(problem, params)
    parent, size = problem.tree[0], params.shape[0]
    bones, count = parent.shape[0], 6 + axes.shape[0]
    # of each bone by its twist, then of all that hangs on it: gradient, Gauss-Newton's matrix, and the rest of the Hessian, whose rows
    # belong to the parameter nearer to the root
    wrench, stiff, bent = np.zeros((bones, 6)), np.zeros((bones, 6, 6)), np.zeros((bones, 6, 6))
    gradient, normal, curvature = np.empty(size), np.empty((size, size)), np.empty((size, size))
    force, arm = np.empty(3), np.empty(3)
    stiffness, bend, half = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    cost = 0.0
    for k in range(problem.points[0].shape[0]):
        b = problem.points[0][k]
        x, y, z = place(problem.points, rotation, position, k)
        cost += point_forces(problem, k, x, y, z, force, stiffness, bend)
        if not cost < np.inf:
            return np.inf, gradient, normal, curvature
        arm[0] = x - position[0, 0]
        arm[1] = y - position[0, 1]
        arm[2] = z - position[0, 2]
        for i in range(3):
            j, m = (i + 1) % 3, (i + 2) % 3
            wrench[b, i] += force[i]
            wrench[b, 3 + i] += arm[j] * force[m] - arm[m] * force[j]
        _spread(arm, stiffness, half, stiff[b])
        _spread(arm, bend, half, bent[b])
        _add_turning(arm, force, bent[b])
    # sums over all that hangs on a bone: twists share one frame
    for b in range(bones - 1, 0, -1):
        p = parent[b]
        for i in range(6):
            wrench[p, i] += wrench[b, i]
            for j in range(6):
                stiff[p, i, j] += stiff[b, i, j]
                bent[p, i, j] += bent[b, i, j]
    # of joint parameters; of the matrices the lower triangle, zero for pairs of which none is above the other
    screw, g = np.empty((count, 6)), np.zeros(count)
    n, c = np.zeros((count, count)), np.zeros((count, count))
    screws(problem.tree, root[1], axes, position, screw)
    by_stiff, by_bent, (begin, chain) = np.empty(6), np.empty(6), problem.chains
    for t in range(count):
        b, first, last = 0, 0, 0
        if t >= 6:
            b = problem.tree[3][t - 6]
            first, last = begin[b], begin[b + 1]
        for i in range(6):
            g[t] += screw[t, i] * wrench[b, i]
            x, y = 0.0, 0.0
            for j in range(6):
                x += stiff[b, i, j] * screw[t, j]
                y += bent[b, i, j] * screw[t, j]
            by_stiff[i], by_bent[i] = x, y
        for k in range(6 + last - first):  # itself and the hinges above
            s = k if k < 6 else 6 + chain[first + k - 6]
            if s > t:
                break
            for i in range(6):
                n[t, s] += screw[s, i] * by_stiff[i]
                c[t, s] += screw[s, i] * by_bent[i]
    for i in range(3):  # the root's rotation vector: its axes J e_j turn with it
        for j in range(i + 1):
            for m in range(3):
                c[3 + i, 3 + j] += root[2 + i, m, j] * wrench[0, 3 + m]
    _pull_back(problem, params, (g, n, c), gradient, normal, curvature)
    return cost + prior_cost(problem, params), gradient, normal, curvature


@compiled
def _pull_back(problem, params, joint_sums, gradient, normal, curvature):  # pragma: no cover
    """Bring joint parameters' sums to solver parameters and add the priors."""
    g, n, c = joint_sums
    (joint, leader, ratios), size = problem.links, params.shape[0]
    at, _, steep, bend = problem.prior
    for p in range(size):
        slope = steep[p]
        for r in range(size):
            slope += bend[p, r] * (params[r] - at[r])
            normal[p, r] = bend[p, r]
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
