"""Compiled forward kinematics and twist Jacobians. The plain form is in tests/model/kinematics_reference.py; of the root's turn in geometry/rotation.py."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled, inlined


@compiled
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


@inlined
def _skew_entry(r, i, j):  # pragma: no cover - compiled
    if i == j:
        return 0.0
    return -r[3 - i - j] if (i + 1) % 3 == j else r[3 - i - j]


@compiled
def _turn(axis, angle, out):  # pragma: no cover - compiled
    """Write the matrix that turns by `angle` about the unit `axis`."""
    s, c = np.sin(angle), np.cos(angle)
    x, y, z = axis[0], axis[1], axis[2]
    k = 1.0 - c
    out[0, 0] = c + x * x * k
    out[0, 1] = x * y * k - z * s
    out[0, 2] = x * z * k + y * s
    out[1, 0] = x * y * k + z * s
    out[1, 1] = c + y * y * k
    out[1, 2] = y * z * k - x * s
    out[2, 0] = x * z * k - y * s
    out[2, 1] = y * z * k + x * s
    out[2, 2] = c + z * z * k


@compiled
def _multiply(a, b, out):  # pragma: no cover - compiled
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@compiled
def pose_bones(
    tree, params, root_rotation, rotation, position, axis_world
):  # pragma: no cover - compiled
    """Fill rotation (B, 3, 3), position (B, 3) and the hinges' world axes (S − 6, 3)."""
    parent, offset, rest, hinge_bone, hinge_axis = tree
    bones, hinges = parent.shape[0], hinge_bone.shape[0]
    step, frame = np.empty((3, 3)), np.empty((3, 3))
    for i in range(3):  # whole rows would be shorter, but take seconds to compile
        position[0, i] = params[i]
        for j in range(3):
            rotation[0, i, j] = root_rotation[i, j]
    h = 0
    for b in range(bones):
        if b > 0:
            p = parent[b]
            for i in range(3):
                position[b, i] = position[p, i]
                for j in range(3):
                    position[b, i] += rotation[p, i, j] * offset[b, j]
            _multiply(rotation[p], rest[b], rotation[b])
        while h < hinges and hinge_bone[h] == b:
            for i in range(3):
                axis_world[h, i] = 0.0
                for j in range(3):
                    axis_world[h, i] += rotation[b, i, j] * hinge_axis[h, j]
            _turn(hinge_axis[h], params[6 + h], step)
            _multiply(rotation[b], step, frame)
            for i in range(3):
                for j in range(3):
                    rotation[b, i, j] = frame[i, j]
            h += 1


@compiled
def screws(tree, root_jacobian, axis_world, position, out):  # pragma: no cover - compiled
    """Fill the screw (S, 6) of every joint parameter: world axes, about the root."""
    out[:6] = 0.0
    for s in range(3):
        out[s, s] = 1.0
        for i in range(3):
            out[3 + s, 3 + i] = root_jacobian[i, s]
    _, _, _, hinge_bone, _ = tree
    for h in range(hinge_bone.shape[0]):
        b = hinge_bone[h]
        w0, w1, w2 = axis_world[h, 0], axis_world[h, 1], axis_world[h, 2]
        r0 = position[b, 0] - position[0, 0]
        r1 = position[b, 1] - position[0, 1]
        r2 = position[b, 2] - position[0, 2]
        out[6 + h, 0] = r1 * w2 - r2 * w1
        out[6 + h, 1] = r2 * w0 - r0 * w2
        out[6 + h, 2] = r0 * w1 - r1 * w0
        out[6 + h, 3], out[6 + h, 4], out[6 + h, 5] = w0, w1, w2


@compiled
def twist_columns(tree, screw, out):  # pragma: no cover - compiled
    """Fill the twist Jacobian (B, 6, S): screws (S, 6) of a bone's own hinges and of all its ancestors'."""
    parent, _, _, hinge_bone, _ = tree
    out[:] = 0.0
    for b in range(out.shape[0]):
        for i in range(6):
            for s in range(out.shape[2]):
                if b > 0:
                    out[b, i, s] = out[parent[b], i, s]
                elif s < 6:
                    out[b, i, s] = screw[s, i]
        for h in range(hinge_bone.shape[0]):
            if hinge_bone[h] == b:
                for i in range(6):
                    out[b, i, 6 + h] = screw[6 + h, i]


