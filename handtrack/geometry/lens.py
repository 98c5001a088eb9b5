"""OpenCV's lens distortion with 4, 5, 8, 12 or 14 coefficients, forward and back.

Coefficients are `k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tau_x tau_y]]]]`. Directions are (...,
2), x/z and y/z in the camera frame. A polynomial folds back beyond some radius: directions out
there would land inside the image although the lens never shows them. They give NaN here.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from handtrack.arrays import D2, Axes, Floats, H, K, W

COEFFICIENT_COUNTS = (4, 5, 8, 12, 14)
_NEWTON_STEPS = 30
_CONVERGED = 1e-9  # in normalised units: below a millionth of a pixel


def distort(directions: Floats[*Axes, D2], coefficients: Floats[K]) -> Floats[*Axes, D2]:
    """Return where the lens puts straight directions; NaN beyond the lens's field."""
    directions = np.asarray(directions, dtype=float)
    if not np.any(coefficients):
        return directions.copy()
    full = _all_fourteen(coefficients)
    bent = _apply_homography(_tilt(full), _bend(directions, full))
    radius = np.linalg.norm(directions, axis=-1)
    return np.where((radius <= field_radius(coefficients))[..., None], bent, np.nan)


def undistort(bent: Floats[*Axes, D2], coefficients: Floats[K]) -> Floats[*Axes, D2]:
    """Return the straight directions of distorted ones, by Newton's method; NaN where there is none."""
    bent = np.asarray(bent, dtype=float)
    if not np.any(coefficients):
        return bent.copy()
    full = _all_fourteen(coefficients)
    target = _apply_homography(np.asarray(np.linalg.inv(_tilt(full)), float), bent)
    limit = field_radius(coefficients)
    straight = target.copy()
    for _ in range(_NEWTON_STEPS):
        straight = _pulled_inside(straight, limit)
        error = target - _bend(straight, full)
        if not np.any(np.abs(error) > 1e-15):
            break
        straight = straight + _solve_2x2(_bend_jacobian(straight, full), error)
    error = np.linalg.norm(target - _bend(straight, full), axis=-1)
    good = (error < _CONVERGED) & (np.linalg.norm(straight, axis=-1) <= limit)
    return np.where(good[..., None], straight, np.nan)


def remap_source(places: Floats[H, W, D2]) -> Floats[H, W, D2]:
    """Return places in an image [px] as `cv2.remap` takes them, float32; outside of it where they are NaN."""
    return np.nan_to_num(places, nan=-1e4).astype(np.float32)


def field_radius(coefficients: Floats[K]) -> float:
    """Return the radius |(x/z, y/z)| up to which the radial polynomial still increases; inf if always."""
    return _field_radius(tuple(float(c) for c in coefficients))


@lru_cache(maxsize=256)
def _field_radius(coefficients: tuple[float, ...]) -> float:
    full = _all_fourteen(np.array(coefficients))
    k1, k2, k3 = full[[0, 1, 4]]
    k4, k5, k6 = full[5:8]
    above = np.polynomial.Polynomial([1.0, k1, k2, k3])  # in s = r²
    below = np.polynomial.Polynomial([1.0, k4, k5, k6])
    s = np.polynomial.Polynomial([0.0, 1.0])
    # d/dr (r a(r²)/b(r²)) = 0  ⇔  (a + 2 s a') b = 2 s a b'
    turning = (above + 2 * s * above.deriv()) * below - 2 * s * above * below.deriv()
    ends = [_smallest_positive_root(turning), _smallest_positive_root(below)]
    return float(np.sqrt(min(ends)))


def _smallest_positive_root(polynomial: np.polynomial.Polynomial) -> float:
    roots = polynomial.trim().roots()
    real = roots[np.abs(roots.imag) < 1e-9 * (1 + np.abs(roots))].real
    return float(min(real[real > 0], default=np.inf))


