"""Benchmark: errors of the 2004 paper's distances d1, d2, d3 to an ellipsoid, as a table and a map.

`python -m docs.pictures.ellipsoid_distances map.png`
"""

from __future__ import annotations

import sys

import cv2
import numpy as np

from handtrack.arrays import D3, Array, Floats, H, N, W
from handtrack.model.flesh import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.model.surfaces.metaballs import FORMS, MetaballSurface

SHAPES = {"finger": (0.010, 0.026, 0.010), "palm": (0.038, 0.053, 0.015)}
LEVELS_MM = (-8, -4, -1, 1, 5, 20)


def distance(radii: tuple[float, float, float], form: str, points: Floats[N, D3]) -> Floats[N]:
    """Return one form's distance of points to an ellipsoid around the origin."""
    flesh = Ellipsoids(
        ("e",), np.zeros(1, int), np.zeros((1, 3)), np.eye(3)[None], np.array([radii])
    )
    bones = BonePoses(np.zeros(3), np.eye(3)[None], np.zeros((1, 3)))
    return MetaballSurface(flesh, np.ones((1, 1), bool), form=form).distance(bones, points)


def true_distance(radii: Floats, points: Floats) -> Floats:
    """Return the exact signed distance (N,) of points (N, 3) to an ellipsoid around the origin, axes along x, y, z.

    The closest surface point is q_i = r_i² x_i / (t + r_i²) with Σ (q_i/r_i)² = 1; the largest root t is bracketed and
    bisected. Plain and slow: the reference that d1, d2 and d3 approximate.
    """
    x, square = np.abs(np.asarray(points, dtype=float)), np.asarray(radii, dtype=float) ** 2
    x = np.maximum(x, 1e-12)  # on a symmetry plane the root is a limit
    least = square.min()
    low = np.full(len(x), -least)
    high = np.sqrt((square * x**2).sum(axis=1)) - least
    for _ in range(200):
        middle = 0.5 * (low + high)
        with np.errstate(divide="ignore"):
            outside = (square * x**2 / (middle[:, None] + square) ** 2).sum(axis=1) > 1.0
        low, high = np.where(outside, middle, low), np.where(outside, high, middle)
    closest = square * x / (high[:, None] + square)
    distance = np.linalg.norm(closest - x, axis=1)
    return np.where((x**2 / square).sum(axis=1) < 1.0, -distance, distance)


def error_table(count: int = 40_000) -> list[tuple[str, str, int, float, float]]:
    """Return (shape, form, true distance [mm], mean error [mm], largest error [mm]) over random points."""
    rng, rows = np.random.default_rng(0), []
    for name, radii in SHAPES.items():
        box = np.max(radii) + 0.03
        points = rng.uniform(-box, box, size=(count, 3))
        exact = 1e3 * true_distance(np.array(radii), points)
        for form in FORMS:
            off = 1e3 * distance(radii, form, points) - exact
            for level in LEVELS_MM:
                near = np.abs(exact - level) < 0.5
                if near.sum() > 20:
                    error = np.abs(off[near])
                    rows.append((name, form, level, float(error.mean()), float(error.max())))
    return rows


def error_map(step_m: float = 0.0004, most_mm: float = 10.0) -> Array[H, W, D3]:
    """Return a picture (BGR) of signed errors in the plane of the longest and shortest axis, d1, d2, d3 side by side.

    Red too far, blue too near, full colour at `most_mm`; lines of equal value every 4 mm, the surface thick.
    """
    rows = []
    for radii in SHAPES.values():
        panels = []
        u, v = np.meshgrid(np.arange(-0.08, 0.08, step_m), np.arange(-0.045, 0.045, step_m))
        points = np.stack([np.zeros_like(u), u, v], axis=-1).reshape(-1, 3)
        exact = true_distance(np.array(radii), points).reshape(u.shape)
        for form in FORMS:
            own = distance(radii, form, points).reshape(u.shape)
            share = np.clip(1e3 * (own - exact) / most_mm, -1, 1)[..., None]
            red, blue = np.array([60, 60, 220.0]), np.array([220, 110, 40.0])
            picture = 255 + np.where(share > 0, share * (red - 255), -share * (blue - 255))
            steps = np.floor(1e3 * own / 4.0)
            picture[_edges(steps)] *= 0.7
            picture[cv2.dilate(_edges(own > 0).astype(np.uint8), np.ones((3, 3))) > 0] = 30
            panels.append(np.pad(picture, ((4, 4), (4, 4), (0, 0)), constant_values=255))
        rows.append(np.concatenate(panels, axis=1))
    few = np.round(np.concatenate(rows, axis=0) / 15) * 15  # few colours make a small file
    return few.astype(np.uint8)


def _edges(values: Array) -> Array:
    edge = np.zeros(values.shape, bool)
    edge[:, 1:] |= values[:, 1:] != values[:, :-1]
    edge[1:] |= values[1:] != values[:-1]
    return edge


if __name__ == "__main__":
    for shape, form, level, mean, largest in error_table():
        print(f"{shape:8s} {form} {level:4d} mm: mean {mean:5.2f}, largest {largest:5.2f} mm")
    if len(sys.argv) > 1:
        cv2.imwrite(sys.argv[1], error_map())
