"""Compiled: where bones carry points and ellipsoids, what a term adds for one, and the pull-back of all terms' sums to a model's parameters."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled, compiled_as_numpy, inlined


@inlined
def to_world(frames, bone, local, point):  # pragma: no cover - compiled
    """Fill the world point (3,) of a point (3,) in a bone's frame."""
    for i in range(3):
        point[i] = (
            frames.position[bone, i]
            + frames.rotation[bone, i, 0] * local[0]
            + frames.rotation[bone, i, 1] * local[1]
            + frames.rotation[bone, i, 2] * local[2]
        )


@inlined
def fill_arm(row, at, width, x, y, z):  # pragma: no cover - compiled
    """Complete row[at : at + width], whose first three are n, for a point at (x, y, z) = X − o: [n ; (X − o) × n] by a twist,
    [n ; n (X − o)ᵀ] by a field of twelve numbers, n alone by a velocity of the point.
    """
    n0, n1, n2 = row[at], row[at + 1], row[at + 2]
    if width == 12:
        row[at + 3], row[at + 4], row[at + 5] = n0 * x, n0 * y, n0 * z
        row[at + 6], row[at + 7], row[at + 8] = n1 * x, n1 * y, n1 * z
        row[at + 9], row[at + 10], row[at + 11] = n2 * x, n2 * y, n2 * z
    elif width == 6:
        row[at + 3] = y * n2 - z * n1
        row[at + 4] = z * n0 - x * n2
        row[at + 5] = x * n1 - y * n0


@inlined
def add_outer(row, at, factor, a, b):  # pragma: no cover - compiled
    """Add factor · a bᵀ to the nine of G in row[at : at + 12]."""
    for i in range(3):
        for j in range(3):
            row[at + 3 + 3 * i + j] += factor * a[i] * b[j]


@compiled_as_numpy
def add_row(sums, bone, row, residual, weight):  # pragma: no cover - compiled
    """Add weight · residual · row and weight · row rowᵀ to a bone's part of the sums. row: (width,)"""
    at = sums.width * bone
    for i in range(sums.width):
        part = weight * row[i]
        sums.gradient[at + i] += part * residual
        for j in range(sums.width):
            sums.hessian[at + i, at + j] += part * row[j]


@compiled_as_numpy
def add_point(sums, frames, bone, point, slope, residual, weight):  # pragma: no cover - compiled
    """Add a residual of a bone's point: ½ weight residual², with d residual / d point = slope (3,). point: (3,) world [m]."""
    row = np.empty(12)
    for i in range(3):
        row[i] = slope[i]
    o = frames.reference
    fill_arm(row, 0, sums.width, point[0] - o[0], point[1] - o[1], point[2] - o[2])
    add_row(sums, bone, row, residual, weight)