def _all_fourteen(coefficients: Floats) -> Floats:
    full = np.zeros(14)
    full[: len(coefficients)] = coefficients
    return full


def _bend(directions: Floats, full: Floats) -> Floats:
    """Return directions bent by all but the tilt."""
    p1, p2 = full[2:4]
    s1, s2, s3, s4 = full[8:12]
    x, y = directions[..., 0], directions[..., 1]
    s = x * x + y * y
    radial, _ = _radial(s, full)
    bent_x = x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x) + s * (s1 + s * s2)
    bent_y = y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y + s * (s3 + s * s4)
    return np.stack([bent_x, bent_y], axis=-1)


def _bend_jacobian(directions: Floats, full: Floats) -> Floats:
    """Return the derivative (..., 2, 2) of `_bend`."""
    p1, p2 = full[2:4]
    s1, s2, s3, s4 = full[8:12]
    x, y = directions[..., 0], directions[..., 1]
    s = x * x + y * y
    radial, slope = _radial(s, full)
    prism_x, prism_y = s1 + 2 * s * s2, s3 + 2 * s * s4
    both = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    xx = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x + 2 * x * prism_x
    yy = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x + 2 * y * prism_y
    rows = [xx, both + 2 * y * prism_x, both + 2 * x * prism_y, yy]
    return np.stack(rows, axis=-1).reshape(*s.shape, 2, 2)


def _radial(s: Floats, full: Floats) -> tuple[Floats, Floats]:
    """Return the radial factor at s = r² and its derivative by s."""
    k1, k2 = full[:2]
    k3, k4, k5, k6 = full[4:8]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        above = 1 + s * (k1 + s * (k2 + s * k3))
        below = 1 + s * (k4 + s * (k5 + s * k6))
        factor = above / below
        slope_above = k1 + s * (2 * k2 + s * 3 * k3)
        slope_below = k4 + s * (2 * k5 + s * 3 * k6)
        return factor, (slope_above - factor * slope_below) / below


def _tilt(full: Floats) -> Floats:
    """Return the homography (3, 3) of a tilted sensor (Scheimpflug), the identity without tilt."""
    cos_x, sin_x = np.cos(full[12]), np.sin(full[12])
    cos_y, sin_y = np.cos(full[13]), np.sin(full[13])
    about_x = np.array([[1, 0, 0], [0, cos_x, sin_x], [0, -sin_x, cos_x]])
    about_y = np.array([[cos_y, 0, -sin_y], [0, 1, 0], [sin_y, 0, cos_y]])
    turn = about_y @ about_x
    onto_axis = np.array([[turn[2, 2], 0, -turn[0, 2]], [0, turn[2, 2], -turn[1, 2]], [0, 0, 1.0]])
    return onto_axis @ turn


def _apply_homography(homography: Floats, points: Floats) -> Floats:
    mapped = points @ homography[:, :2].T + homography[:, 2]
    return mapped[..., :2] / mapped[..., 2:]


def _solve_2x2(matrix: Floats, right: Floats) -> Floats:
    a, b, c, d = matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 1, 0], matrix[..., 1, 1]
    determinant = a * d - b * c
    safe = np.where(np.abs(determinant) < 1e-12, 1.0, determinant)
    x = (d * right[..., 0] - b * right[..., 1]) / safe
    y = (a * right[..., 1] - c * right[..., 0]) / safe
    step = np.stack([x, y], -1)
    return np.where((np.abs(determinant) < 1e-12)[..., None], 0.0, step)


def _pulled_inside(directions: Floats, limit: float) -> Floats:
    """Return directions with those beyond the lens's field moved back into it, so that Newton
    stays on the branch."""
    if not np.isfinite(limit):
        return directions
    radius = np.linalg.norm(directions, axis=-1, keepdims=True)
    return np.where(
        radius > limit, directions * (0.98 * limit / np.maximum(radius, limit)), directions
    )
