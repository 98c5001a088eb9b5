"""Marching cubes: the triangles of a field's zero level on a grid (Lorensen and Cline, SIGGRAPH 1987)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from handtrack.arrays import D3, Axes, F, Floats, Ints, V

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
