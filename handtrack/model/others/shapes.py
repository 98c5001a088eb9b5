"""Boxes, cylinders, capsules and meshes as the ellipsoids that stand for them: of equal volume, meshes of equal inertia."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from handtrack.arrays import D3, Floats
from handtrack.model.others.tree import Shape

_BOX = (6.0 / np.pi) ** (1.0 / 3.0)
"""radius over half an edge: 4/3 π abc = 8 hx hy hz"""


def sphere(radius: float) -> Floats[D3]:
    """Return the radii of a sphere [m]."""
    return np.full(3, radius)


def box(size: Floats[D3]) -> Floats[D3]:
    """Return the radii for a box of full edges [m]."""
    return _BOX * np.asarray(size, float) / 2.0


def cylinder(radius: float, length: float) -> Floats[D3]:
    """Return the radii for a cylinder along z [m]: π r² l = 4/3 π r² a."""
    return np.array([radius, radius, 0.75 * length])


def capsule(radius: float, length: float) -> Floats[D3]:
    """Return the radii for a cylinder along z with half spheres on both ends [m]; length without them."""
    return np.array([radius, radius, radius + 0.75 * length])


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
