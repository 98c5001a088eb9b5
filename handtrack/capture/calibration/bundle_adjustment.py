"""Joint refinement of cameras and board poses: least squares over all corners of all views.

x_camera = R_c (R_v X + t_v) + t_c, then OpenCV's lens with k1 k2 p1 p2 k3 and its derivatives; each row has 21 entries. A robust loss keeps single wrong corners from bending the rig.

SciPy's trust region on the Gauss-Newton normal equations: at most some thousand unknowns. Its `least_squares` takes
twelve to twenty times as long for a rig of three cameras, and has not settled after 100 steps where cameras are chained:
focal length, depth and distortion trade against one another closely.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from scipy.optimize import minimize
from scipy.sparse import csc_matrix, csr_matrix, hstack

from handtrack.arrays import D2, D3, D6, D9, Array, C, Floats, Ints, M, N, V
from handtrack.geometry.camera import camera_matrix
from handtrack.geometry.rotation import left_jacobian, rotation_matrix, skew

LENS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
_STEPS = 100
_ROBUST_SIGMAS = 3.0  # corners farther off than this many standard deviations count less and less


@dataclass(frozen=True)
class Corners:
    """M corners seen: which camera, which view, where on the board, where in the image."""

    camera: Ints[N]
    view: Ints[N]
    board: Floats[M, D3]
    """[m]"""
    pixels: Floats[M, D2]


@dataclass(frozen=True)
class RigState:
    """All that is estimated; rotation vectors and translations [rad, m]."""

    lens: Floats[C, D9]
    """in the order of LENS."""
    camera: Floats[C, D6]
    """world → camera."""
    view: Floats[V, D6]
    """board → world."""


def residuals(state: RigState, corners: Corners) -> Floats[M, D2]:
    """Return seen − predicted [px]."""
    return corners.pixels - _projected(state, corners)[0]


def refine(start: RigState, corners: Corners, free_lens: Array[C, D9]) -> tuple[RigState, bool]:
    """Return the least-squares state from a start, and whether it was reached in time; all cameras but the first move, all views move.

    Parameters
    ----------
    free_lens
        bool, which lens numbers are estimated.
    """
    free = _free(start, free_lens)
    scale = max(_ROBUST_SIGMAS * spread(residuals(start, corners)), 0.3)
    state, good = start, False
    for _ in range(2):  # the second time with the scale of what is really left
        state, good = _minimised(state, corners, free, scale)
        scale = _scale(residuals(state, corners))
    return state, good


def _free(state: RigState, free_lens: Array[C, D9]) -> Array[N]:
    """Return which of all numbers are estimated."""
    free_camera = np.arange(len(state.camera)) > 0
    return np.concatenate(
        [np.ravel(free_lens), np.repeat(free_camera, 6), np.ones(state.view.size, bool)]
    )


def _minimised(
    state: RigState, corners: Corners, free: Array[N], scale: float
) -> tuple[RigState, bool]:
    """Return the state of least robust cost, and whether it was reached in time."""

    squares = _jacobian(state, corners, free).power(2).sum(axis=0)
    size = np.sqrt(np.maximum(np.ravel(squares), 1e-30))  # makes all unknowns weigh alike

    def cost(scaled: Floats) -> float:
        value, _ = _soft_l1(residuals(_moved(state, free, scaled / size), corners), scale)
        return value / 2

    @lru_cache(maxsize=1)  # gradient and curvature are asked for at the same place
    def system(scaled: bytes) -> tuple[Floats, Floats]:
        moved = _moved(state, free, np.frombuffer(scaled) / size)
        left = residuals(moved, corners).reshape(-1)
        jacobian = _jacobian(moved, corners, free).multiply(1 / size)
        weighted = jacobian.multiply(_soft_l1(left, scale)[1][:, None])
        return -(weighted.T @ left), (weighted.T @ jacobian).toarray()

    start = _numbers(state)[free] * size
    length = np.sqrt(cost(start)) + 1e-9  # no gradient is much longer than the residuals are
    radii = {"initial_trust_radius": 1e3 * length, "max_trust_radius": 1e9 * length}
    found = minimize(
        cost,
        start,
        jac=lambda scaled: system(scaled.tobytes())[0],
        hess=lambda scaled: system(scaled.tobytes())[1],
        method="trust-exact",
        options={"gtol": 1e-6 * length, "maxiter": _STEPS, **radii},
    )
    return _moved(state, free, found.x / size), bool(found.success)


def _soft_l1(left: Floats, scale: float) -> tuple[float, Floats]:
    """Return the sum of soft L1 losses, as r² for small residuals, as 2 |r| scale for large ones; and the residuals' weights."""
    root = np.sqrt(1 + (left / scale) ** 2)
    cost = float((2 * scale**2 * (root - 1)).sum())
    return cost if np.isfinite(cost) else np.inf, 1 / root


def _scale(left: Floats) -> float:
    """Return from where on residuals count less and less [px]."""
    return max(_ROBUST_SIGMAS * spread(left), 0.05)


