"""The skin of a model as one mesh, each vertex on one bone, and its joints as lines: what is drawn, animated and embedded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handtrack.model.articulated import ArticulatedModel
from handtrack.model.surfaces.metaballs import SHARPNESS_PER_M
from handtrack.model.surfaces.part_mesh import PartMesh, vertex_normals
from handtrack.model.surfaces.surface_mesh import model_mesh, relaxed_mesh


def model_skin(model: ArticulatedModel) -> PartMesh:
    """Return a hand's merged surface in one piece, where it has metaballs; else its parts."""
    if model.kind != "hand" or "metaballs" not in model.ellipsoids:
        return model_mesh(model)
    relaxed = model.bones(model.rest_params())
    mesh = relaxed_mesh(model, SHARPNESS_PER_M, "d3")
    turned = np.swapaxes(relaxed.rotation[mesh.bone], 1, 2)
    normals = vertex_normals(mesh.carried(relaxed)[0], mesh.faces)
    return replace(mesh, normal=np.einsum("vij,vj->vi", turned, normals))


# ---- Which named joints are connected by bones: the lines of a stick figure


def joint_links(model: ArticulatedModel) -> list[tuple[int, int]]:
    """Return pairs of joints (nearer to the root, farther): each hangs on the closest one before it along the bones."""
    links = []
    for joint, (bone, point) in enumerate(zip(model.joint_bone, model.joint_point)):
        before = [
            k
            for k in _on(model, int(bone))
            if np.linalg.norm(model.joint_point[k]) < np.linalg.norm(point)
        ]
        above, place = int(bone), point
        while not before and above >= 0:
            place = model.skeleton.offset[above]  # where this bone begins, in the one above it
            above = int(model.skeleton.parent[above])
            before = _on(model, above)
        if before:
            away = np.linalg.norm(model.joint_point[before] - place, axis=1)
            links.append((before[int(np.argmin(away))], joint))
    return links


def _on(model: ArticulatedModel, bone: int) -> list[int]:
    return np.flatnonzero(model.joint_bone == bone).tolist()
