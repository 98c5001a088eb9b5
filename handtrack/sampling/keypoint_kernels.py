"""Compiled cost, gradient and exact Hessian of a key-point problem. Derived in docs/jumps.md.

`problem` is a KeypointProblem. A point X of a chain has the second derivatives w_s × (∂X/∂θ_t) for a hinge s above t,
so the exact Hessian costs hardly more than Gauss-Newton's.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from handtrack.arrays import Floats
from handtrack.model.kinematics_kernels import pose_bones

_NEAREST_M = 1e-3  # a point this close to a camera's plane counts as behind it


class Workspace(NamedTuple):
    """What one evaluation writes; made once, used for all starts."""

    joint_params: Floats
    rotation: Floats
    position: Floats
    axis_world: Floats
    root_rotation: Floats
    root_jacobian: Floats
    root_slope: Floats
    arm: Floats
    """(3, S) derivative of a point by the parameters of its chain, in the chain's order"""
    axis: Floats
    """(3, S) their axes"""
    which: Floats
    """(S,) int64 joint parameter of each"""
    pulled: Floats
    force: Floats
    stiffness: Floats
    bend: Floats
    joint_gradient: Floats
    joint_normal: Floats
    joint_curvature: Floats


@numba.njit(cache=True, nogil=True)
def workspace(problem):  # pragma: no cover - compiled
    """Return a Workspace for a problem."""
    bones, hinges = problem.parent.shape[0], problem.hinge_bone.shape[0]
    count = 6 + hinges
    return Workspace(
        np.zeros(count), np.zeros((bones, 3, 3)), np.zeros((bones, 3)), np.zeros((hinges, 3)),
        np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3, 3)), np.zeros((3, count)),
        np.zeros((3, count)), np.zeros(count, np.int64), np.zeros((3, count)), np.zeros(3),
        np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(count), np.zeros((count, count)),
        np.zeros((count, count)),
    )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def turn_root(r, rotation, jacobian, slope):  # pragma: no cover - compiled
    """Fill R(r), its left Jacobian J (3, 3), and slope[i] = ∂J/∂r_i, for a rotation vector r (3,)."""
    t2 = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    t = np.sqrt(t2)
    if t < 0.05:  # series: the closed forms lose digits
        sine = 1.0 - t2 / 6.0 + t2 * t2 / 120.0 - t2 * t2 * t2 / 5040.0
        a = 0.5 - t2 / 24.0 + t2 * t2 / 720.0 - t2 * t2 * t2 / 40320.0
        b = 1.0 / 6.0 - t2 / 120.0 + t2 * t2 / 5040.0 - t2 * t2 * t2 / 362880.0
        da = -1.0 / 12.0 + t2 / 180.0 - t2 * t2 / 6720.0
        db = -1.0 / 60.0 + t2 / 1260.0 - t2 * t2 / 60480.0
    else:
        s, c = np.sin(t), np.cos(t)
        sine = s / t
        a = (1.0 - c) / t2
        b = (t - s) / (t2 * t)
        da = (t * s - 2.0 * (1.0 - c)) / (t2 * t2)
        db = (t * (1.0 - c) - 3.0 * (t - s)) / (t2 * t2 * t)
    for i in range(3):
        for j in range(3):
            square = r[i] * r[j] - (t2 if i == j else 0.0)
            cross = _skew_entry(r, i, j)
            unit = 1.0 if i == j else 0.0
            rotation[i, j] = unit + sine * cross + a * square
            jacobian[i, j] = unit + a * cross + b * square
            for k in range(3):
                moved = (r[j] if i == k else 0.0) + (r[i] if j == k else 0.0)
                moved -= 2.0 * r[k] if i == j else 0.0
                slope[k, i, j] = (da * cross + db * square) * r[k] + b * moved
    for k in range(3):  # the skew matrix's own derivative: a · [e_k]
        i, j = (k + 1) % 3, (k + 2) % 3
        slope[k, i, j] -= a
        slope[k, j, i] += a


@numba.njit(cache=True, nogil=True, inline="always")
def _skew_entry(r, i, j):  # pragma: no cover - compiled
    if i == j:
        return 0.0
    return -r[3 - i - j] if (i + 1) % 3 == j else r[3 - i - j]


@numba.njit(cache=True, nogil=True, inline="always")
def _loss(kind, scale, squared):  # pragma: no cover - compiled
    """Return ρ, ρ′ and ρ″ of a squared residual: terms/loss.py."""
    if kind == 1:
        s2 = scale * scale
        share = s2 / (squared + s2)
        return squared * share, share * share, -2.0 * share * share / (squared + s2)
    if kind == 2 and squared > scale * scale:
        size = np.sqrt(squared)
        return (
            2.0 * scale * size - scale * scale, scale / size, -0.5 * scale / (size * squared),
        )  # fmt: skip
    return squared, 1.0, 0.0


