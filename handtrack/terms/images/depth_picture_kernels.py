"""Compiled filling of triangles: the nearest face and its depth at every pixel."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled_as_numpy


@compiled_as_numpy
def fill_triangles(pixels, depth, faces, nearest, front):  # pragma: no cover - compiled
    """Fill nearest (H, W) [m] and front (H, W), the face there, where a face is nearer than what stands in them.

    pixels: (V, 2) in this picture; depth: (V,) z in the camera [m]. Exact at pixel centres: 1/z is linear in the image.
    A face that reaches behind the camera is left out.
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
