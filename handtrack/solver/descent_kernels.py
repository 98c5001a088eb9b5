"""Compiled descent: kinematics, all terms, limits and the damped loop without Python between evaluations.

The plain form is `levenberg_marquardt.solve` on a `Problem`. One evaluation gives cost, gradient and Hessian together: where a
trial is accepted, it is the next linearisation already.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from handtrack.arrays import Floats, Ints
from handtrack.model.kinematics_kernels import place_bones, twist_columns
from handtrack.solver.limited_step_kernels import clip, damped_step, fill_box, new_box
from handtrack.terms.bone_kernels import pull_back_blocks
from handtrack.terms.term_table import (
    GRADIENT,
    HESSIAN,
    JOINTS,
    PLACE,
    POSITION,
    REFERENCE,
    ROTATION,
    call_kernel,
    put_array,
)

CONVERGED, USED_UP, NO_DESCENT = range(3)
REJECTIONS = 5
"""trials at one linearisation before giving up"""


class Workspace(NamedTuple):
    """What one evaluation writes; made once a descent."""

    joints: Floats
    rotation: Floats
    position: Floats
    axes: Floats
    root: Floats
    """(5, 3, 3) the root's rotation, its left Jacobian, and that one's slopes"""
    jacobian: Floats
    """(B, 6, S)"""
    bone_gradient: Floats
    bone_hessian: Floats
    joint_gradient: Floats
    joint_hessian: Floats
    bone_place: Ints
    """tables of these arrays, for kernels"""
    joint_place: Ints
    gradient: Floats
    """(P,)"""
    hessian: Floats
    """(P, P)"""


@numba.njit(cache=True, nogil=True)
def workspace(moving, size):  # pragma: no cover - compiled
    """Return a Workspace for `size` solver parameters."""
    bones, hinges = moving.parent.shape[0], moving.hinge_bone.shape[0]
    count = 6 + hinges
    work = Workspace(
        np.zeros(count), np.zeros((bones, 3, 3)), np.zeros((bones, 3)), np.zeros((hinges, 3)), np.zeros((5, 3, 3)),
        np.zeros((bones, 6, count)), np.zeros(6 * bones), np.zeros((6 * bones, 6 * bones)), np.zeros(count),
        np.zeros((count, count)), np.zeros(4 * PLACE, np.int64), np.zeros(4 * PLACE, np.int64), np.zeros(size),
        np.zeros((size, size)),
    )  # fmt: skip
    put_array(work.bone_place, GRADIENT, work.bone_gradient, 6 * bones, 1, 1)
    put_array(work.bone_place, HESSIAN, work.bone_hessian, 6 * bones, 6 * bones, 1)
    put_array(work.bone_place, ROTATION, work.rotation, bones, 3, 3)
    put_array(work.bone_place, POSITION, work.position, bones, 3, 1)
    put_array(work.bone_place, REFERENCE, work.position, 3, 1, 1)  # bone 0 is the root
    put_array(work.joint_place, GRADIENT, work.joint_gradient, count, 1, 1)
    put_array(work.joint_place, HESSIAN, work.joint_hessian, count, count, 1)
    put_array(work.joint_place, JOINTS, work.joints, count, 1, 1)
    return work


@numba.njit(cache=True, nogil=True)
def evaluate(
    moving, observed, priors, is_block, params, work, width
):  # pragma: no cover - compiled
    """Return the cost at params (P,); with a width of 6, fill gradient and Hessian in the workspace too.

    observed, priors: (N, 2) as of `term_table.entries`; is_block: no term couples two bones.
    """
    place_bones(moving, params, work.joints, work.root, work.rotation, work.position, work.axes)
    if width > 0:
        work.bone_gradient[:] = 0.0
        work.joint_hessian[:] = 0.0
        work.joint_gradient[:] = 0.0
        if is_block:
            for b in range(0, work.bone_gradient.shape[0], 6):
                for i in range(6):
                    for j in range(6):
                        work.bone_hessian[b + i, b + j] = 0.0
        else:
            work.bone_hessian[:] = 0.0
    cost = 0.0
    for k in range(observed.shape[0]):
        cost += call_kernel(observed[k, 0], observed[k, 1], work.bone_place.ctypes.data, width)
    for k in range(priors.shape[0]):
        cost += call_kernel(priors[k, 0], priors[k, 1], work.joint_place.ctypes.data, width)
    if width > 0:
        twist_columns(
            work.root[1], moving.parent, moving.hinge_bone, work.axes, work.position, work.jacobian
        )
        g, h = pull_back_blocks(work.bone_gradient, work.bone_hessian, work.jacobian, is_block)
        _to_solver(moving, g, h, work)
    return cost


@numba.njit(cache=True, nogil=True)
def _to_solver(moving, g, h, work):  # pragma: no cover - compiled
    """Sum joint parameters' gradient and Hessian, observations' and priors', to those of solver parameters."""
    work.gradient[:] = 0.0
    work.hessian[:] = 0.0
    for a in range(moving.joint.shape[0]):
        s, p, ratio = moving.joint[a], moving.leader[a], moving.ratio[a]
        work.gradient[p] += ratio * (g[s] + work.joint_gradient[s])
        for b in range(moving.joint.shape[0]):
            t, r = moving.joint[b], moving.leader[b]
            work.hessian[p, r] += ratio * moving.ratio[b] * (h[s, t] + work.joint_hessian[s, t])


