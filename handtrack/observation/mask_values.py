"""What the numbers of a mask mean: booleans, 0 and 1, 0 to 255, or shares of a pixel."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import Array, H, W
from handtrack.errors import HandtrackError

UNKNOWN = np.float32(-1.0)
"""in a silhouette's mask: hand or background, nobody knows; the lowest of its values, and the only one below 0"""

_BYTE = 255.0
_BYTES_FROM = 128.0
"""a mask whose highest value is from here on holds bytes; between 1 and this it could be labels as well"""
_ROUNDING = 1e-5
"""by which resampling in float32 may leave [0, 1]"""


def coverage_of(mask: Array[H, W], size: tuple[int, int], who: str) -> Array[H, W]:
    """Return how much of each pixel the hand covers, float32 in [0, 1], UNKNOWN where nobody can tell.

    mask: booleans; numbers 0 to 1; or 0 to 255, which is told by the highest of them. NaN and −1 mean unknown. size:
    width, height [px] that it must have. who: names it in errors. Raises HandtrackError for another shape, and for numbers
    that may mean anything: labels, distances, a picture.
    """
    mask = np.asarray(mask)
    width, height = size
    if mask.shape != (height, width):
        raise HandtrackError(
            f"{who}: it has the shape {mask.shape}, expected {(height, width)}, rows × columns of the camera's image. "
            f"{_advice(mask, size)}"
        )
    if mask.dtype == bool:
        return mask.astype(np.float32)
    if mask.dtype.kind not in "uif":
        raise HandtrackError(f"{who}: it holds {mask.dtype}; expected booleans or numbers.")
    low, high = (float(mask.min()), float(mask.max())) if mask.size else (0.0, 0.0)
    values = mask.astype(np.float32, copy=False)
    if np.isnan(low):
        values = np.where(np.isnan(values), UNKNOWN, values)
        low, high = float(values.min()), float(values.max())
    if high > 1.0 + _ROUNDING:
        if not _BYTES_FROM <= high <= _BYTE:
            raise HandtrackError(
                f"{who}: its highest value is {high:g}; expected booleans, 0 to 1, or 0 to 255. Labels are no mask: give "
                "`labels == hand`."
            )
        values = np.where(values < 0, values, values / np.float32(_BYTE)) if low < 0 else values / np.float32(_BYTE)  # fmt: skip
    if low < 0 and not (np.isclose(values[values < 0], UNKNOWN).all()):
        raise HandtrackError(
            f"{who}: its lowest value is {low:g}; expected 0 for background, or −1 (or NaN) where nobody can tell."
        )
    return np.minimum(values, np.float32(1.0)) if high > 1.0 else values


def _advice(mask: Array, size: tuple[int, int]) -> str:
    if mask.ndim == 3:
        return "Give one channel: `mask[..., 0]`."
    if mask.shape == size:
        return "Rows and columns are exchanged: give `mask.T`."
    return "Scale the camera to the mask: `camera.scaled((width, height))`."
