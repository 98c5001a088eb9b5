"""Edges along the normals of a predicted outline, and their term: image edges lie on the model's outline; robust, normalised, without masks. 2003 paper, section 2."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import Floats, K, N, array_dataclass
from handtrack.errors import HandtrackError
from handtrack.model.kinematics import BonePoses
from handtrack.terms.bone_system import Sums
from handtrack.terms.images.image_kernels import edges_sums, search_along
from handtrack.terms.images.model_outline import OutlinePoints
from handtrack.terms.images.smooth_image import SmoothImage
from handtrack.terms.term import SurfaceTerm

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


@array_dataclass
class OutlineEdgesTerm(SurfaceTerm):
    """−weight Σ (ℓ/stretch) log p(x): each piece of outline, ℓ long, explains one of the edges on its normal, or none.

    x is how far the piece has moved along the normal of its start, x_k where the edges are, a_k their strengths:
    p(x) = (clutter + Σ a_k exp(−(x − x_k)²/2σ²)) / (clutter + Σ a_k). Pieces and edges are those of the stage's
    start (`edges_near`), so that cost and gradient agree; a wide σ joins the edges, a narrow one chooses among them.
    The Hessian leaves out what would make it negative: weights of the edges over σ².
    """

    seen: Sequence[SeenEdges]
    """of each camera"""
    sigma_px: float
    stretch_px: float = 10.0
    """along how much of the outline an error stays the same"""
    clutter: float = 0.1
    """strength that an outline without any edge has"""
    weight: float = 1.0
    from_unexplained: bool = False
    """count from what a piece without an edge costs, so that a pose that shows less outline does not seem better"""
    name: str = "edges"

    def __post_init__(self) -> None:
        if not (self.sigma_px > 0 and self.stretch_px > 0 and self.clutter > 0):
            raise HandtrackError(
                f"{self.name}: sigma {self.sigma_px:g} px, stretch {self.stretch_px:g} px, clutter {self.clutter:g}; "
                "expected positive numbers."
            )

    def add_to(self, bones: BonePoses, sums: Sums) -> float:
        cost, spread = 0.0, (self.sigma_px, self.clutter, self.from_unexplained)
        for seen in self.seen:
            outline, camera = seen.outline, seen.outline.camera
            weight = self.weight * outline.length_px / self.stretch_px
            local = bones.on_flesh(outline.bone, outline.local)
            pieces = outline.bone, local, outline.pixel, outline.normal, weight
            pinhole = camera.matrix, camera.rotation, camera.translation
            edges = seen.place, seen.strength
            cost += edges_sums(bones.frames, pinhole, pieces, edges, spread, sums)
        return cost
