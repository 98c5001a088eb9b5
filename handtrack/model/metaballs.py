"""MetaballSurface: ellipsoids merged into one surface, its signed distance and gradient.

2004 paper, sections 3.2 and 3.3. Mathematics: docs/explanation/clouds.md.
"""

from __future__ import annotations

from functools import cached_property, lru_cache

import numpy as np

from handtrack.arrays import (
    D3,
    D16,
    Array,
    Axes,
    E,
    F,
    Floats,
    Ints,
    K,
    L,
    N,
    V,
    array_dataclass,
    check_shape,
)
from handtrack.errors import HandtrackError, check_name
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.ellipsoids import Ellipsoids
from handtrack.model.kinematics import BonePoses, Skeleton
from handtrack.model.metaballs_kernels import merged_distance, pose_table
from handtrack.model.part_mesh import PartMesh, ellipsoid_mesh

FORMS = {"d1": np.inf, "d2": 0.0, "d3": 1.0}
"""Distances to one ellipsoid: the level k below which d1's form (k − 1) r_min holds, d2's beyond."""

SHARPNESS_PER_M = 1000.0
"""β of a hand of scale 1. The 2004 paper does not state its unit; 1/mm rounds creases by about a millimetre."""


@array_dataclass
class MetaballSurface:
    """d = −(1/β) log Σ exp(−β d_e) over the closest ellipsoid and those linked with it.

    Fingers are not linked with each other, so they never merge. Where the closest ellipsoid changes the sum has other
    members, and d may jump by a little.
    """

    ellipsoids: Ellipsoids
    linked: Array[E, E]
    """bool, symmetric, True on the diagonal"""
    sharpness: float = SHARPNESS_PER_M
    """β [1/m]: n equally close linked ellipsoids move the surface outwards by log(n)/β"""
    form: str = "d3"
    """distance to one ellipsoid: `d1`, `d2` or `d3`"""

    def __post_init__(self) -> None:
        check_name("distance to an ellipsoid", self.form, FORMS)
        if not 0.0 < self.sharpness < np.inf:
            raise HandtrackError(
                f"metaballs: sharpness {self.sharpness:g} per metre; expected a positive number such as "
                f"{SHARPNESS_PER_M:g}."
            )
        check_shape(self.linked, (len(self.ellipsoids), len(self.ellipsoids)), "linked ellipsoids")

    @classmethod
    def of(
        cls,
        model: ArticulatedModel,
        sharpness: float = SHARPNESS_PER_M,
        form: str = "d3",
        ellipsoid_set: str = "metaballs",
    ) -> MetaballSurface:
        """Return a model's surface. sharpness: β [1/m] of a hand of scale 1; larger hands are as round as small ones."""
        check_name("set of ellipsoids", ellipsoid_set, model.ellipsoids, f"the model {model.name}")
        ellipsoids = model.ellipsoids[ellipsoid_set]
        linked = linked_ellipsoids(model.skeleton, ellipsoids)
        return cls(ellipsoids, linked, sharpness / model.scale.overall, form)

    @property
    def turning_level(self) -> float:
        """The level k below which the distance to an ellipsoid is (k − 1) r_min."""
        return FORMS[self.form]

    @cached_property
    def links(self) -> tuple[Ints[K], Ints[L]]:
        """Return (start (E + 1,), members): who sums with e, itself first, is members[start[e] : start[e + 1]]."""
        members = [
            [e, *(int(i) for i in np.flatnonzero(row) if i != e)]
            for e, row in enumerate(self.linked)
        ]
        start = np.cumsum([0, *map(len, members)])
        return start.astype(np.int64), np.array([i for row in members for i in row], np.int64)

    def posed(
        self, bones: BonePoses
    ) -> tuple[Floats[E, D16], Ints[E], Ints[K], Ints[L], float, float]:
        """Return the surface at these poses, for compiled code: a table as metaballs_kernels.py says, each ellipsoid's bone, `links`,
        sharpness and `turning_level`.
        """
        ellipsoids = self.ellipsoids.rescaled(bones).arrays
        table = np.empty((len(ellipsoids[0]), 16))
        pose_table(bones.frames, ellipsoids, table)
        return table, ellipsoids[0], *self.links, self.sharpness, self.turning_level

    def near(
        self, bones: BonePoses, points: Floats[N, D3]
    ) -> tuple[Floats[N], Ints[N], Floats[N, D3]]:
        """Return signed distance [m], closest ellipsoid and the distance's gradient, about unit length near the surface, at points world [m];
        NaN at NaN.
        """
        return self._merged(bones, points, True)

    def distance(self, bones: BonePoses, points: Floats[N, D3]) -> Floats[N]:
        """Return the signed distance [m] of points world, negative inside."""
        return self._merged(bones, points, False)[0]

    def _merged(
        self, bones: BonePoses, points: Floats[N, D3], want_gradient: bool
    ) -> tuple[Floats[N], Ints[N], Floats[N, D3]]:
        points = np.ascontiguousarray(points, dtype=float)
        check_shape(points, (None, 3), "points")
        distance, closest = np.empty(len(points)), np.empty(len(points), np.int64)
        gradient = np.empty(points.shape if want_gradient else (0, 3))
        merged_distance(points, self.posed(bones), want_gradient, distance, closest, gradient)
        return distance, closest, gradient

    def projected(self, bones: BonePoses, points: Floats[N, D3], steps: int = 6) -> Floats[N, D3]:
        """Return points moved along the gradient onto the surface d = 0 (Newton's steps, some millimetres)."""
        points = np.array(points, dtype=float)
        for _ in range(steps):
            distance, _, gradient = self.near(bones, points)
            size = np.maximum((gradient**2).sum(axis=1), 0.05)
            points -= (distance / size)[:, None] * gradient
        return points


