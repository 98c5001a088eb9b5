"""Silhouettes as the conic field of the 2007 paper (eqs. 18–29), by moments instead of a Jacobian of pixels."""

from __future__ import annotations

from collections.abc import Sequence

from handtrack.model.flesh import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import Silhouette
from handtrack.terms.bone_system import BoneSystem
from handtrack.terms.silhouettes.prepared_silhouette import PreparedSilhouette
from handtrack.terms.silhouettes.silhouette_field import field_system, plain_field, prepared


class ConicFieldTerm:
    """½ weight Σ (P − Z)² over all observed pixels; P the lowest conic field, Z = −mask or a given field image.

    It has no gradient where the hand is seen beside the model, and on masks its minimum is biased: CoverageTerm is
    the default. normalised: fields are −1 at their centres; otherwise 1/C*₃₃ [m⁻²], the paper's scale, in which near
    ellipsoids hide far ones. That scale needs an observed field in the same scale: `prepare(s, observation=...)`.
    """

    def __init__(
        self,
        silhouettes: Sequence[Silhouette | PreparedSilhouette],
        ellipsoids: Ellipsoids,
        weight: float | Sequence[float] = 1.0,
        normalised: bool = True,
        name: str = "conic_field",
    ) -> None:
        self.name = name
        self.weight = weight
        self.ellipsoids = ellipsoids
        self.silhouettes = prepared(silhouettes)
        self.shape = plain_field(len(self.silhouettes), len(ellipsoids), not normalised)

    def cost(self, bones: BonePoses) -> float:
        """Return ½ weight Σ (P − Z)²."""
        return field_system(
            self.silhouettes, self.ellipsoids, self.shape, bones, self.weight, False
        )[0].cost

    def linearize(self, bones: BonePoses) -> BoneSystem:
        """Return cost, gradient and Gauss-Newton Hessian in bone twists."""
        return field_system(self.silhouettes, self.ellipsoids, self.shape, bones, self.weight)[0]

    def linearize_growth(self, bones: BonePoses) -> BoneSystem:
        """Return the same in seven numbers a bone, with its growth."""
        return field_system(
            self.silhouettes, self.ellipsoids, self.shape, bones, self.weight, growing=True
        )[0]
