"""Silhouettes as the conic field of the 2007 paper (eqs. 18–29), by moments instead of a Jacobian of pixels."""

from __future__ import annotations

from collections.abc import Sequence

from handtrack.model.flesh import Ellipsoids
from handtrack.observation.observation import Silhouette
from handtrack.terms.silhouettes.prepared_silhouette import PreparedSilhouette
from handtrack.terms.silhouettes.silhouette_field import FieldTerm, plain_field


class ConicFieldTerm(FieldTerm):
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
    ) -> None:
        super().__init__(silhouettes, ellipsoids, weight, "conic_field")
        self.shape = plain_field(len(self.silhouettes), len(ellipsoids), not normalised)