def linked_ellipsoids(skeleton: Skeleton, ellipsoids: Ellipsoids) -> Array[E, E]:
    """Return True where two ellipsoids share a bone, or one's bone is the next with flesh above the other's; bones that do not move
    against each other are one.

    So the palm is linked with the first bone of each finger, and fingers are not linked with each other.
    """
    carrier = np.arange(skeleton.bone_count)
    for b in range(1, len(carrier)):
        if b not in skeleton.hinge_bone:
            carrier[b] = carrier[skeleton.parent[b]]
    bone = carrier[ellipsoids.bone]
    above = np.full(len(carrier), -1)
    for b in set(bone.tolist()):
        parent = b
        while parent >= 0 and (parent == b or parent not in bone):
            parent = int(carrier[skeleton.parent[parent]]) if parent else -1
        above[b] = parent
    over = above[bone][:, None] == bone[None, :]
    return (bone[:, None] == bone[None, :]) | over | over.T


# ---- Triangle mesh of the merged metaball surface, and of a model's parts


MOST_NODES = 16_000_000
"""of the grid; finer ones are refused"""


@lru_cache(maxsize=8)
def relaxed_mesh(model: ArticulatedModel, sharpness: float, form: str) -> PartMesh:
    """Return the mesh of the relaxed hand or body, meshed once: bones carry its parts rigidly,
    creases neglected.

    Parameters
    ----------
    sharpness, form
        Of the metaball surface, see there.
    """
    surface = MetaballSurface.of(model, sharpness, form)
    return surface_mesh(surface, model.bones(model.rest_params()))


def surface_mesh(surface: MetaballSurface, bones: BonePoses, spacing_m: float = 0.004) -> PartMesh:
    """Return the marching-cubes mesh (2004 paper, section 5.1) of d = 0 at a pose, on a grid of `spacing_m`. Outlines of parts that lie
    in each other are one surface, except where fingers touch.

    Vertices are then moved onto the surface itself, so that the grid's linear interpolation leaves no trace.
    """
    low, shape = _grid(surface, bones, spacing_m)
    axes = [low[i] + spacing_m * np.arange(shape[i]) for i in range(3)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    field = surface.distance(bones, nodes).reshape(shape)
    corners, faces = marching_cubes(field)
    vertices = spacing_m * corners + low
    moved = surface.projected(bones, vertices, steps=2)
    stay = (np.abs(moved - vertices) > spacing_m).any(axis=1)  # beside a jump of d
    moved[stay] = vertices[stay]
    _, closest, gradient = surface.near(bones, moved)
    normals = gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-12)
    bone = surface.ellipsoids.bone[closest]
    local, normal = (
        np.einsum("vji,vj->vi", bones.rotation[bone], one)
        for one in (moved - bones.position[bone], normals)
    )
    return PartMesh(bone, local, normal, faces)


def sample_surface(
    surface: MetaballSurface,
    bones: BonePoses,
    count: int,
    rng: np.random.Generator,
) -> tuple[Floats[N, D3], Floats[N, D3]]:
    """Return points (count, 3) spread evenly over the surface, world [m], and its unit normals there (count, 3)."""
    mesh = surface_mesh(surface, bones)
    corners = mesh.carried(bones)[0][mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=1)
    face = rng.choice(len(area), size=count, p=area / area.sum())
    a, b = rng.random((2, count, 1))
    flip = a + b > 1
    a, b = np.where(flip, 1 - a, a), np.where(flip, 1 - b, b)
    p, q, r = (corners[face, i] for i in range(3))
    points = surface.projected(bones, p + a * (q - p) + b * (r - p))
    gradient = surface.near(bones, points)[2]
    return points, gradient / np.linalg.norm(gradient, axis=1, keepdims=True)


