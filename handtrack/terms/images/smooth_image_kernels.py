"""Compiled bilinear look-ups in an image of several channels."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled_as_numpy, inlined


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
def look_up_all(image, pixels, values, slopes):  # pragma: no cover - compiled
    """Fill values (N, C) and slopes (N, C, 2) at pixels (N, 2) of this window."""
    height, width, channels = image.shape
    for n in range(pixels.shape[0]):
        j, q, in_u = cell(pixels[n, 0], width)
        i, p, in_v = cell(pixels[n, 1], height)
        for c in range(channels):
            value, du, dv = look_up(image, i, j, p, q, c)
            values[n, c] = value
            slopes[n, c, 0], slopes[n, c, 1] = in_u * du, in_v * dv
