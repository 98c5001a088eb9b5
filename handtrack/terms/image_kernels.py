"""Compiled loops of the image terms: smooth images, edges along normals, rows of edges and texture, a picture of depths."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled_as_numpy, inlined
from handtrack.terms.bone_kernels import add_row, fill_arm, to_world
from handtrack.terms.loss import robust


@inlined
def cell(position, count):  # pragma: no cover - compiled
    """Return the cell, the place in it, and 1 inside the image or 0 beyond, where the border's value goes on."""
    inside = 1.0 if 0.0 <= position <= count - 1.0 else 0.0
    clamped = min(max(position, 0.0), count - 1.0)
    i = min(np.int64(clamped), count - 2)
    return i, clamped - i, inside


@inlined
def look_up(image, i, j, p, q, c):  # pragma: no cover - compiled
    """Return value and slopes of channel c in the cell of row i and column j, at p down and q across."""
    f00, f01 = np.float64(image[i, j, c]), np.float64(image[i, j + 1, c])
    f10, f11 = np.float64(image[i + 1, j, c]), np.float64(image[i + 1, j + 1, c])
    top, bottom = f00 + q * (f01 - f00), f10 + q * (f11 - f10)
    across = (1.0 - p) * (f01 - f00) + p * (f11 - f10)
    return top + p * (bottom - top), across, bottom - top


@compiled_as_numpy
def look_up_all(image, pixels, values):  # pragma: no cover - compiled
    """Fill values (N, C) at pixels (N, 2) of this window."""
    height, width, channels = image.shape
    for n in range(pixels.shape[0]):
        j, q, _ = cell(pixels[n, 0], width)
        i, p, _ = cell(pixels[n, 1], height)
        for c in range(channels):
            values[n, c] = look_up(image, i, j, p, q, c)[0]


NEAREST = 1e-3  # [m] in front of the camera


@inlined
def see(point, camera, seen):  # pragma: no cover - compiled
    """Fill the point (3,) in the camera's frame. camera: matrix, rotation and translation."""
    _, turn, shift = camera
    for r in range(3):
        seen[r] = shift[r] + turn[r, 0] * point[0] + turn[r, 1] * point[1] + turn[r, 2] * point[2]


@inlined
def fill_row(du, dv, seen, camera, point, reference, width, row):  # pragma: no cover - compiled
    """Fill the row (6,), or (12,) by fields, of a residual that changes by du and dv per pixel across and down."""
    matrix, turn, _ = camera
    x, y, z = seen[0], seen[1], seen[2]
    fu, fv = du * matrix[0, 0] / z, dv * matrix[1, 1] / z
    fz = -(fu * x + fv * y) / z
    for r in range(3):
        row[r] = fu * turn[0, r] + fv * turn[1, r] + fz * turn[2, r]
    ax, ay, az = point[0] - reference[0], point[1] - reference[1], point[2] - reference[2]
    fill_arm(row, 0, width, ax, ay, az)


@compiled_as_numpy
def search_along(
    image, start, normal, half, step, faint, place, strength
):  # pragma: no cover - compiled
    """Fill place [px] and strength (N, K) of the strongest edges within ± half · step of start (N, 2) along normal."""
    height, width, channels = image.shape
    count = 2 * half + 3  # one more at either end, to tell peaks
    values, slope = np.empty((count + 2, channels)), np.empty(count)
    most = place.shape[1]
    for n in range(start.shape[0]):
        for m in range(count + 2):
            along = (m - half - 2) * step
            j, q, _ = cell(start[n, 0] + along * normal[n, 0], width)
            i, p, _ = cell(start[n, 1] + along * normal[n, 1], height)
            for c in range(channels):
                values[m, c], _, _ = look_up(image, i, j, p, q, c)
        mean = 0.0
        for m in range(count):
            squared = 0.0
            for c in range(channels):
                squared += ((values[m + 2, c] - values[m, c]) / (2.0 * step)) ** 2
            slope[m] = np.sqrt(squared)
            mean += squared / count
        for k in range(most):
            place[n, k], strength[n, k] = 0.0, 0.0
        for m in range(1, count - 1):
            peak = slope[m]
            if peak < faint or peak < slope[m - 1] or peak <= slope[m + 1]:
                continue
            share = peak * peak / (peak * peak + mean + faint * faint)
            k = most - 1
            if share <= strength[n, k]:
                continue
            while k > 0 and share > strength[n, k - 1]:
                place[n, k], strength[n, k] = place[n, k - 1], strength[n, k - 1]
                k -= 1
            bend = slope[m - 1] - 2.0 * peak + slope[m + 1]
            shift = 0.5 * (slope[m - 1] - slope[m + 1]) / bend if bend < 0.0 else 0.0
            place[n, k], strength[n, k] = (m - half - 1 + shift) * step, share


