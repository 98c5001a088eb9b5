"""The skin of a model as one mesh, each vertex on one bone, and its joints as lines: what is drawn, animated and embedded."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D3, D4, B, F, Floats, Ints, T, V, array_dataclass
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.surfaces.part_mesh import vertex_normals
from handtrack.model.surfaces.surface_mesh import carried_mesh, model_mesh


@array_dataclass
class Skin:
    """A triangle mesh on bones."""

    bone: Ints[V]
    local: Floats[V, D3]
    """in that bone's frame [m]"""
    normal: Floats[V, D3]
    """unit, outwards, in that bone's frame"""
    faces: Ints[T, D3]
    """counter-clockwise seen from outside"""

    def carried(self, T_world_bone: Floats[F, B, D4, D4]) -> Floats[F, V, D3]:
        """Return the vertices in the world for each of F poses [m]."""
        own = T_world_bone[:, self.bone]
        return np.einsum("fvij,vj->fvi", own[..., :3, :3], self.local) + own[..., :3, 3]


def model_skin(model: ArticulatedModel) -> Skin:
    """Return a hand's merged surface in one piece, where it has metaballs; else its parts."""
    if model.kind == "hand" and "metaballs" in model.flesh:
        relaxed = model.bones(model.rest_params())
        mesh = carried_mesh(model, relaxed)
        turned = np.swapaxes(relaxed.rotation[mesh.bone], 1, 2)
        normals = vertex_normals(mesh.vertices, mesh.faces)
        return Skin(mesh.bone, mesh.local, np.einsum("vij,vj->vi", turned, normals), mesh.faces)
    parts = model_mesh(model)
    return Skin(parts.bone, parts.local, parts.normal, parts.faces)


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
            links.append((_closest(model, before, place), joint))
    return links


def _on(model: ArticulatedModel, bone: int) -> list[int]:
    return np.flatnonzero(model.joint_bone == bone).tolist()


def _closest(model: ArticulatedModel, joints: list[int], place: Floats[D3]) -> int:
    return min(joints, key=lambda k: float(np.linalg.norm(model.joint_point[k] - place)))
