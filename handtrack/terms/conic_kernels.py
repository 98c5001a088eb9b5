"""Compiled geometry of one ellipsoid in one camera: its ellipse, the ellipse's twist derivative, and Aᵀ M A.

The plain form is tests/terms/conic_field_reference.py. Pixels are counted from the ellipse's own origin (u0, v0), a whole pixel.
"""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled_as_numpy, inlined

ORIGIN_U, ORIGIN_V, CENTRE_U, CENTRE_V, S11, S12, S22, GAMMA, SCALE = range(9)
"""Columns of `ellipses`: origin [px]; centre from there [px]; shape S: (x − m)ᵀ S⁻¹ (x − m) = 1 is the outline [px²];
C*₃₃ [m²]; factor of the field. A scale of 0 says: not seen by this camera."""
ELLIPSE = 9
FIELD = 13
"""numbers that move and deform an ellipsoid: v, G (row by row), and by how much its outline is farther out [m]"""


@inlined
def room():  # pragma: no cover - compiled
    """Return room for what `_to_image` fills."""
    return np.empty((3, 3)), np.empty((3, 3)), np.empty(3)


@compiled_as_numpy
def project(
    projection, size, centre, shape, levels, depth_scaled, ellipses
):  # pragma: no cover - compiled
    """Fill ellipses (E, 9). Skipped (scale 0): ellipsoids that reach the camera's plane, or have no breadth.

    Parameters
    ----------
    size
        Width, height [px].
    """
    (width, height), image = size, room()
    g, d, p = image
    for e in range(centre.shape[0]):
        ellipses[e, SCALE] = 0.0
        _to_image(projection, 0.0, 0.0, centre, shape, e, image)
        gamma = _dual(g, d, p, 2, 2)
        if not (p[2] > 0.0 and gamma < -1e-6 * p[2] * p[2]):
            continue
        u, v = _dual(g, d, p, 0, 2) / gamma, _dual(g, d, p, 1, 2) / gamma
        u0 = np.rint(min(max(u, 0.0), width - 1.0))
        v0 = np.rint(min(max(v, 0.0), height - 1.0))
        _to_image(projection, u0, v0, centre, shape, e, image)
        mu, mv = u - u0, v - v0
        s11 = mu * mu - _dual(g, d, p, 0, 0) / gamma
        s12 = mu * mv - _dual(g, d, p, 0, 1) / gamma
        s22 = mv * mv - _dual(g, d, p, 1, 1) / gamma
        if not (s11 > 0.0 and s22 > 0.0 and s11 * s22 - s12 * s12 > 1e-14 * s11 * s22):
            continue
        ellipses[e, ORIGIN_U], ellipses[e, ORIGIN_V] = u0, v0
        ellipses[e, CENTRE_U], ellipses[e, CENTRE_V] = mu, mv
        ellipses[e, S11], ellipses[e, S12], ellipses[e, S22] = s11, s12, s22
        ellipses[e, GAMMA] = gamma
        ellipses[e, SCALE] = -1.0 / gamma if depth_scaled else levels[e, 1]


@inlined
def _dual(g, d, p, i, j):  # pragma: no cover - compiled
    """Return an entry of the dual conic G D Gᵀ − p pᵀ."""
    return g[i, 0] * d[0, j] + g[i, 1] * d[1, j] + g[i, 2] * d[2, j] - p[i] * p[j]


@inlined
def _to_image(projection, u0, v0, centre, shape, e, image):  # pragma: no cover - compiled
    """Fill image: G (3, 3), D Gᵀ (3, 3) and p = G c + h (3,) of an ellipsoid, pixels counted from (u0, v0)."""
    g, d, p = image
    p[2] = projection[2, 3]
    p[0] = projection[0, 3] - u0 * p[2]
    p[1] = projection[1, 3] - v0 * p[2]
    for j in range(3):
        g[2, j] = projection[2, j]
        g[0, j] = projection[0, j] - u0 * g[2, j]
        g[1, j] = projection[1, j] - v0 * g[2, j]
        for i in range(3):
            p[i] += g[i, j] * centre[e, j]
    for i in range(3):
        for j in range(3):
            d[i, j] = shape[e, i, 0] * g[j, 0] + shape[e, i, 1] * g[j, 1] + shape[e, i, 2] * g[j, 2]


