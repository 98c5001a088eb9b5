"""Small closed meshes that the scene is made of: solids turned around +y."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D2, D3, Floats, Ints, N, T, V


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed mesh, its faces counter-clockwise as seen from outside."""

    vertices: Floats[V, D3]
    faces: Ints[T, D3]


def turned(profile: Floats[N, D2], sides: int) -> Solid:
    """Return the solid whose outline is (distance from the axis, y), from below to above; its ends are on the axis."""
    around = 2 * np.pi * np.arange(sides) / sides
    circle = np.stack([np.cos(around), np.zeros(sides), -np.sin(around)], axis=1)
    rings = [radius * circle + [0.0, y, 0.0] for radius, y in profile[1:-1].tolist()]
    low, high = ([0.0, float(y), 0.0] for y in profile[[0, -1], 1])
    here, there = np.arange(sides), np.roll(np.arange(sides), -1)
    top = len(rings) * sides + 1
    faces = [np.stack([np.zeros(sides, int), there + 1, here + 1], axis=1)]
    for first in range(1, top - sides, sides):
        above = first + sides
        faces.append(np.stack([here + first, there + first, there + above], axis=1))
        faces.append(np.stack([here + first, there + above, here + above], axis=1))
    faces.append(np.stack([here + top - sides, there + top - sides, np.full(sides, top)], axis=1))
    return Solid(np.vstack([[low], *rings, [high]]), np.concatenate(faces))


def ball(rings: int, sides: int) -> Solid:
    """Return a sphere of radius 1."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, rings + 1)
    return turned(np.stack([np.cos(angle), np.sin(angle)], axis=1), sides)


def rod(sides: int) -> Solid:
    """Return a cylinder of radius 1 from y = 0 to 1. Its caps have corners of their own, so that its rim is sharp."""
    return turned(np.array([[0, 0], [1, 0], [1, 0], [1, 1], [1, 1], [0, 1]], float), sides)


def capsule(radius: float, cap: float, rings: int, sides: int) -> Solid:
    """Return a rod from y = 0 to 1 that ends in half spheroids, which are `cap` high."""
    angle = np.linspace(0, np.pi / 2, rings + 1)
    low = np.stack([radius * np.sin(angle), cap * (1 - np.cos(angle))], axis=1)
    return turned(np.vstack([low, low[::-1] * [1, -1] + [0, 1]]), sides)
