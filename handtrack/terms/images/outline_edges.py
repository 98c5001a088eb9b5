"""Edge term: image edges lie on the model's outline; robust, normalised, without masks. 2003 paper, section 2."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from handtrack.arrays import Floats
from handtrack.errors import HandtrackError
from handtrack.model.kinematics import BonePoses
from handtrack.terms.compiled_term import CompiledTerm
from handtrack.terms.images.edge_search import SeenEdges
from handtrack.terms.images.outline_edges_kernels import edges_system


@dataclass(frozen=True, eq=False)
class OutlineEdgesTerm(CompiledTerm):
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

    def _accumulate(self, bones: BonePoses, width: int, gradient: Floats, hessian: Floats) -> float:
        cost = 0.0
        for seen in self.seen:
            outline, camera = seen.outline, seen.outline.camera
            cost += edges_system(
                outline.bone,
                bones.on_flesh(outline.bone, outline.local),
                outline.pixel,
                outline.normal,
                self.weight * outline.length_px / self.stretch_px,
                seen.place,
                seen.strength,
                self.sigma_px,
                self.clutter,
                self.from_unexplained,
                camera.matrix,
                camera.rotation,
                camera.translation,
                bones.rotation,
                bones.position,
                bones.reference,
                width,
                gradient,
                hessian,
            )
        return cost