@inlined
def _outline(ellipses, e):  # pragma: no cover - compiled
    """Return an ellipse's middle m, shape S, Q = S⁻¹ and Q m."""
    mu, mv = ellipses[e, CENTRE_U], ellipses[e, CENTRE_V]
    s11, s12, s22 = ellipses[e, S11], ellipses[e, S12], ellipses[e, S22]
    determinant = s11 * s22 - s12 * s12
    q11, q12, q22 = s22 / determinant, -s12 / determinant, s11 / determinant
    return (mu, mv), (s11, s12, s22), (q11, q12, q22), (q11 * mu + q12 * mv, q12 * mu + q22 * mv)


@inlined
def _change(outline, d11, d12, d22, towards):  # pragma: no cover - compiled
    """Return the changes of Q (3), of Q m (2) and of mᵀ Q m by that of the dual conic over γ: its entries 11, 12, 22, and 13, 23, 33."""
    (mu, mv), (s11, s12, s22), (q11, q12, q22), (k1, k2) = outline
    d13, d23, d33 = towards
    du, dv = d13 - mu * d33, d23 - mv * d33
    ds11 = 2.0 * mu * du - d11 + (mu * mu - s11) * d33
    ds12 = mu * dv + mv * du - d12 + (mu * mv - s12) * d33
    ds22 = 2.0 * mv * dv - d22 + (mv * mv - s22) * d33
    dq11 = -(q11 * q11 * ds11 + 2.0 * q11 * q12 * ds12 + q12 * q12 * ds22)
    dq12 = -(q11 * q12 * ds11 + (q11 * q22 + q12 * q12) * ds12 + q12 * q22 * ds22)
    dq22 = -(q12 * q12 * ds11 + 2.0 * q12 * q22 * ds12 + q22 * q22 * ds22)
    dk1 = dq11 * mu + dq12 * mv + q11 * du + q12 * dv
    dk2 = dq12 * mu + dq22 * mv + q12 * du + q22 * dv
    return dq11, dq12, dq22, dk1, dk2, dk1 * mu + dk2 * mv + k1 * du + k2 * dv


@compiled_as_numpy
def conic_of(ellipses, e, outer, c):  # pragma: no cover - compiled
    """Fill c (6,), the field's numbers for (x², 2xy, y², 2x, 2y, 1): scale · (normalised conic − outer)."""
    (mu, mv), _, (q11, q12, q22), (k1, k2) = _outline(ellipses, e)
    s = ellipses[e, SCALE]
    c[0], c[1], c[2] = s * q11, s * q12, s * q22
    c[3], c[4] = -s * k1, -s * k2
    c[5] = s * (mu * k1 + mv * k2 - 1.0 - outer)


@compiled_as_numpy
def conic_by_twist(field, shapes, ellipses, e, image, work):  # pragma: no cover - compiled
    """Fill work[72:120], seen as (6, 8), with the derivative of `conic_of` by (v, ω), and two zeros
    a row.

    One flat array, constant places: only so can LLVM see that nothing overlaps, and do all eight
    columns at once.

    Parameters
    ----------
    shapes
        Centres (E, 3) and R diag(r²) Rᵀ (E, 3, 3) of ellipsoids, and what twists are about.
    image
        `room`.
    work
        (168,), zeros at first.
    """
    (centre, shape, reference), (g, d, p) = shapes, image
    origin_u, origin_v = ellipses[e, ORIGIN_U], ellipses[e, ORIGIN_V]
    _to_image(field.projection, origin_u, origin_v, centre, shape, e, image)
    r0, r1 = centre[e, 0] - reference[0], centre[e, 1] - reference[1]
    r2 = centre[e, 2] - reference[2]
    for i in range(3):  # dp_i
        work[8 * i + 0], work[8 * i + 1], work[8 * i + 2] = g[i, 0], g[i, 1], g[i, 2]
        work[8 * i + 3] = r1 * g[i, 2] - r2 * g[i, 1]
        work[8 * i + 4] = r2 * g[i, 0] - r0 * g[i, 2]
        work[8 * i + 5] = r0 * g[i, 1] - r1 * g[i, 0]
    at = 24  # dC*_ij − what moving the centre does
    for j in range(3):
        for i in range(j + 1):
            work[at + 3] = (
                d[1, j] * g[i, 2] - d[2, j] * g[i, 1] + d[1, i] * g[j, 2] - d[2, i] * g[j, 1]
            )
            work[at + 4] = (
                d[2, j] * g[i, 0] - d[0, j] * g[i, 2] + d[2, i] * g[j, 0] - d[0, i] * g[j, 2]
            )
            work[at + 5] = (
                d[0, j] * g[i, 1] - d[1, j] * g[i, 0] + d[0, i] * g[j, 1] - d[1, i] * g[j, 0]
            )
            at += 8
    outline, inverse, s = _outline(ellipses, e), 1.0 / ellipses[e, GAMMA], ellipses[e, SCALE]
    (mu, mv), _, (q11, q12, q22), (k1, k2) = outline
    outer, level = field.levels[e, 0], mu * k1 + mv * k2 - 1.0
    p0, p1, p2 = p[0], p[1], p[2]
    # the factor is −1/γ in the paper's scale, and constant else
    ds_by_d33 = -s if field.depth_scaled else 0.0
    for t in range(8):
        j0, j1, j2 = work[t], work[8 + t], work[16 + t]
        d11 = (work[24 + t] - 2.0 * j0 * p0) * inverse
        d12 = (work[32 + t] - j0 * p1 - j1 * p0) * inverse
        d22 = (work[40 + t] - 2.0 * j1 * p1) * inverse
        d13 = (work[48 + t] - j0 * p2 - j2 * p0) * inverse
        d23 = (work[56 + t] - j1 * p2 - j2 * p1) * inverse
        d33 = (work[64 + t] - 2.0 * j2 * p2) * inverse
        dq11, dq12, dq22, dk1, dk2, dlevel = _change(outline, d11, d12, d22, (d13, d23, d33))
        ds = ds_by_d33 * d33
        work[72 + t] = s * dq11 + ds * q11
        work[80 + t] = s * dq12 + ds * q12
        work[88 + t] = s * dq22 + ds * q22
        work[96 + t] = -s * dk1 - ds * k1
        work[104 + t] = -s * dk2 - ds * k2
        work[112 + t] = s * dlevel + ds * (level - outer)


