"""Compiled sums of a cloud's viewing rays against ellipsoids. The plain form: tests/terms/cloud_rays_reference.py."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled_as_numpy
from handtrack.model.metaballs_kernels import REACH, TINY, in_unit_ball
from handtrack.terms.bone_kernels import add_outer, fill_arm
from handtrack.terms.loss import robust

_FAR = 1e6  # sigmas: an outlier without doubt


@compiled_as_numpy
def slope_distance(table, e, x, y, z):  # pragma: no cover - compiled
    """Return (d, nx, ny, nz): (k² − k)/|∇k²/2|, the distance to ellipsoid e to first order near it, and its gradient."""
    x, y, z = x - table[e, 0], y - table[e, 1], z - table[e, 2]
    square, gx, gy, gz = 0.0, 0.0, 0.0, 0.0
    for i in range(3, 12, 3):
        u = table[e, i] * x + table[e, i + 1] * y + table[e, i + 2] * z
        square += u * u
        gx, gy, gz = gx + table[e, i] * u, gy + table[e, i + 1] * u, gz + table[e, i + 2] * u
    hx, hy, hz = 0.0, 0.0, 0.0
    for i in range(3, 12, 3):
        u = table[e, i] * gx + table[e, i + 1] * gy + table[e, i + 2] * gz
        hx, hy, hz = hx + table[e, i] * u, hy + table[e, i + 1] * u, hz + table[e, i + 2] * u
    k = max(np.sqrt(square), TINY)
    slope = max(np.sqrt(gx * gx + gy * gy + gz * gz), TINY)
    a, b = (2.0 - 1.0 / k) / slope, (k * k - k) / (slope * slope * slope)
    return (k * k - k) / slope, a * gx - b * hx, a * gy - b * hy, a * gz - b * hz


@compiled_as_numpy
def first_met(table, centre, rx, ry, rz):  # pragma: no cover - compiled
    """Return which ellipsoid a ray from `centre` hits first, or passes nearest to if it hits none; whether it hits; and
    where along it, in metres, it is deepest in that ellipsoid, or nearest to it."""
    who, front, least, where, hits = 0, np.inf, np.inf, 0.0, False
    for e in range(table.shape[0]):
        x, y, z = centre[0] - table[e, 0], centre[1] - table[e, 1], centre[2] - table[e, 2]
        along = x * rx + y * ry + z * rz
        beside = np.sqrt(max(x * x + y * y + z * z - along * along, 0.0)) - table[e, REACH]
        if beside > 0.0 and (hits or beside >= least):
            continue
        u, v, w = in_unit_ball(table, e, x, y, z)
        du, dv, dw = in_unit_ball(table, e, rx, ry, rz)
        a = du * du + dv * dv + dw * dw
        t = -(u * du + v * dv + w * dw) / a
        level = (u + t * du) ** 2 + (v + t * dv) ** 2 + (w + t * dw) ** 2
        if level < 1.0:
            entry = t - np.sqrt((1.0 - level) / a)
            if entry < front:
                hits, who, front, where = True, e, entry, t
        elif not hits:
            x, y, z = centre[0] + t * rx, centre[1] + t * ry, centre[2] + t * rz
            off = slope_distance(table, e, x, y, z)[0]
            if off < least:
                who, least, where = e, off, t
    return who, hits, where


@compiled_as_numpy
def rays_sums(rays, surface, noise, weight, reference, sums):  # pragma: no cover - compiled
    """Add the viewing rays to sums; return their cost.

    Parameters
    ----------
    rays
        The camera's centre, unit directions (N, 3), and where the points are along them (N,) [m].
    noise
        σ [m] and loss of a point along its ray, σ and loss of a ray beside the model.
    """
    centre, rays, depth = rays
    along, outlier, beside, saturating = noise
    table, bone = surface[0], surface[1]
    width, gradient, hessian = sums
    cost, row, share = 0.0, np.empty(12), 0.0
    unexplained = robust(outlier, _FAR)[0]
    for n in range(rays.shape[0]):
        rx, ry, rz = rays[n, 0], rays[n, 1], rays[n, 2]
        e, hits, middle = first_met(table, centre, rx, ry, rz)
        behind = hits and depth[n] > middle
        t = depth[n] if hits and not behind else middle
        x, y, z = centre[0] + t * rx, centre[1] + t * ry, centre[2] + t * rz
        off, nx, ny, nz = slope_distance(table, e, x, y, z)
        distance = off
        follows = 0.0 if hits and not behind else nx * rx + ny * ry + nz * rz
        sigma = along if hits else beside
        if hits:
            if behind:
                off, follows = off - (depth[n] - middle), follows + 1.0
            value, size = robust(outlier, (off / sigma) ** 2)
        else:
            value, size = robust(saturating, (off / sigma) ** 2)
            value += unexplained
        cost += value
        if width == 0:
            continue
        ox, oy, oz = x - reference[0], y - reference[1], z - reference[2]
        row[0], row[1], row[2] = -nx, -ny, -nz
        if follows != 0.0 or width == 12:  # the place of closest approach slides along the ray
            cx, cy, cz = x - table[e, 0], y - table[e, 1], z - table[e, 2]
            mx, my, mz, sx, sy, sz, a = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for i in range(3, 12, 3):
                p, q, r = table[e, i], table[e, i + 1], table[e, i + 2]
                v = p * rx + q * ry + r * rz
                u = p * cx + q * cy + r * cz
                a += v * v
                mx, my, mz = mx + p * v, my + q * v, mz + r * v
                sx, sy, sz = sx + p * u, sy + q * u, sz + r * u
            share = follows / a
            row[0] += share * mx
            row[1] += share * my
            row[2] += share * mz
        fill_arm(row, 0, width, ox, oy, oz)
        if width == 12:  # a length along the slope s grows as G says
            s = (sx, sy, sz)
            add_outer(row, 0, share, s, (rx, ry, rz))
            add_outer(row, 0, distance / max(sx * sx + sy * sy + sz * sz, TINY**2), s, s)
        elif follows != 0.0:
            row[3] += share * (ry * sz - rz * sy)
            row[4] += share * (rz * sx - rx * sz)
            row[5] += share * (rx * sy - ry * sx)
        first = width * bone[e]
        for i in range(width):
            part = weight * size * row[i] / (sigma * sigma)
            gradient[first + i] += part * off
            for j in range(width):
                hessian[first + i, first + j] += part * row[j]
    return 0.5 * weight * cost