@numba.njit(cache=True, nogil=True)
def _copy(values, out, count):  # pragma: no cover - compiled
    """An assignment of whole arrays would be shorter, but takes seconds to compile."""
    for i in range(count):
        out[i] = values[i]


@numba.njit(cache=True, nogil=True)
def descend(
    moving, limits, observed, priors, is_block, params, iterations, damping, least_damping, relax, tighten,
    cost_tolerance, step_tolerance, limit_m, limit_rad, path, costs, dampings, work,
):  # fmt: skip  # pragma: no cover - compiled
    """Move params (P,) to where descent leads; returns (why, iterations used, accepted steps).

    path (iterations + 1, P), costs and dampings are filled with what was accepted, the start first.
    """
    size = params.shape[0]
    box, step, trial = new_box(size), np.empty(size), np.empty(size)
    gradient, hessian = np.empty(size), np.empty((size, size))
    clip(limits, params, box)
    cost = evaluate(moving, observed, priors, is_block, params, work, 6)
    _copy(params, path[0], size)
    costs[0], accepted = cost, 0
    for count in range(1, iterations + 1):
        _copy(work.gradient, gradient, size)
        _copy(work.hessian.reshape(-1), hessian.reshape(-1), size * size)
        floor = 1e-30
        for p in range(size):
            floor = max(floor, hessian[p, p])
        moved, small, there, largest, tighter = False, False, cost, 0.0, tighten
        for _ in range(REJECTIONS):
            fill_box(limits, params, box)
            if damped_step(hessian, gradient, params, box, damping, 1e-9 * floor, step):
                longest = 1.0
                for p in range(size):
                    longest = max(longest, abs(step[p]) / (limit_m if p < 3 else limit_rad))
                for p in range(size):
                    trial[p] = params[p] + step[p] / longest
                clip(limits, trial, box)
                there = evaluate(moving, observed, priors, is_block, trial, work, 6)
                largest = 0.0
                for p in range(size):
                    largest = max(largest, abs(trial[p] - params[p]))
                if there < cost:
                    moved = True
                    break
                small = largest < step_tolerance
                if small:
                    break
            damping *= tighter
            tighter *= 2.0
        dampings[count - 1] = damping
        if not moved:
            _copy(gradient, work.gradient, size)
            _copy(hessian.reshape(-1), work.hessian.reshape(-1), size * size)
            return (CONVERGED if small else NO_DESCENT), count, accepted
        gain = cost - there
        damping = max(damping * relax, least_damping)
        cost, accepted = there, accepted + 1
        _copy(trial, params, size)
        _copy(trial, path[accepted], size)
        costs[accepted] = cost
        if gain <= cost_tolerance * max(abs(cost), 1e-300) or largest < step_tolerance:
            return CONVERGED, count, accepted
    return USED_UP, iterations, accepted