@compiled
def pose(tree, params):  # pragma: no cover - compiled
    """Return rotation (B, 3, 3), position (B, 3), the hinges' world axes and the root's left Jacobian, for params (S,)."""
    parent, _, _, hinge_bone, _ = tree
    bones, hinges = parent.shape[0], hinge_bone.shape[0]
    rotation, position = np.empty((bones, 3, 3)), np.empty((bones, 3))
    axes, root = np.empty((hinges, 3)), np.empty((5, 3, 3))
    turn_root(params[3:6], root[0], root[1], root[2:])
    pose_bones(tree, params, root[0], rotation, position, axes)
    return rotation, position, axes, root[1]


@compiled
def linearize_pose(tree, params):  # pragma: no cover - compiled
    """Return rotation, position and the twist Jacobian (B, 6, S)."""
    rotation, position, axes, root_jacobian = pose(tree, params)
    screw, jacobian = np.empty((len(params), 6)), np.empty((len(position), 6, len(params)))
    screws(tree, root_jacobian, axes, position, screw)
    twist_columns(tree, screw, jacobian)
    return rotation, position, jacobian


@compiled
def carry(frames, bone, local, normal, places, normals):  # pragma: no cover - compiled
    """Fill places and normals (V, 3), world, of points and normals (V, 3) in the frames of their bones (V,)."""
    rotation, position, _ = frames
    for v in range(bone.shape[0]):
        b = bone[v]
        for i in range(3):
            r0, r1, r2 = rotation[b, i, 0], rotation[b, i, 1], rotation[b, i, 2]
            # in the order in which np.einsum sums three
            places[v, i] = position[b, i] + (r0 * local[v, 0] + r2 * local[v, 2] + r1 * local[v, 1])
            normals[v, i] = r0 * normal[v, 0] + r2 * normal[v, 2] + r1 * normal[v, 1]


@compiled
def scale_change_fields(changes, frames, scale_change, unknowns):  # pragma: no cover - compiled
    """Return (B, 12, K) of joints and of ellipsoids; see `SizeParameters.fields`.

    Parameters
    ----------
    changes
        The bones' parents; rates (B, 3, N) of the logarithms of their factors by a person's
        deviations; moves (Q, B, 3) of their heads, and shift (Q, B, 3) of what is on them, by those
        that are proportions; which of the deviations these begin at.
    """
    parent, rates, moves, shift, first = changes
    rotation, position, reference = frames
    bones, count = len(parent), len(unknowns)
    joints = np.zeros((bones, 12, count))
    head = np.zeros((bones, 3, count))  # by how much each bone's head moves
    for b in range(bones):
        a, turn = parent[b], rotation[b]
        arm = position[b] - reference
        for k in range(count):
            n = unknowns[k]
            q = n - first
            known = 0 <= q < len(moves)
            for i in range(3):
                for j in range(3):
                    stretch = 0.0
                    for c in range(3):
                        stretch += turn[i, c] * rates[b, c, n] * turn[j, c]
                    joints[b, 3 + 3 * i + j, k] = stretch
            for i in range(3):
                if a >= 0:
                    further = head[a, i, k]
                    for j in range(3):
                        further += joints[a, 3 + 3 * i + j, k] * (position[b, j] - position[a, j])
                        if known:
                            further += rotation[a, i, j] * scale_change[a, j] * moves[q, b, j]
                    head[b, i, k] = further
                at = head[b, i, k]
                for j in range(3):
                    at -= joints[b, 3 + 3 * i + j, k] * arm[j]
                joints[b, i, k] = at
    surface = joints.copy()
    for k in range(count):
        q = unknowns[k] - first
        if 0 <= q < len(shift):
            for b in range(bones):
                for i in range(3):
                    for j in range(3):
                        surface[b, i, k] += rotation[b, i, j] * scale_change[b, j] * shift[q, b, j]
    return joints, surface
