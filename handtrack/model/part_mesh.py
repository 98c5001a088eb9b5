"""PartMesh: a mesh of a model, each vertex fixed to its bone; of all parts in one, such as ellipsoids, or of the merged surface."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from handtrack.arrays import D2, D3, Array, E, F, Floats, Ints, N, T, V, array_dataclass, contiguous
from handtrack.errors import HandtrackError
from handtrack.geometry.rotation import rotation_matrix
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


def vertex_normals(vertices: Floats[V, D3], faces: Ints[T, D3]) -> Floats[V, D3]:
    """Return unit normals of a mesh: of the faces around each vertex, weighted by their areas."""
    corner = vertices[faces]
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal = np.zeros_like(vertices)
    for i in range(3):
        np.add.at(normal, faces[:, i], across)
    return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)


# ---- Superquadrics on bones, tapered and bent, as meshes: the flesh of a body. 2003 paper, section 2; docs/reference/models.md


_MM = 1e-3
_FROM_BONE = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""bone ← part: a part's z lies along the bone's y, its x towards the bone's z"""


@array_dataclass
class Superquadrics(Ellipsoids):
    """Parts (|x/a|^(2/ε₂) + |y/b|^(2/ε₂))^(ε₂/ε₁) + |z/c|^(2/ε₁) = 1, then tapered, then bent; nine numbers each. a, b and c are
    their radii."""

    exponents: Floats[E, D2]
    """ε₁ along, ε₂ across: 1 an ellipsoid, smaller a box, 2 a double cone"""
    taper: Floats[E, D2]
    """x and y are scaled by 1 + taper · z/c"""
    bend: Floats[E, D2]
    """turn of the axis from one end to the other, and towards where (from x to y) it bends [rad]"""

    def mesh(self, around: int = 16, along: int = 12) -> PartMesh:
        """Return all parts as closed meshes on a grid of latitudes and longitudes.

        Parameters
        ----------
        around
            Points on a circle of latitude.
        along
            Steps from end to end.
        """
        unit_faces = grid_faces(around, along)
        count = 2 + (along - 1) * around
        local, normal = [], []
        for part in range(len(self)):
            own = self.deformed(part, self.undeformed(part, around, along))
            placed = self.centre[part] + own @ self.rotation[part].T
            local.append(placed)
            normal.append(vertex_normals(placed, unit_faces))
        faces = unit_faces[None] + count * np.arange(len(self))[:, None, None]
        return PartMesh(
            np.repeat(self.bone, count),
            np.concatenate(local),
            np.concatenate(normal),
            faces.reshape(-1, 3),
        )

    def undeformed(self, part: int, around: int, along: int) -> Floats[V, D3]:
        """Return (2 + (along − 1) · around, 3) points of a part in its own axes: lower end, circles upwards, upper end."""
        latitude = np.linspace(-0.5 * np.pi, 0.5 * np.pi, along + 1)[1:-1]
        longitude = 2 * np.pi * np.arange(around) / around
        e1, e2 = self.exponents[part]
        wide = _power(np.cos(latitude), e1)[:, None]
        x, y = wide * _power(np.cos(longitude), e2), wide * _power(np.sin(longitude), e2)
        z = np.broadcast_to(_power(np.sin(latitude), e1)[:, None], x.shape)
        circles = np.stack([x, y, z], axis=-1).reshape(-1, 3)
        ends = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
        return np.concatenate([ends[:1], circles, ends[1:]]) * self.radii[part]

    def deformed(self, part: int, points: Floats[N, D3]) -> Floats[N, D3]:
        """Return points of a part's own axes where taper and bend carry them.

        A bend lays the z axis on a circle of curvature κ = turn/2c, lengths on the axis kept.
        """
        x, y, z = points.T
        half = self.radii[part, 2]
        x = x * (1.0 + self.taper[part, 0] * z / half)
        y = y * (1.0 + self.taper[part, 1] * z / half)
        turn, towards = self.bend[part]
        angle = 0.5 * turn * z / half
        c, s = np.cos(towards), np.sin(towards)
        across = c * x + s * y
        # (1 − cos θ)/θ and sin θ/θ hold at θ = 0 too
        shift = z * 0.5 * angle * np.sinc(angle / (2 * np.pi)) ** 2
        moved = across * np.cos(angle) + shift - across
        along = z * np.sinc(angle / np.pi) - across * np.sin(angle)
        return np.stack([x + c * moved, y + s * moved, along], axis=1)