@compiled
def pull_back(sums, jacobian):  # pragma: no cover - compiled
    """Return Jᵀ g (N,) and Jᵀ H J (N, N) of sums by the bones' motion, for a motion J (B, width, N) by N unknowns.

    Blocks of H that are zero, of pairs of bones that no residual joins, are passed over, and so are unknowns that move neither bone: a
    finger's joints and girth leave all others where they are. Threads of BLAS would cost more.
    """
    bones, width, count = jacobian.shape
    gradient, hessian = sums.gradient, sums.hessian
    g, h = np.zeros(count), np.zeros((count, count))
    # sums of magnitudes, 0 where there is nothing, for these loops are vectorised: of J by bone, of one bone's rows of H by column
    # (a whole block's at its first), and of J of the bones that these join
    moves, joined, used = np.zeros((bones, count)), np.empty(bones * width), np.empty(count)
    for b in range(bones):
        for i in range(width):
            for s in range(count):
                moves[b, s] += abs(jacobian[b, i, s])
    mine, own = np.empty(count, np.int64), np.empty((width, count))
    product, part = np.empty((width, count)), np.empty(count)  # product: H J of one bone's rows
    for b in range(bones):
        for i in range(width):
            x = gradient[width * b + i]
            if x != 0.0:
                for s in range(count):
                    g[s] += jacobian[b, i, s] * x
        joined[:] = 0.0
        for i in range(width * b, width * b + width):
            for j in range(bones * width):
                joined[j] += abs(hessian[i, j])
        used[:] = 0.0
        for c in range(bones):
            for j in range(1, width):
                joined[width * c] += joined[width * c + j]
            if joined[width * c] != 0.0:
                used += moves[c]
        n = 0
        for s in range(count):
            if used[s] != 0.0:
                mine[n] = s
                n += 1
        product[:, :n] = 0.0
        for c in range(bones):
            if joined[width * c] == 0.0:
                continue
            for j in range(width):
                for k in range(n):
                    own[j, k] = jacobian[c, j, mine[k]]
            for i in range(width):
                for j in range(width):
                    x = hessian[width * b + i, width * c + j]
                    if x != 0.0:
                        for k in range(n):
                            product[i, k] += x * own[j, k]
        for s in range(count):
            if moves[b, s] == 0.0:
                continue
            for k in range(n):
                part[k] = h[s, mine[k]]
            for i in range(width):
                x = jacobian[b, i, s]
                if x != 0.0:
                    for k in range(n):
                        part[k] += x * product[i, k]
            for k in range(n):
                h[s, mine[k]] = part[k]
    for s in range(count):  # rounding has parted what is symmetric
        for t in range(s):
            middle = 0.5 * (h[s, t] + h[t, s])
            h[s, t] = middle
            h[t, s] = middle
    return g, h


@compiled
def add_to_chosen(
    gradient, hessian, chosen, chosen_gradient, chosen_hessian
):  # pragma: no cover - compiled
    """Add a system of some unknowns, (K,) and (K, K), to that of all, gradient (N,) and hessian (N, N), in place. chosen: (K,) which they are."""
    for k in range(len(chosen)):
        gradient[chosen[k]] += chosen_gradient[k]
        for m in range(len(chosen)):
            hessian[chosen[k], chosen[m]] += chosen_hessian[k, m]


@compiled
def to_solver(sums, jacobian, priors, links, size):  # pragma: no cover - compiled
    """Return gradient (size,) and Hessian by solver parameters: of observations, pulled back, and priors, by joint parameters."""
    g, h = pull_back(sums, jacobian)
    gradient, hessian = np.zeros(size), np.zeros((size, size))
    joint, leader, ratios = links
    for a in range(joint.shape[0]):
        s, p, ratio = joint[a], leader[a], ratios[a]
        gradient[p] += ratio * (g[s] + priors.gradient[s])
        for b in range(joint.shape[0]):
            t, r = joint[b], leader[b]
            hessian[p, r] += ratio * ratios[b] * (h[s, t] + priors.hessian[s, t])
    return gradient, hessian


@compiled
def posed_shapes(frames, ellipsoids, centre_world, shape_world):  # pragma: no cover - compiled
    """Fill centres (E, 3) and D = R diag(r²) Rᵀ (E, 3, 3), world, of ellipsoids carried by bones."""
    rotation, position, axes = frames.rotation, frames.position, np.empty((3, 3))
    bone, centre, turn, radii = ellipsoids
    for e in range(bone.shape[0]):
        b = bone[e]
        for i in range(3):
            r0, r1, r2 = rotation[b, i, 0], rotation[b, i, 1], rotation[b, i, 2]
            centre_world[e, i] = (
                position[b, i] + r0 * centre[e, 0] + r1 * centre[e, 1] + r2 * centre[e, 2]
            )
            for j in range(3):
                axes[i, j] = (r0 * turn[e, 0, j] + r1 * turn[e, 1, j] + r2 * turn[e, 2, j]) * radii[
                    e, j
                ]
        for i in range(3):
            for j in range(3):
                shape_world[e, i, j] = (
                    axes[i, 0] * axes[j, 0] + axes[i, 1] * axes[j, 1] + axes[i, 2] * axes[j, 2]
                )
