"""Edge term: image edges lie on the model's outline; robust, normalised, without masks. 2003 paper, section 2."""

from __future__ import annotations

from collections.abc import Sequence

from handtrack.arrays import array_dataclass
from handtrack.errors import HandtrackError
from handtrack.model.kinematics import BonePoses
from handtrack.terms.bone_system import Sums
from handtrack.terms.images.edge_search import SeenEdges
from handtrack.terms.images.image_rows_kernels import Pinhole
from handtrack.terms.images.outline_edges_kernels import edges_sums
from handtrack.terms.term import SurfaceTerm


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
            pinhole = Pinhole(camera.matrix, camera.rotation, camera.translation)
            edges = seen.place, seen.strength
            cost += edges_sums(bones.frames, pinhole, pieces, edges, spread, sums)
        return cost