def ellipsoid_mesh(ellipsoids: Ellipsoids, around: int = 16, along: int = 12) -> PartMesh:
    """Return every ellipsoid as `Superquadrics.mesh` does.

    Its corners stand a little outside, so that the outline is of the right size on average: a chord of angle θ lies
    θ²/12 inside its arc.
    """
    outside = 1.0 + ((2.0 * np.pi / around) ** 2 + (np.pi / along) ** 2) / 24.0
    even, none = np.ones((len(ellipsoids), 2)), np.zeros((len(ellipsoids), 2))
    bone, centre, rotation = ellipsoids.bone, ellipsoids.centre, ellipsoids.rotation
    parts = Superquadrics(bone, centre, rotation, outside * ellipsoids.radii, even, none, none)
    return parts.mesh(around, along)


def read_superquadrics(
    rows: Sequence[dict[str, Any]], bones: tuple[str, ...], factor: dict[str, float], where: str
) -> Superquadrics:
    """Return the parts of a definition: lengths in mm along the bone's axes, times each bone's factor."""
    radii = np.array([row["radii"] for row in rows], dtype=float)
    parts = Superquadrics(
        bone=np.array([bones.index(row["bone"]) for row in rows]),
        centre=np.array([row["centre"] for row in rows], dtype=float) * _size(rows, factor),
        rotation=rotation_matrix(np.deg2rad([row.get("rotation_deg", (0, 0, 0)) for row in rows]))
        @ _FROM_BONE,
        radii=radii[:, [2, 0, 1]] * _size(rows, factor),
        exponents=np.array([row.get("exponents", (1, 1)) for row in rows], dtype=float),
        taper=np.array([row.get("taper", (0, 0))[::-1] for row in rows], dtype=float),
        bend=np.deg2rad([row.get("bend_deg", (0, 0)) for row in rows]),
    )
    _check(parts, [f"{row['bone']}_{i}" for i, row in enumerate(rows)], where)
    return parts


def _size(rows: Sequence[dict[str, Any]], factor: dict[str, float]) -> Floats:
    return np.array([factor[row["bone"]] for row in rows])[:, None] * _MM


def _check(parts: Superquadrics, names: Sequence[str], where: str) -> None:
    wide = np.hypot(parts.radii[:, 0], parts.radii[:, 1]) * (1 + np.abs(parts.taper).max(axis=1))
    rules = (
        ((parts.radii > 0).all(axis=1), "radii above 0"),
        (
            ((parts.exponents > 0) & (parts.exponents <= 2)).all(axis=1),
            "exponents above 0, up to 2",
        ),
        ((np.abs(parts.taper) < 1).all(axis=1), "tapers between -1 and 1"),
        (
            0.5 * np.abs(parts.bend[:, 0]) * wide < parts.radii[:, 2],
            "a bend whose circle is wider than the part",
        ),
    )
    for kept, expected in rules:
        if not np.all(kept):
            name = names[int(np.argmin(kept))]
            raise HandtrackError(f"{where}, superquadric '{name}': expected {expected}.")


def _power(base: Floats, exponent: float) -> Floats:
    """Return sign(base) |base|^exponent."""
    return np.sign(base) * np.abs(base) ** exponent


def grid_faces(around: int, along: int) -> Ints[T, D3]:
    """Return the faces of a grid of latitudes and longitudes, counter-clockwise from outside, closed at both ends."""
    if around < 3 or along < 2:
        raise HandtrackError(
            f"superquadrics: a mesh of {around} points around and {along} steps along; expected at least 3 and 2."
        )
    circles = 1 + np.arange((along - 1) * around).reshape(-1, around)
    rows = np.concatenate(
        [np.zeros((1, around), int), circles, np.full((1, around), 1 + circles.size)]
    )
    low, high = rows[:-1], rows[1:]
    low_after, high_after = (np.roll(ends, -1, axis=1) for ends in (low, high))
    # where a row is an end, its corners are one and such a triangle would be none
    wide_below = np.stack([low, low_after, high_after], axis=-1)[1:]
    wide_above = np.stack([low, high_after, high], axis=-1)[:-1]
    return np.concatenate([wide_below.reshape(-1, 3), wide_above.reshape(-1, 3)])