@numba.njit(cache=True, nogil=True)
def _pose(problem, params, space):  # pragma: no cover - compiled
    """Place the bones of solver parameters (P,)."""
    q = space.joint_params
    for s in range(q.shape[0]):
        q[s] = problem.shift[s]
    for k in range(problem.joint.shape[0]):
        q[problem.joint[k]] += problem.ratio[k] * params[problem.leader[k]]
    turn_root(q[3:6], space.root_rotation, space.root_jacobian, space.root_slope)
    pose_bones(
        q, space.root_rotation, problem.parent, problem.offset, problem.rest, problem.hinge_bone,
        problem.hinge_axis, space.rotation, space.position, space.axis_world,
    )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def _prior_cost(problem, params):  # pragma: no cover - compiled
    cost = problem.prior_cost
    for p in range(params.shape[0]):
        d = params[p] - problem.prior_at[p]
        if d != 0.0:
            half = problem.prior_gradient[p]
            for r in range(params.shape[0]):
                half += 0.5 * problem.prior_hessian[p, r] * (params[r] - problem.prior_at[r])
            cost += d * half
    return cost


@numba.njit(cache=True, nogil=True)
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
        cost += 0.5 * _loss(problem.loss_kind, problem.loss_scale, squared)[0]
    return cost


@numba.njit(cache=True, nogil=True)
def keypoint_cost(problem, params, space):  # pragma: no cover - compiled
    """Return the cost at solver parameters (P,)."""
    _pose(problem, params, space)
    cost = _prior_cost(problem, params)
    for k in range(problem.point.shape[0]):
        b = problem.point_bone[k]
        x, y, z = _place(problem, space, k, b)
        cost += _point_cost(problem, k, x, y, z)
    return cost


@numba.njit(cache=True, nogil=True, inline="always")
def _place(problem, space, k, b):  # pragma: no cover - compiled
    turn, at, p = space.rotation, space.position, problem.point
    x = at[b, 0] + turn[b, 0, 0] * p[k, 0] + turn[b, 0, 1] * p[k, 1] + turn[b, 0, 2] * p[k, 2]
    y = at[b, 1] + turn[b, 1, 0] * p[k, 0] + turn[b, 1, 1] * p[k, 1] + turn[b, 1, 2] * p[k, 2]
    z = at[b, 2] + turn[b, 2, 0] * p[k, 0] + turn[b, 2, 1] * p[k, 1] + turn[b, 2, 2] * p[k, 2]
    return x, y, z


@numba.njit(cache=True, nogil=True)
def _point_forces(problem, k, x, y, z, force, stiffness, bend):  # pragma: no cover - compiled
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
            d0, d1, d2 = x - problem.target[o, 0], y - problem.target[o, 1], z - problem.target[o, 2]
            squared = info * (d0 * d0 + d1 * d1 + d2 * d2)
            value, weight, second = _loss(problem.loss_kind, problem.loss_scale, squared)
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
            value, weight, second = _loss(problem.loss_kind, problem.loss_scale, squared)
            weight *= info
            uz, vz = -fu * a / (d * d), -fv * b / (d * d)
            f0 = u * fu / d * turn[c, 0, 0] + v * fv / d * turn[c, 1, 0] + (u * uz + v * vz) * turn[c, 2, 0]
            f1 = u * fu / d * turn[c, 0, 1] + v * fv / d * turn[c, 1, 1] + (u * uz + v * vz) * turn[c, 2, 1]
            f2 = u * fu / d * turn[c, 0, 2] + v * fv / d * turn[c, 1, 2] + (u * uz + v * vz) * turn[c, 2, 2]
            # second derivatives of the pixel by the point in the camera's frame: only with depth
            uzz = -weight * u * fu / (d * d)
            vzz = -weight * v * fv / (d * d)
            zzz = -2.0 * weight * (u * uz + v * vz) / d
            for i in range(3):
                nui = fu / d * turn[c, 0, i] + uz * turn[c, 2, i]
                nvi = fv / d * turn[c, 1, i] + vz * turn[c, 2, i]
                for j in range(3):
                    nuj = fu / d * turn[c, 0, j] + uz * turn[c, 2, j]
                    nvj = fv / d * turn[c, 1, j] + vz * turn[c, 2, j]
                    stiffness[i, j] += weight * (nui * nuj + nvi * nvj)
                    bend[i, j] += (
                        uzz * (turn[c, 0, i] * turn[c, 2, j] + turn[c, 2, i] * turn[c, 0, j])
                        + vzz * (turn[c, 1, i] * turn[c, 2, j] + turn[c, 2, i] * turn[c, 1, j])
                        + zzz * turn[c, 2, i] * turn[c, 2, j]
                    )
        cost += 0.5 * value
        force[0] += weight * f0
        force[1] += weight * f1
        force[2] += weight * f2
        if second != 0.0:
            robust = 2.0 * second * info * info
            bend[0, 0] += robust * f0 * f0
            bend[1, 1] += robust * f1 * f1
            bend[2, 2] += robust * f2 * f2
            bend[0, 1] += robust * f0 * f1
            bend[1, 0] += robust * f0 * f1
            bend[0, 2] += robust * f0 * f2
            bend[2, 0] += robust * f0 * f2
            bend[1, 2] += robust * f1 * f2
            bend[2, 1] += robust * f1 * f2
    return cost