@compiled_as_numpy
def conic_by_field(
    field, shapes, ellipses, e, image, stretched, conic
):  # pragma: no cover - compiled
    """Return the derivative of `conic_of` by FIELD numbers (6, FIELD).
    docs/explanation/silhouettes.md

    Parameters
    ----------
    shapes, image
        As in `conic_by_twist`.
    stretched
        R diag(r²) Rᵀ of the ellipsoid with r times its own radii, and with r; where
        it is turned by the antisymmetric part of G, and stretched by the symmetric one.
    conic
        Its own numbers, see `conic_of`.
    """
    (centres, all_shapes, reference), (own, wide), (g, _, p) = shapes, stretched, image
    centre, shape, by = centres[e], all_shapes[e], np.empty((6, FIELD))
    origin_u, origin_v = ellipses[e, ORIGIN_U], ellipses[e, ORIGIN_V]
    _to_image(field.projection, origin_u, origin_v, centres, all_shapes, e, image)
    outline, inverse, s = _outline(ellipses, e), 1.0 / ellipses[e, GAMMA], ellipses[e, SCALE]
    moved, half, dp, dual = np.empty(3), np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    for t in range(FIELD):
        for a in range(3):  # d centre; half of d shape, without its transpose
            moved[a] = 0.0
            for b in range(3):
                half[a, b] = wide[a, b] if t == 12 else 0.0
        if t < 3:
            moved[t] = 1.0
        elif t < 12:
            i, j = (t - 3) // 3, (t - 3) % 3
            moved[i] = centre[j] - reference[j]
            for k in range(3):
                half[i, k] += 0.5 * (shape[j, k] + own[j, k])
                half[j, k] += 0.5 * (own[i, k] - shape[i, k])
        for i in range(3):
            dp[i] = g[i, 0] * moved[0] + g[i, 1] * moved[1] + g[i, 2] * moved[2]
        for i in range(3):
            for j in range(3):
                total = -dp[i] * p[j] - p[i] * dp[j]
                for a in range(3):
                    for b in range(3):
                        total += g[i, a] * (half[a, b] + half[b, a]) * g[j, b]
                dual[i, j] = total * inverse
        towards = dual[0, 2], dual[1, 2], dual[2, 2]
        change = _change(outline, dual[0, 0], dual[0, 1], dual[1, 1], towards)
        for i in range(3):
            by[i, t] = s * change[i]
        by[3, t], by[4, t], by[5, t] = -s * change[3], -s * change[4], s * change[5]
        if field.depth_scaled:  # the factor is −1/γ then
            for i in range(6):
                by[i, t] -= conic[i] * dual[2, 2]
    return by
