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


RigState = Floats[N]
"""all that is estimated, see `parts`"""


def parts(state: RigState, corners: Corners) -> tuple[Floats[C, D9], Floats[C, D6], Floats[V, D6]]:
    """Return views of a state: lenses in the order of LENS; then rotation vectors and translations [rad, m] of cameras, from the
    world, and of views, from the board to the world.
    """
    cameras = 1 + int(corners.camera.max())
    lens, camera, view = np.split(state, [9 * cameras, 15 * cameras])
    return lens.reshape(-1, 9), camera.reshape(-1, 6), view.reshape(-1, 6)


def residuals(state: RigState, corners: Corners) -> Floats[M, D2]:
    """Return seen − predicted [px]."""
    return corners.pixels - _projected(state, corners)[0]


def free_numbers(state: RigState, corners: Corners, free_lens: Array[C, D9]) -> Array[N]:
    """Return which numbers of a state are estimated: of lenses those given, of cameras all but the first one's, of views all."""
    free = np.ones(len(state), bool)
    lens, camera, _ = parts(free, corners)
    lens[:], camera[0] = free_lens, False
    return free


def refine(start: RigState, corners: Corners, free: Array[N]) -> tuple[RigState, bool]:
    """Return the least-squares state from a start, and whether it was reached in time.

    Parameters
    ----------
    free
        bool, which numbers are estimated.
    """
    scale = max(_ROBUST_SIGMAS * spread(residuals(start, corners)), 0.3)
    state, good = start, False
    for _ in range(2):  # the second time with the scale of what is really left
        state, good = _minimised(state, corners, free, scale)
        scale = _scale(residuals(state, corners))
    return state, good


def _minimised(
    state: RigState, corners: Corners, free: Array[N], scale: float
) -> tuple[RigState, bool]:
    """Return the state of least robust cost, and whether it was reached in time."""

    def moved(scaled: Floats) -> RigState:
        numbers = state.copy()
        numbers[free] = scaled / size
        return numbers

    squares = jacobian_of(state, corners, free).power(2).sum(axis=0)
    size = np.sqrt(np.maximum(np.ravel(squares), 1e-30))  # makes all unknowns weigh alike

    def cost(scaled: Floats) -> float:
        value, _ = _soft_l1(residuals(moved(scaled), corners), scale)
        return value / 2

    @lru_cache(maxsize=1)  # gradient and curvature are asked for at the same place
    def system(scaled: bytes) -> tuple[Floats, Floats]:
        here = moved(np.frombuffer(scaled))
        left = residuals(here, corners).reshape(-1)
        jacobian = jacobian_of(here, corners, free).multiply(1 / size)
        weighted = jacobian.multiply(_soft_l1(left, scale)[1][:, None])
        return -(weighted.T @ left), (weighted.T @ jacobian).toarray()

    start = state[free] * size
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
    return moved(found.x), bool(found.success)


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


def _projected(state: RigState, corners: Corners) -> tuple[Floats, Floats, Floats]:
    """Return pixels, their 15 derivatives by camera and lens as OpenCV orders them, and corners turned into the world's axes."""
    lenses, cameras, views = parts(state, corners)
    turn_view = rotation_matrix(views[:, :3])[corners.view]
    turned = np.einsum("mij,mj->mi", turn_view, corners.board)
    world = turned + views[corners.view, 3:]
    pixels, slopes = np.empty((len(world), 2)), np.empty((len(world), 2, 15))
    for camera in np.unique(corners.camera):
        mine, lens = corners.camera == camera, lenses[camera]
        turn, shift = np.split(cameras[camera], 2)
        there, by = cv2.projectPoints(world[mine], turn, shift, camera_matrix(*lens[:4]), lens[4:])
        pixels[mine], slopes[mine] = there[:, 0], by.reshape(-1, 2, 15)
    return pixels, slopes, turned


def jacobian_of(state: RigState, corners: Corners, free: Array[N]) -> csr_matrix:
    """Return d predicted pixel / d free numbers, (2M, count) sparse."""
    _, slopes, turned = _projected(state, corners)
    by_pose, by_lens = slopes[..., :6], slopes[..., 6:]
    _, cameras, views = parts(state, corners)
    by_world = by_pose[..., 3:] @ rotation_matrix(cameras[:, :3])[corners.camera]
    # a rotation vector r + δ turns by J δ more: d(R X)/dδ = −[R X] J
    by_view = -by_world @ skew(turned) @ left_jacobian(views[:, :3])[corners.view]
    blocks = np.concatenate([by_lens, by_pose, by_view, by_world], axis=2)
    count = len(corners.camera)
    whose = corners.camera, corners.camera, corners.view
    places = parts(np.arange(float(len(free))), corners)
    numbers = np.hstack([at[own] for at, own in zip(places, whose, strict=True)]).astype(int)
    columns = np.broadcast_to(numbers[:, None, :], blocks.shape)
    rows = np.broadcast_to(np.arange(2 * count).reshape(count, 2, 1), blocks.shape)
    entries = (blocks.ravel(), (rows.ravel(), columns.ravel()))
    return csc_matrix(entries, shape=(2 * count, len(free)))[:, free].tocsr()


def lens_uncertainty(
    state: RigState, corners: Corners, free: Array[N]
) -> tuple[Floats[C, D9], Floats[C, D2]]:
    """Return the standard deviations of a refined state's lenses, 0 where held fixed; and the skew [px] of each that would fit
    next, with its standard deviation.

    Skew s adds s · y' to u; its column is put beside the others for one Gauss-Newton step.
    """
    left, lenses = residuals(state, corners), parts(state, corners)[0]
    lens, count = lenses[corners.camera], len(lenses)
    down = (_projected(state, corners)[0][:, 1:] - lens[:, 3:4]) / lens[:, 1:2]
    skewed = down * (corners.camera[:, None] == np.arange(count))
    skew_columns = np.stack([skewed, np.zeros_like(skewed)], axis=1).reshape(-1, count)
    whole = csr_matrix(hstack([jacobian_of(state, corners, free), csr_matrix(skew_columns)]))
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
    return parts(deviation, corners)[0], skews