@numba.njit(cache=True, nogil=True)
def _columns(problem, space, b, x, y, z):  # pragma: no cover - compiled
    """Fill a point's derivatives by the parameters of its chain, and their axes; return how many."""
    arm, axis, which = space.arm, space.axis, space.which
    at, axes, turn = space.position, space.axis_world, space.root_jacobian
    for s in range(3):
        which[s] = s
        which[3 + s] = 3 + s
        for i in range(3):
            arm[i, s] = 1.0 if i == s else 0.0
            axis[i, s] = 0.0
            axis[i, 3 + s] = turn[i, s]
    count = 6
    for n in range(problem.chain_start[b], problem.chain_start[b + 1]):
        h = problem.chain[n]
        which[count] = 6 + h
        for i in range(3):
            axis[i, count] = axes[h, i]
        count += 1
    for s in range(3, count):
        base = 0 if s < 6 else problem.hinge_bone[which[s] - 6]
        r0, r1, r2 = x - at[base, 0], y - at[base, 1], z - at[base, 2]
        arm[0, s] = axis[1, s] * r2 - axis[2, s] * r1
        arm[1, s] = axis[2, s] * r0 - axis[0, s] * r2
        arm[2, s] = axis[0, s] * r1 - axis[1, s] * r0
    return count


@numba.njit(cache=True, nogil=True)
def _add_point(space, count, normal, curvature):  # pragma: no cover - compiled
    """Add a point's matrices, pulled back to joint parameters: lower triangles."""
    arm, axis, which, pulled = space.arm, space.axis, space.which, space.pulled
    force, stiffness, bend = space.force, space.stiffness, space.bend
    for part in range(2):
        m = stiffness if part == 0 else bend
        into = normal if part == 0 else curvature
        for i in range(3):
            for s in range(count):
                pulled[i, s] = m[i, 0] * arm[0, s] + m[i, 1] * arm[1, s] + m[i, 2] * arm[2, s]
                if part == 1:  # F · (w_s × A_t) = (F × w_s) · A_t for s above t
                    j, k = (i + 1) % 3, (i + 2) % 3
                    pulled[i, s] += force[j] * axis[k, s] - force[k] * axis[j, s]
        for t in range(count):
            a0, a1, a2, row = arm[0, t], arm[1, t], arm[2, t], which[t]
            for s in range(t + 1):
                into[row, which[s]] += a0 * pulled[0, s] + a1 * pulled[1, s] + a2 * pulled[2, s]


@numba.njit(cache=True, nogil=True)
def keypoint_system(problem, params, space, gradient, normal, curvature):  # pragma: no cover
    """Return the cost; fill gradient (P,), Gauss-Newton matrix (P, P), and what the exact Hessian has beyond it."""
    _pose(problem, params, space)
    g, n, c = space.joint_gradient, space.joint_normal, space.joint_curvature
    g[:] = 0.0
    n[:] = 0.0
    c[:] = 0.0
    force, turn = space.force, space.root_slope
    cost = 0.0
    for k in range(problem.point.shape[0]):
        b = problem.point_bone[k]
        x, y, z = _place(problem, space, k, b)
        cost += _point_forces(problem, k, x, y, z, force, space.stiffness, space.bend)
        if not cost < np.inf:
            return np.inf
        count = _columns(problem, space, b, x, y, z)
        for s in range(count):
            g[space.which[s]] += (
                force[0] * space.arm[0, s] + force[1] * space.arm[1, s] + force[2] * space.arm[2, s]
            )
        _add_point(space, count, n, c)
        # the root's rotation vector: its axes J e_j turn with it
        r0, r1, r2 = x - space.position[0, 0], y - space.position[0, 1], z - space.position[0, 2]
        t0, t1, t2 = r1 * force[2] - r2 * force[1], r2 * force[0] - r0 * force[2], r0 * force[1] - r1 * force[0]
        for i in range(3):
            for j in range(i + 1):
                c[3 + i, 3 + j] += turn[i, 0, j] * t0 + turn[i, 1, j] * t1 + turn[i, 2, j] * t2
    _pull_back(problem, params, g, n, c, gradient, normal, curvature)
    return cost + _prior_cost(problem, params)


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
