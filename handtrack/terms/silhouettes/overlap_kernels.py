"""Compiled areas that ellipsoids' hard outlines cover in a camera, alone and together with the mask."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled
from handtrack.terms.bone_kernels import posed_shapes
from handtrack.terms.silhouettes.conic_kernels import (
    CENTRE_U,
    CENTRE_V,
    ELLIPSE,
    ORIGIN_U,
    ORIGIN_V,
    S11,
    S12,
    S22,
    SCALE,
    project,
)


@compiled
def overlap_areas(
    frames, ellipsoids, projection, mask, starts, members, step, areas
):  # pragma: no cover - compiled
    """Fill areas (N, 2): pixels that each part covers, and −ΣZ over them, by one row of each `step`.

    Part n is the ellipsoids members[starts[n] : starts[n + 1]].
    """
    valid, begins, ends, values = mask.valid, mask.begins, mask.ends, mask.values
    count, height, width = ellipsoids[0].shape[0], valid.shape[0], (mask.powers.shape[0] - 1) // 2
    centres, shapes = np.empty((count, 3)), np.empty((count, 3, 3))
    posed_shapes(frames, ellipsoids, centres, shapes)
    ellipses, levels = np.zeros((count, ELLIPSE)), np.ones((count, 2))
    project(projection, width, height, centres, shapes, levels, False, ellipses)
    spans = np.empty((count, 2), np.int64)
    for part in range(starts.shape[0] - 1):
        covered, both = 0.0, 0.0
        top, bottom = height, 0
        for n in range(starts[part], starts[part + 1]):
            ellipse = ellipses[members[n]]
            if ellipse[SCALE] != 0.0:
                middle, reach = ellipse[ORIGIN_V] + ellipse[CENTRE_V], np.sqrt(ellipse[S22])
                top = min(top, np.int64(max(np.ceil(middle - reach), 0.0)))
                bottom = max(bottom, np.int64(min(np.floor(middle + reach) + 1.0, float(height))))
        for v in range(top, bottom, step):
            found = 0
            for n in range(starts[part], starts[part + 1]):
                ellipse = ellipses[members[n]]
                if ellipse[SCALE] != 0.0:
                    found = _insert(ellipse, v, valid[v, 0], valid[v, 1], spans, found)
            piece, done = begins[v], 0
            for n in range(found):
                a, b = max(spans[n, 0], done), spans[n, 1]
                if a >= b:
                    continue
                done = b
                while ends[piece] <= a:
                    piece += 1
                while a < b:
                    end = min(ends[piece], b)
                    if values[piece] <= 0.0:
                        covered += end - a
                        both -= (end - a) * values[piece]
                    a = end
                    if ends[piece] <= a and a < b:
                        piece += 1
        areas[part, 0], areas[part, 1] = step * covered, step * both


@compiled
def _insert(ellipse, v, begin, end, spans, found):  # pragma: no cover - compiled
    """Put an ellipse's span on row v among spans (N, 2), which ascend by their begins; returns how many there are then."""
    s11, s12, s22 = ellipse[S11], ellipse[S12], ellipse[S22]
    dy = v - (ellipse[ORIGIN_V] + ellipse[CENTRE_V])
    room = 1.0 - dy * dy * (1.0 / s22)
    half = np.sqrt(max(room, 0.0) * ((s11 * s22 - s12 * s12) / s22))
    middle = ellipse[ORIGIN_U] + ellipse[CENTRE_U] + s12 / s22 * dy
    a = np.int64(np.ceil(max(middle - half, float(begin))))
    b = np.int64(np.floor(min(middle + half, end - 1.0))) + 1
    if room < 0.0 or a >= b:
        return found
    n = found
    while n > 0 and spans[n - 1, 0] > a:
        spans[n, 0], spans[n, 1] = spans[n - 1, 0], spans[n - 1, 1]
        n -= 1
    spans[n, 0], spans[n, 1] = a, b
    return found + 1