def _grid(
    surface: MetaballSurface, bones: BonePoses, spacing_m: float
) -> tuple[Floats, tuple[int, int, int]]:
    """Return the first node (3,) and the nodes along each axis of a grid that holds the whole surface."""
    if not spacing_m > 0:
        raise HandtrackError(
            f"surface mesh: grid spacing {spacing_m:g} m; expected a positive length."
        )
    ellipsoids = surface.ellipsoids.posed(bones)
    half = np.sqrt(((ellipsoids.rotation * ellipsoids.radii[:, None, :]) ** 2).sum(axis=2))
    margin = np.log(max(len(ellipsoids.bone), 2)) / surface.sharpness + 2.0 * spacing_m
    low = (ellipsoids.centre - half).min(axis=0) - margin
    high = (ellipsoids.centre + half).max(axis=0) + margin
    size = np.ceil((high - low) / spacing_m) + 1.0
    if not np.prod(size) <= MOST_NODES:
        raise HandtrackError(
            f"surface mesh: a grid spacing of {1e3 * spacing_m:g} mm needs {np.prod(size):.3g} nodes; at most "
            f"{MOST_NODES} are used. Choose a coarser one."
        )
    return low, (int(size[0]), int(size[1]), int(size[2]))


def model_mesh(model: ArticulatedModel) -> PartMesh:
    """Return the parts of a model: a body's superquadrics, or the ellipsoids that silhouettes are fitted with."""
    if model.superquadrics is not None:
        return model.superquadrics.mesh()
    return ellipsoid_mesh(model.ellipsoids["fine"])


# ---- Marching cubes: the triangles of a field's zero level on a grid (Lorensen and Cline, SIGGRAPH 1987)


_CORNERS = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)])


def marching_cubes(field: Floats[*Axes]) -> tuple[Floats[V, D3], Ints[F, D3]]:
    """Return vertices in grid coordinates, and triangles counter-clockwise seen from the positive side.

    Parameters
    ----------
    field
        Values (X, Y, Z) at the nodes; those below zero are inside.

    Notes
    -----
    Cells agree on the faces that they share, so the mesh is closed except at the grid's border, and each edge has as many
    triangles on its one side as on its other.
    """
    inside = field < 0
    cells = tuple(n - 1 for n in field.shape)
    case = np.zeros(cells, np.uint8)
    for k, (x, y, z) in enumerate(_CORNERS):
        case |= inside[x : x + cells[0], y : y + cells[1], z : z + cells[2]].astype(np.uint8) << k
    number = np.zeros((3, *field.shape), np.int64)  # of the vertex from a node along each axis
    vertices: list[np.ndarray] = []
    count = 0
    for axis in range(3):
        before, after = (
            np.moveaxis(field, axis, 0)[part] for part in (slice(None, -1), slice(1, None))
        )
        at = np.nonzero((before < 0) != (after < 0))
        low, high = before[at], after[at]
        nodes = np.stack(at, axis=1)
        nodes = np.insert(nodes[:, 1:], axis, nodes[:, 0], axis=1)
        number[axis][tuple(nodes.T)] = count + np.arange(len(nodes))
        places = nodes.astype(float)
        places[:, axis] += low / (low - high)
        vertices.append(places)
        count += len(nodes)
    axes, corners = _triangles()
    active = np.stack(np.nonzero((case > 0) & (case < 255)), axis=1)
    kinds = case[tuple(active.T)]
    row, triangle = np.nonzero(axes[kinds, :, 0] >= 0)
    chosen = kinds[row], triangle
    nodes = active[row][:, None] + _CORNERS[corners[chosen]]
    faces = number[axes[chosen], nodes[..., 0], nodes[..., 1], nodes[..., 2]]
    return np.concatenate(vertices), faces


@lru_cache(maxsize=1)
def _triangles() -> tuple[np.ndarray, np.ndarray]:
    """Return for each of the 256 cases its triangles' edges: their axes (256, T, 3), -1 where there are fewer, and the corners
    that they begin at.

    On every face, a way round it enters and leaves each run of corners inside, and the surface joins both places; so corners
    that touch at a diagonal alone are separated, from both sides of the face. The joints of the six faces make closed loops.
    """
    table: list[list[list[int]]] = []
    for case in range(256):
        follows: dict[int, int] = {}
        for axis, side in np.ndindex(3, 2):
            a, b, c = 1 << axis, 1 << (axis + 1) % 3, 1 << (axis + 2) % 3
            ring = [side * a + corner for corner in (0, b, b + c, c)][:: 2 * side - 1]
            steps = list(zip(ring, ring[1:] + ring[:1]))
            entered = [s for s in steps if not case >> s[0] & 1 and case >> s[1] & 1]
            for start in entered:
                ahead = steps[steps.index(start) + 1 :] + steps[: steps.index(start)]
                leave = next(s for s in ahead if not case >> s[1] & 1)
                follows[_edge(*start)] = _edge(*leave)
        triangles: list[list[int]] = []
        while follows:
            loop = [next(iter(follows))]
            while (after := follows.pop(loop[-1])) != loop[0]:
                loop.append(after)
            triangles += [[loop[0], *loop[i : i + 2]] for i in range(1, len(loop) - 1)]
        table.append(triangles)
    most = max(map(len, table))
    edges = np.array([case + [[-1] * 3] * (most - len(case)) for case in table])
    return np.where(edges < 0, -1, edges // 8), np.where(edges < 0, 0, edges % 8)


def _edge(first: int, second: int) -> int:
    """Return 8 times the axis of a cube's edge, and the corner that it begins at."""
    return 8 * ((first ^ second).bit_length() - 1) + min(first, second)
