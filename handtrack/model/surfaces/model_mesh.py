"""The mesh of a whole model as a camera can see it: metaball surface or superquadrics."""

from __future__ import annotations

from handtrack.model.articulated import ArticulatedModel
from handtrack.model.surfaces.part_mesh import PartMesh, ellipsoid_mesh


def model_mesh(model: ArticulatedModel) -> PartMesh:
    """Return the parts of a model: a body's superquadrics, or the ellipsoids that silhouettes are fitted with."""
    if model.superquadrics is not None:
        return model.superquadrics.mesh()
    return ellipsoid_mesh(model.flesh["fine"])