def spread(left: Floats) -> float:
    """Return a standard deviation, of one coordinate [px], that a few outliers do not change."""
    return float(1.4826 * np.median(np.abs(left)))


def _numbers(state: RigState) -> Floats[N]:
    return np.concatenate([state.lens.ravel(), state.camera.ravel(), state.view.ravel()])


def _moved(start: RigState, free: Array[N], values: Floats[M]) -> RigState:
    """Return the state in which numbers that are free have other values."""
    numbers = _numbers(start)
    numbers[free] = values
    return _state(numbers, len(start.lens))


def _state(numbers: Array[N], cameras: int) -> RigState:
    lens, camera, view = np.split(numbers, [9 * cameras, 15 * cameras])
    return RigState(lens.reshape(-1, 9), camera.reshape(-1, 6), view.reshape(-1, 6))


def _projected(state: RigState, corners: Corners) -> tuple[Floats, Floats, Floats]:
    """Return pixels, their 15 derivatives by camera and lens as OpenCV orders them, and corners turned into the world's axes."""
    turn_view = rotation_matrix(state.view[:, :3])[corners.view]
    turned = np.einsum("mij,mj->mi", turn_view, corners.board)
    world = turned + state.view[corners.view, 3:]
    pixels, slopes = np.empty((len(world), 2)), np.empty((len(world), 2, 15))
    for camera in np.unique(corners.camera):
        mine, lens = corners.camera == camera, state.lens[camera]
        turn, shift = np.split(state.camera[camera], 2)
        there, by = cv2.projectPoints(world[mine], turn, shift, camera_matrix(*lens[:4]), lens[4:])
        pixels[mine], slopes[mine] = there[:, 0], by.reshape(-1, 2, 15)
    return pixels, slopes, turned


def _jacobian(state: RigState, corners: Corners, free: Array[N]) -> csr_matrix:
    """Return d predicted pixel / d free numbers, (2M, count) sparse."""
    _, slopes, turned = _projected(state, corners)
    by_pose, by_lens = slopes[..., :6], slopes[..., 6:]
    by_world = by_pose[..., 3:] @ rotation_matrix(state.camera[:, :3])[corners.camera]
    # a rotation vector r + δ turns by J δ more: d(R X)/dδ = −[R X] J
    by_view = -by_world @ skew(turned) @ left_jacobian(state.view[:, :3])[corners.view]
    blocks = np.concatenate([by_lens, by_pose, by_view, by_world], axis=2)
    count = len(corners.camera)
    at = _state(np.arange(len(free)), len(state.lens))
    numbers = np.hstack([at.lens[corners.camera], at.camera[corners.camera], at.view[corners.view]])
    columns = np.broadcast_to(numbers[:, None, :], blocks.shape)
    rows = np.broadcast_to(np.arange(2 * count).reshape(count, 2, 1), blocks.shape)
    entries = (blocks.ravel(), (rows.ravel(), columns.ravel()))
    return csc_matrix(entries, shape=(2 * count, len(free)))[:, free].tocsr()


def lens_uncertainty(
    state: RigState, corners: Corners, free_lens: Array[C, D9]
) -> tuple[Floats[C, D9], Floats[C, D2]]:
    """Return the standard deviations of a refined state's lenses, 0 where held fixed; and the skew [px] of each that would fit
    next, with its standard deviation.

    Skew s adds s · y' to u; its column is put beside the others for one Gauss-Newton step.
    """
    free, left = _free(state, free_lens), residuals(state, corners)
    lens = state.lens[corners.camera]
    down = (_projected(state, corners)[0][:, 1:] - lens[:, 3:4]) / lens[:, 1:2]
    skewed = down * (corners.camera[:, None] == np.arange(len(state.lens)))
    skew_columns = np.stack([skewed, np.zeros_like(skewed)], axis=1).reshape(-1, len(state.lens))
    whole = csr_matrix(hstack([_jacobian(state, corners, free), csr_matrix(skew_columns)]))
    weighted = whole.multiply(_soft_l1(left.reshape(-1), _scale(left))[1][:, None])
    normal = (weighted.T @ whole).toarray()
    diagonal = np.sqrt(np.maximum(np.diag(normal), 1e-30))
    scaled = normal / np.outer(diagonal, diagonal)
    n = int(free.sum())
    inverse = np.linalg.pinv(scaled[:n, :n], rcond=1e-13, hermitian=True)
    deviation = np.zeros(len(free))
    deviation[free] = spread(left) * np.sqrt(np.maximum(np.diag(inverse), 0)) / diagonal[:n]
    # with skew freed, the other numbers give way
    inverse = np.linalg.pinv(scaled, rcond=1e-13, hermitian=True)
    step = inverse[n:] @ (weighted.T @ left.reshape(-1) / diagonal)
    skew_std = spread(left) * np.sqrt(np.maximum(np.diag(inverse)[n:], 0))
    skews = np.stack([step, skew_std], -1) / diagonal[n:, None]
    return _state(deviation, len(state.lens)).lens, skews
