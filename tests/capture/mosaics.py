"""Mosaics as sensors of a colour pattern give them."""

import numpy as np

from handtrack.arrays import Array


def mosaic_of(image: Array, pattern: str) -> Array:
    """Return the mosaic (H, W) a sensor of this pattern would give of a colour image (H, W, 3) BGR."""
    mosaic = np.empty(image.shape[:2], image.dtype)
    for (row, column), colour in zip(((0, 0), (0, 1), (1, 0), (1, 1)), pattern):
        mosaic[row::2, column::2] = image[row::2, column::2, "BGR".index(colour)]
    return mosaic
