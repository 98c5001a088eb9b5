"""Compiled projection of points, and what a bone's motion does to their image."""

from __future__ import annotations

from typing import NamedTuple

from handtrack.arrays import D3, Floats
from handtrack.compiled import inlined
from handtrack.terms.bone_kernels import fill_arm


class Pinhole(NamedTuple):
    """A camera without distortion."""

    matrix: Floats[D3, D3]
    rotation: Floats[D3, D3]
    translation: Floats[D3]


NEAREST = 1e-3  # [m] in front of the camera


@inlined
def see(point, camera, seen):  # pragma: no cover - compiled
    """Fill the point (3,) in the camera's frame."""
    turn, shift = camera.rotation, camera.translation
    for r in range(3):
        seen[r] = shift[r] + turn[r, 0] * point[0] + turn[r, 1] * point[1] + turn[r, 2] * point[2]


@inlined
def fill_row(du, dv, seen, camera, point, reference, width, row):  # pragma: no cover - compiled
    """Fill the row (6,), or (12,) by fields, of a residual that changes by du and dv per pixel across and down."""
    matrix, turn = camera.matrix, camera.rotation
    x, y, z = seen[0], seen[1], seen[2]
    fu, fv = du * matrix[0, 0] / z, dv * matrix[1, 1] / z
    fz = -(fu * x + fv * y) / z
    for r in range(3):
        row[r] = fu * turn[0, r] + fv * turn[1, r] + fz * turn[2, r]
    ax, ay, az = point[0] - reference[0], point[1] - reference[1], point[2] - reference[2]
    fill_arm(row, 0, width, ax, ay, az)
