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
from scipy.sparse import coo_matrix, csr_matrix, hstack

from handtrack.arrays import D2, D3, D6, D9, Array, C, Floats, Ints, M, N, V
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


@dataclass(frozen=True)
class Refined:
    """The best state, what is left over, and how sure it is."""

    state: RigState
    residuals: Floats[M, D2]
    """seen − predicted [px]."""
    sigma_px: float
    """robust standard deviation of one coordinate"""
    lens_std: Floats[C, D9]
    """; 0 where held fixed."""
    skew: Floats[C, D2]
    """the skew [px] that would fit next, and its standard deviation."""
    converged: bool


def lens_matrix(lens: Floats[D9]) -> Floats[D3, D3]:
    """Return the camera matrix of numbers in the order of LENS."""
    return np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]])


def residuals(state: RigState, corners: Corners) -> Floats[M, D2]:
    """Return seen − predicted [px]."""
    return corners.pixels - _projected(state, corners)[0]


def refine(
    start: RigState, corners: Corners, free_lens: Array[C, D9], fixed_camera: int
) -> Refined:
    """Return the least-squares state from a start; all cameras but one move, all views move.

    free_lens: bool, which lens numbers are estimated.
    """
    layout = _Layout(start, np.asarray(free_lens, dtype=bool), fixed_camera)
    scale = max(_ROBUST_SIGMAS * _spread(residuals(start, corners)), 0.3)
    state, good = start, False
    for _ in range(2):  # the second time with the scale of what is really left
        state, good = _minimised(state, corners, layout, scale)
        scale = max(_ROBUST_SIGMAS * _spread(residuals(state, corners)), 0.05)
    left = residuals(state, corners)
    lens_std, skews = _uncertainty(state, corners, layout, left, scale)
    return Refined(state, left, _spread(left), lens_std, skews, good)


def _minimised(
    state: RigState, corners: Corners, layout: _Layout, scale: float
) -> tuple[RigState, bool]:
    """Return the state of least robust cost, and whether it was reached in time."""

    squares = _jacobian(state, corners, layout).power(2).sum(axis=0)
    size = np.sqrt(np.maximum(np.ravel(squares), 1e-30))  # makes all unknowns weigh alike

    def cost(scaled: Floats) -> float:
        return _robust_cost(residuals(layout.state(scaled / size), corners), scale) / 2

    @lru_cache(maxsize=1)  # gradient and curvature are asked for at the same place
    def system(scaled: bytes) -> tuple[Floats, Floats]:
        moved = layout.state(np.frombuffer(scaled) / size)
        left = residuals(moved, corners).reshape(-1)
        jacobian = _jacobian(moved, corners, layout).multiply(1 / size)
        weighted = jacobian.multiply(_robust_weight(left, scale)[:, None])
        return -(weighted.T @ left), (weighted.T @ jacobian).toarray()

    start = layout.vector(state) * size
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
    return layout.state(found.x / size), bool(found.success)


def _robust_cost(left: Floats, scale: float) -> float:
    """Return the sum of soft L1 losses: as r² for small residuals, as 2 |r| scale for large ones."""
    cost = float((2 * scale**2 * (np.sqrt(1 + (left / scale) ** 2) - 1)).sum())
    return cost if np.isfinite(cost) else np.inf


def _robust_weight(left: Floats, scale: float) -> Floats:
    return 1 / np.sqrt(1 + (left / scale) ** 2)


def _spread(left: Floats) -> float:
    """Return a standard deviation that a few outliers do not change."""
    return float(1.4826 * np.median(np.abs(left)))


class _Layout:
    """Where each estimated number stands in the solver's vector."""

    def __init__(self, start: RigState, free_lens: Array, fixed_camera: int) -> None:
        self._start = start
        free_camera = np.ones_like(start.camera, dtype=bool)
        free_camera[fixed_camera] = False
        self._free = np.concatenate(
            [free_lens.ravel(), free_camera.ravel(), np.ones(start.view.size, dtype=bool)]
        )
        self.column = np.where(self._free, np.cumsum(self._free) - 1, -1)
        """of every number of the state, −1 where it is held fixed"""
        self.count = int(self._free.sum())

    def vector(self, state: RigState) -> Floats:
        return _flat(state)[self._free]

    def state(self, vector: Floats) -> RigState:
        whole = _flat(self._start)
        whole[self._free] = vector
        return self.unflatten(whole)

    def unflatten(self, whole: Floats) -> RigState:
        lens, camera, view = self._start.lens, self._start.camera, self._start.view
        first, second = lens.size, lens.size + camera.size
        return RigState(
            whole[:first].reshape(lens.shape),
            whole[first:second].reshape(camera.shape),
            whole[second:].reshape(view.shape),
        )


