"""Boxes, cylinders, capsules and meshes as the ellipsoids that stand for them: of equal volume, meshes of equal inertia."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from handtrack.arrays import D3, Floats, K
from handtrack.model.others.tree import Shape

_BOX = (6.0 / np.pi) ** (1.0 / 3.0)
"""radius over half an edge: 4/3 π abc = 8 hx hy hz"""
SIZES = {"sphere": 1, "cylinder": 2, "capsule": 2, "ellipsoid": 3, "box": 3}
"""how many numbers tell how large each is: its radius; its radius and half its length along z, a capsule's without the half
spheres on its ends; half its axes, or edges"""


def radii(kind: str, size: Floats[K]) -> Floats[D3]:
    """Return the radii of the ellipsoid for one of `SIZES` [m]."""
    if SIZES[kind] == 3:
        return size[:3] * (_BOX if kind == "box" else 1.0)
    radius = float(size[0])
    long = 1.5 * float(size[SIZES[kind] - 1])  # π r² 2h = 4/3 π r² a
    along = {"sphere": radius, "cylinder": long, "capsule": radius + long}
    return np.array([radius, radius, along[kind]])


def mesh(path: Path, scale: Floats[D3], place: Floats[D3], turn: Floats[D3, D3]) -> list[Shape]:
    """Return the ellipsoid of the inertia of a mesh's hull; none where the file is not there or not read. place, turn: of the mesh."""
    import trimesh

    if not path.is_file():
        return []
    try:
        hull = trimesh.load(path, force="mesh").convex_hull  # type: ignore[union-attr]
        hull.apply_scale(scale)
        inertia, volume = np.asarray(hull.moment_inertia), float(hull.volume)
    except (ValueError, IndexError, KeyError, NotImplementedError, AttributeError, OSError):
        return []
    if not volume > 0:
        return []
    spread = (0.5 * np.trace(inertia) * np.eye(3) - inertia) / volume  # of the solid's points
    values, axes = np.linalg.eigh(spread)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    centre = place + turn @ np.asarray(hull.center_mass)
    return [Shape(centre, turn @ axes, np.sqrt(5.0 * np.maximum(values, 0.0)))]
