"""PartMesh: a mesh of a model, each vertex fixed to its bone; of all parts in one, such as ellipsoids, or of the merged surface."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D3, Array, F, Floats, Ints, T, V, array_dataclass, contiguous
from handtrack.model.ellipsoids import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.model.kinematics_kernels import carry


@array_dataclass
class PartMesh:
    """Closed triangle meshes on bones. Parts may lie in each other; what is hidden is for the camera to find."""

    bone: Ints[V]
    """the bone of each vertex; of parts the three of a face have the same"""
    local: Floats[V, D3]
    """in that bone's frame [m]"""
    normal: Floats[V, D3]
    """unit, outwards, in that bone's frame"""
    faces: Ints[F, D3]
    """counter-clockwise seen from outside"""

    def carried(self, bones: BonePoses) -> tuple[Floats[V, D3], Floats[V, D3]]:
        """Return vertices [m] and their normals in the world."""
        places, normals = np.empty((2, *self.local.shape))
        local, normal = contiguous(bones.rescaled(self.bone, self.local), self.normal)
        carry(bones.frames, self.bone, local, normal, places, normals)
        return places, normals

    def subset(self, keep: Array[V]) -> PartMesh:
        """Return only the faces of which all vertices are kept. keep: booleans."""
        kept = np.flatnonzero(keep)
        renumbered = np.full(len(self.bone), -1)
        renumbered[kept] = np.arange(len(kept))
        faces = renumbered[self.faces[keep[self.faces].all(axis=1)]]
        return PartMesh(self.bone[kept], self.local[kept], self.normal[kept], faces)


def ellipsoid_mesh(ellipsoids: Ellipsoids, divisions: int = 2) -> PartMesh:
    """Return every ellipsoid as a mesh with 20 · 4^divisions faces.

    Its corners stand a little outside, so that the outline is of the right size on average: a chord of angle θ lies
    θ²/12 inside its arc.
    """
    ball, faces = _icosphere(divisions)
    edge = ball[faces[:, 0]] - ball[faces[:, 1]]
    outside = 1.0 + float((edge**2).sum(axis=1).mean()) / 12.0
    scaled = ellipsoids.radii[:, None, :] * ball * outside
    local = ellipsoids.centre[:, None] + np.einsum("eij,evj->evi", ellipsoids.rotation, scaled)
    normal = np.einsum("eij,evj->evi", ellipsoids.rotation, ball / ellipsoids.radii[:, None, :])
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    count = len(ellipsoids)
    everyone = faces[None] + len(ball) * np.arange(count)[:, None, None]
    return PartMesh(
        np.repeat(ellipsoids.bone, len(ball)),
        local.reshape(-1, 3),
        normal.reshape(-1, 3),
        everyone.reshape(-1, 3),
    )


def vertex_normals(vertices: Floats[V, D3], faces: Ints[T, D3]) -> Floats[V, D3]:
    """Return unit normals of a mesh: of the faces around each vertex, weighted by their areas."""
    corner = vertices[faces]
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal = np.zeros_like(vertices)
    for i in range(3):
        np.add.at(normal, faces[:, i], across)
    return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)


def _icosphere(divisions: int) -> tuple[Floats, Ints]:
    """Return points (V, 3) on the unit ball and faces (F, 3), counter-clockwise seen from outside."""
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    long, short = [1.0, -1.0], [golden, -golden]
    points = [(0.0, a, b) for a in long for b in short]
    points += [(a, b, 0.0) for a in long for b in short]
    points += [(b, 0.0, a) for a in long for b in short]
    ball = np.array(points) / np.hypot(1.0, golden)
    for _ in range(divisions):
        sides = _hull(ball)[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        middle = ball[np.unique(np.sort(sides), axis=0)].sum(axis=1)
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        ball = np.concatenate([ball, middle])
    return ball, _hull(ball)


def _hull(ball: Floats[V, D3]) -> Ints[T, D3]:
    """Return the triangles between points of a ball, counter-clockwise seen from outside."""
    from scipy.spatial import ConvexHull

    faces = np.array(ConvexHull(ball).simplices, int)
    inward = np.linalg.det(ball[faces]) < 0
    faces[inward] = faces[inward, ::-1]
    return faces
