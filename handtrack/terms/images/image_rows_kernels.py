"""Compiled projection of points on bones, and what a bone's twist does to their image."""

from __future__ import annotations

import numba

from handtrack.terms.bone_kernels import fill_arm

NEAREST = 1e-3  # [m] in front of the camera


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def place(b, local, rotation, position, point):  # pragma: no cover - compiled
    """Fill the world point (3,) of a point (3,) of bone b."""
    for r in range(3):
        point[r] = (
            position[b, r]
            + rotation[b, r, 0] * local[0]
            + rotation[b, r, 1] * local[1]
            + rotation[b, r, 2] * local[2]
        )


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def see(point, turn, shift, seen):  # pragma: no cover - compiled
    """Fill the point (3,) in the camera's frame."""
    for r in range(3):
        seen[r] = shift[r] + turn[r, 0] * point[0] + turn[r, 1] * point[1] + turn[r, 2] * point[2]


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def fill_row(du, dv, seen, matrix, turn, point, reference, row):  # pragma: no cover - compiled
    """Fill the row (6,), or (12,) by fields, of a residual that changes by du and dv per pixel across and down."""
    x, y, z = seen[0], seen[1], seen[2]
    fu, fv = du * matrix[0, 0] / z, dv * matrix[1, 1] / z
    fz = -(fu * x + fv * y) / z
    for r in range(3):
        row[r] = fu * turn[0, r] + fv * turn[1, r] + fz * turn[2, r]
    ax, ay, az = point[0] - reference[0], point[1] - reference[1], point[2] - reference[2]
    fill_arm(row, 0, row.shape[0], ax, ay, az)


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def add_row(b, row, pull, stiffness, gradient, hessian):  # pragma: no cover - compiled
    """Add pull · row and stiffness · row rowᵀ to a bone's part of gradient and hessian, as many numbers a bone as the row has."""
    width = row.shape[0]
    at = width * b
    for i in range(width):
        gradient[at + i] += pull * row[i]
        part = stiffness * row[i]
        for j in range(width):
            hessian[at + i, at + j] += part * row[j]
