"""How good demosaicing is: mosaics cut from colour images, and how near the images that come back are. The table of docs/how-to/depth_and_stereo.md."""

import numpy as np

from handtrack.arrays import Array


def mosaic_of(image: Array, pattern: str) -> Array:
    """Return the mosaic (H, W) a sensor of this pattern would give of a colour image (H, W, 3) BGR."""
    mosaic = np.empty(image.shape[:2], image.dtype)
    for (row, column), colour in zip(((0, 0), (0, 1), (1, 0), (1, 1)), pattern):
        mosaic[row::2, column::2] = image[row::2, column::2, "BGR".index(colour)]
    return mosaic


def psnr_db(image: Array, truth: Array, border: int = 4) -> tuple[float, float, float, float]:
    """Return the peak signal-to-noise ratio [dB] of blue, green, red and of all, without a border [px]."""
    inner = slice(border, -border)
    off = image[inner, inner].astype(float) - truth[inner, inner].astype(float)
    peak = float(np.iinfo(truth.dtype).max)
    mean_square = [*np.mean(off**2, axis=(0, 1)), np.mean(off**2)]
    b, g, r, whole = (10 * np.log10(peak**2 / max(float(m), 1e-12)) for m in mean_square)
    return float(b), float(g), float(r), float(whole)
