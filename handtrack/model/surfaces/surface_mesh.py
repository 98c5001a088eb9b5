"""Triangle mesh of the merged metaball surface, and of a model's parts."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from handtrack.arrays import D3, Axes, F, Floats, Ints, N, V
from handtrack.errors import HandtrackError
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.model.surfaces.part_mesh import PartMesh, ellipsoid_mesh

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
