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
    """Fill areas (N, 2), zeros at first: pixels that each part covers, and −ΣZ over them, by one row of each `step`.

    Part n is the ellipsoids members[starts[n] : starts[n + 1]].
    """
    valid, begins, ends, values = mask.valid, mask.begins, mask.ends, mask.values
    count, height, width = ellipsoids[0].shape[0], valid.shape[0], (mask.powers.shape[0] - 1) // 2
    centres, shapes = np.empty((count, 3)), np.empty((count, 3, 3))
    posed_shapes(frames, ellipsoids, centres, shapes)
    ellipses, levels = np.zeros((count, ELLIPSE)), np.ones((count, 2))
    project(projection, (width, height), centres, shapes, levels, False, ellipses)
    lines, rows, wanted = np.empty((count, 5)), np.zeros((count, 2), np.int64), members.copy()
    top, bottom, kept = height, 0, 0
    for n in range(members.shape[0]):
        e = members[n]
        if ellipses[e, SCALE] == 0.0 or rows[e, 1] > 0:
            continue
        _fill_line(ellipses[e], lines[e])
        middle, reach = lines[e, 1], np.sqrt(ellipses[e, S22])
        rows[e, 0] = np.int64(max(np.ceil(middle - reach), 0.0))
        rows[e, 1] = np.int64(min(np.floor(middle + reach) + 1.0, float(height)))
        top, bottom = min(top, rows[e, 0]), max(bottom, rows[e, 1])
        wanted[kept], kept = e, kept + 1
    own, spans = np.zeros((count, 2), np.int64), np.empty((count, 2), np.int64)
    for v in range(top, bottom, step):
        for n in range(kept):
            e = wanted[n]
            own[e, 1] = -1
            if rows[e, 0] <= v < rows[e, 1]:
                _fill_span(lines[e], v, valid[v], own[e])
        for part in range(starts.shape[0] - 1):
            found = 0
            for n in range(starts[part], starts[part + 1]):
                if own[members[n], 1] > 0:
                    found = _insert(own[members[n]], spans, found)
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
                        areas[part, 0] += end - a
                        areas[part, 1] -= (end - a) * values[piece]
                    a = end
                    if ends[piece] <= a and a < b:
                        piece += 1
    areas *= step


@compiled
def _fill_line(ellipse, line):  # pragma: no cover - compiled
    """Fill what an ellipse's span on a row needs: middle [px], its slant, half-width² by room, room lost by row²."""
    s11, s12, s22 = ellipse[S11], ellipse[S12], ellipse[S22]
    line[0] = ellipse[ORIGIN_U] + ellipse[CENTRE_U]
    line[1] = ellipse[ORIGIN_V] + ellipse[CENTRE_V]
    line[2], line[3], line[4] = s12 / s22, (s11 * s22 - s12 * s12) / s22, 1.0 / s22


@compiled
def _fill_span(line, v, valid, span):  # pragma: no cover - compiled
    """Fill the columns [a, b) of an ellipse on row v that were observed; b stays −1 where there are none."""
    dy = v - line[1]
    room = 1.0 - dy * dy * line[4]
    half = np.sqrt(max(room, 0.0) * line[3])
    middle = line[0] + line[2] * dy
    a = np.int64(np.ceil(max(middle - half, float(valid[0]))))
    b = np.int64(np.floor(min(middle + half, valid[1] - 1.0))) + 1
    if room >= 0.0 and a < b:
        span[0], span[1] = a, b


@compiled
def _insert(span, spans, found):  # pragma: no cover - compiled
    """Put a span among spans (N, 2), which ascend by their begins; return how many there are then."""
    n = found
    while n > 0 and spans[n - 1, 0] > span[0]:
        spans[n, 0], spans[n, 1] = spans[n - 1, 0], spans[n - 1, 1]
        n -= 1
    spans[n, 0], spans[n, 1] = span[0], span[1]
    return found + 1
