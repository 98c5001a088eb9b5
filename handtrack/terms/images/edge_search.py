"""Find image edges along the normals of a predicted outline."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import Floats, K, N, array_dataclass
from handtrack.terms.images.edge_search_kernels import search_along
from handtrack.terms.images.model_outline import OutlinePoints
from handtrack.terms.images.smooth_image import SmoothImage

STEP_PX = 0.5  # between samples along a normal
MOST = 4  # edges kept of a normal; more are clutter
FAINT = 2.0  # [grey levels / px] an edge this weak is noise


@array_dataclass
class SeenEdges:
    """Up to MOST edges on the normal of each piece of outline."""

    outline: OutlinePoints
    place: Floats[N, K]
    """(N, MOST) signed distance along the normal from the piece's own pixel [px]"""
    strength: Floats[N, K]
    """(N, MOST) 0 … 1; 0 where there is no edge"""

    @property
    def found(self) -> float:
        """The share of the outline, by length, on whose normals there is any edge."""
        length = self.outline.length_px
        total = float(length.sum())
        return float(length @ (self.strength > 0).any(axis=1)) / total if total > 0 else 0.0


def edges_near(outline: OutlinePoints, image: SmoothImage, search_px: float) -> SeenEdges:
    """Return the edges within ± search_px of an outline.

    An edge is a peak of the slope g of brightness along the normal, over all channels together. Its strength
    g²/(g² + mean g² + FAINT²), the mean along the same normal, does not depend on how bright or contrasted that
    part of the image is: a faint edge counts where all is faint.
    """
    count = len(outline.bone)
    place, strength = np.zeros((count, MOST)), np.zeros((count, MOST))
    start = np.ascontiguousarray(outline.pixel - np.array(image.corner, dtype=float))
    half = max(round(search_px / STEP_PX), 1)
    search_along(image.values, start, outline.normal, half, STEP_PX, FAINT, place, strength)
    return SeenEdges(outline, place, strength)