def _flat(state: RigState) -> Floats:
    return np.concatenate([state.lens.ravel(), state.camera.ravel(), state.view.ravel()])


def _projected(state: RigState, corners: Corners) -> tuple[Floats, Floats, Floats]:
    """Return pixels, their 15 derivatives by camera and lens as OpenCV orders them, and corners turned into the world's axes."""
    turn_view = rotation_matrix(state.view[:, :3])[corners.view]
    turned = np.einsum("mij,mj->mi", turn_view, corners.board)
    world = turned + state.view[corners.view, 3:]
    pixels, slopes = np.empty((len(world), 2)), np.empty((len(world), 2, 15))
    for camera in np.unique(corners.camera):
        mine, lens = corners.camera == camera, state.lens[camera]
        turn, shift = np.split(state.camera[camera], 2)
        there, by = cv2.projectPoints(world[mine], turn, shift, lens_matrix(lens), lens[4:])
        pixels[mine], slopes[mine] = there[:, 0], by.reshape(-1, 2, 15)
    return pixels, slopes, turned


def _jacobian(state: RigState, corners: Corners, layout: _Layout) -> csr_matrix:
    """Return d predicted pixel / d vector, (2M, count) sparse."""
    _, slopes, turned = _projected(state, corners)
    by_pose, by_lens = slopes[..., :6], slopes[..., 6:]
    by_world = by_pose[..., 3:] @ rotation_matrix(state.camera[:, :3])[corners.camera]
    # a rotation vector r + δ turns by J δ more: d(R X)/dδ = −[R X] J
    by_view = -by_world @ skew(turned) @ left_jacobian(state.view[:, :3])[corners.view]
    blocks = np.concatenate([by_lens, by_pose, by_view, by_world], axis=2)
    count = len(corners.camera)
    lens_size, camera_size = state.lens.size, state.camera.size
    numbers = np.concatenate(
        [
            9 * corners.camera[:, None] + np.arange(9),
            lens_size + 6 * corners.camera[:, None] + np.arange(6),
            lens_size + camera_size + 6 * corners.view[:, None] + np.arange(6),
        ],
        axis=1,
    )
    columns = np.broadcast_to(layout.column[numbers][:, None, :], blocks.shape)
    rows = np.broadcast_to(np.arange(2 * count).reshape(count, 2, 1), blocks.shape)
    kept = columns >= 0
    entries = (blocks[kept], (rows[kept], columns[kept]))
    return csr_matrix(coo_matrix(entries, shape=(2 * count, layout.count)))


def _uncertainty(
    state: RigState, corners: Corners, layout: _Layout, left: Floats, scale: float
) -> tuple[Floats, Floats]:
    """Return the standard deviations of lenses, and the skews that would fit next.

    Skew s adds s · y' to u; its column is put beside the others for one Gauss-Newton step.
    """
    lens = state.lens[corners.camera]
    down = (_projected(state, corners)[0][:, 1:] - lens[:, 3:4]) / lens[:, 1:2]
    cameras = len(state.lens)
    mine = corners.camera[:, None] == np.arange(cameras)
    skew_columns = np.stack([mine * down, np.zeros((len(down), cameras))], axis=1)
    skew_columns = skew_columns.reshape(-1, cameras)
    whole = csr_matrix(hstack([_jacobian(state, corners, layout), csr_matrix(skew_columns)]))
    weight = _robust_weight(left.reshape(-1), scale)
    weighted = whole.multiply(weight[:, None])
    normal = (weighted.T @ whole).toarray()
    right = weighted.T @ left.reshape(-1)
    n = layout.count
    diagonal = np.sqrt(np.maximum(np.diag(normal), 1e-30))
    scaled = normal / np.outer(diagonal, diagonal)
    inverse = np.linalg.pinv(scaled[:n, :n], rcond=1e-13, hermitian=True)
    variance = np.zeros(len(layout.column))
    spread = _spread(left) ** 2
    variance[layout.column >= 0] = spread * np.diag(inverse) / diagonal[:n] ** 2
    std = layout.unflatten(np.sqrt(np.maximum(variance, 0)))
    # with skew freed: the Schur complement keeps the other numbers free to give way
    coupling = scaled[:n, n:]
    own = scaled[n:, n:] - coupling.T @ inverse @ coupling
    own_inverse = np.linalg.pinv(own, rcond=1e-10, hermitian=True)
    step = own_inverse @ (
        right[n:] / diagonal[n:] - coupling.T @ inverse @ (right[:n] / diagonal[:n])
    )
    skews = np.stack([step, np.sqrt(np.maximum(spread * np.diag(own_inverse), 0))], -1)
    return std.lens, skews / diagonal[n:, None]
