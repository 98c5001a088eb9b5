"""Compiled search for edges along normals."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled_as_numpy
from handtrack.terms.images.smooth_image_kernels import cell, look_up


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