@compiled_as_numpy
def edges_sums(frames, camera, pieces, edges, spread, sums):  # pragma: no cover - compiled
    """Add one camera's edges to sums; return their cost.

    Parameters
    ----------
    pieces
        Of outline, (N,) each: bone, point in its frame, pixel and normal at the start, weight.
    edges
        Place and strength (N, K).
    spread
        σ [px], clutter, and whether costs count from those of a piece without an edge.
    """
    bone, local, pixel, normal, weight = pieces
    edge, strength = edges
    sigma, clutter, from_none = spread
    matrix = camera[0]
    cost, point, seen, row = 0.0, np.empty(3), np.empty(3), np.empty(12)
    for n in range(bone.shape[0]):
        b = bone[n]
        to_world(frames, b, local[n], point)
        see(point, camera, seen)
        if seen[2] < NEAREST:
            continue
        du = matrix[0, 2] + matrix[0, 0] * seen[0] / seen[2] - pixel[n, 0]
        dv = matrix[1, 2] + matrix[1, 1] * seen[1] / seen[2] - pixel[n, 1]
        x = normal[n, 0] * du + normal[n, 1] * dv
        here, best, pull, held = clutter, clutter, 0.0, 0.0
        for k in range(edge.shape[1]):
            if strength[n, k] == 0.0:
                continue
            off = (x - edge[n, k]) / sigma
            likely = strength[n, k] * np.exp(-0.5 * off * off)
            here += likely
            best += strength[n, k]
            pull += likely * off / sigma
            held += likely / (sigma * sigma)
        cost -= weight[n] * np.log(here / (clutter if from_none else best))
        if sums.width > 0 and held > 0.0:
            fill_row(
                normal[n, 0], normal[n, 1], seen, camera, point, frames.reference, sums.width, row
            )
            add_row(sums, b, row, pull / held, weight[n] * held / here)
    return cost


@compiled_as_numpy
def fill_triangles(pixels, depth, faces, nearest, front):  # pragma: no cover - compiled
    """Fill nearest (H, W) [m] and front (H, W), the face there, where a face is nearer than what
    stands in them.

    Exact at pixel centres: 1/z is linear in the image. A face that reaches behind the camera is
    left out.

    Parameters
    ----------
    pixels
        (V, 2) in this picture.
    depth
        (V,) z in the camera [m].
    """
    height, width = nearest.shape
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        if min(depth[a], depth[b], depth[c]) <= 1e-6:
            continue
        xa, ya, xb, yb = pixels[a, 0], pixels[a, 1], pixels[b, 0], pixels[b, 1]
        xc, yc = pixels[c, 0], pixels[c, 1]
        area = (xb - xa) * (yc - ya) - (yb - ya) * (xc - xa)
        if area == 0.0:
            continue
        left = max(np.int64(np.ceil(min(xa, xb, xc))), 0)
        right = min(np.int64(np.floor(max(xa, xb, xc))), width - 1)
        top = max(np.int64(np.ceil(min(ya, yb, yc))), 0)
        bottom = min(np.int64(np.floor(max(ya, yb, yc))), height - 1)
        ia, ib, ic = 1.0 / depth[a], 1.0 / depth[b], 1.0 / depth[c]
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                wb = ((x - xa) * (yc - ya) - (y - ya) * (xc - xa)) / area
                wc = ((xb - xa) * (y - ya) - (yb - ya) * (x - xa)) / area
                wa = 1.0 - wb - wc
                if wa < 0.0 or wb < 0.0 or wc < 0.0:
                    continue
                z = 1.0 / (wa * ia + wb * ib + wc * ic)
                if z < nearest[y, x]:
                    nearest[y, x] = z
                    front[y, x] = f


@compiled_as_numpy
def texture_sums(frames, camera, image, texture, noise, sums):  # pragma: no cover - compiled
    """Add one camera's texture to sums; return ½ weight Σ (ρ − worst).

    Parameters
    ----------
    texture
        Bone (N,), point in its frame (N, 3), color (N, C).
    noise
        σ, loss, worst and weight.
    """
    bone, local, color = texture
    sigma, loss, worst, weight = noise
    matrix = camera[0]
    rows, columns, channels = image.shape
    cost, point, seen, row = 0.0, np.empty(3), np.empty(3), np.empty(12)
    residual, across, down = np.empty(channels), np.empty(channels), np.empty(channels)
    for n in range(bone.shape[0]):
        b = bone[n]
        to_world(frames, b, local[n], point)
        see(point, camera, seen)
        if seen[2] < NEAREST:
            continue
        j, q, in_u = cell(matrix[0, 2] + matrix[0, 0] * seen[0] / seen[2], columns)
        i, p, in_v = cell(matrix[1, 2] + matrix[1, 1] * seen[1] / seen[2], rows)
        squared = 0.0
        for c in range(channels):
            value, du, dv = look_up(image, i, j, p, q, c)
            residual[c] = (value - color[n, c]) / sigma
            across[c], down[c] = in_u * du / sigma, in_v * dv / sigma
            squared += residual[c] * residual[c]
        value, size = robust(loss, squared)
        cost += value - worst
        if sums.width == 0:
            continue
        for c in range(channels):
            fill_row(across[c], down[c], seen, camera, point, frames.reference, sums.width, row)
            add_row(sums, b, row, residual[c], weight * size)
    return 0.5 * weight * cost
