"""Benchmarks of one step: on silhouettes and on a point cloud, beside BLAS on the dense Jacobian and beside SciPy; ten of them, and how they grow with pixels."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from handtrack.arrays import D3, Floats, N, P
from handtrack.bench.measuring import (
    alone,
    alternating_medians,
    alternating_timings,
    normal_equations,
    ratio_figures,
)
from handtrack.compiled import compiled_as_numpy
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.metaballs import MetaballSurface, sample_surface
from handtrack.model.metaballs_kernels import ellipsoid_distance, ellipsoid_gradient
from handtrack.model.model_file import load_model
from handtrack.observation.observation import Silhouette
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.limited_step_kernels import bounded_step
from handtrack.solver.problem import Problem
from handtrack.terms.clouds import CloudDistanceTerm, prepare_cloud
from handtrack.terms.silhouettes import (
    CoverageTerm,
    PreparedSilhouette,
    outline_overlap,
    prepare,
    rows_apart,
)

# ---- Silhouettes: a relaxed hand before three cameras


WIDE_PX = 6.0
"""the widest band of the schedule is the slowest: spans are longest and overlap most"""


Views = tuple[ArticulatedModel, Sequence[Silhouette], Floats[P]]
"""a model, silhouettes of its true pose, and a start about 5 mm and 5° an angle beside it"""


def views_scene(size: tuple[int, int] = (640, 480), cameras: int = 3) -> Views:
    """Return a scene with images of that width and height; growth is measured with more cameras, too."""
    model = load_model()
    truth = model.rest_params()
    truth[1] -= 0.09  # the hand's middle to the world's origin, where the cameras look
    rig = simulated_rig(cameras, size, 0.4).cameras
    off = np.random.default_rng(1).normal(size=len(truth))
    off *= np.where(np.arange(len(off)) < 3, 0.005, np.deg2rad(5.0))  # [m], [rad]
    return model, mask_views(model, truth, rig).silhouettes, model.clipped(truth + off)


def prepared(views: Views) -> list[PreparedSilhouette]:
    """Return the silhouettes made ready for a term."""
    return [prepare(silhouette) for silhouette in views[1]]


def views_problem(
    views: Views,
    seen: Sequence[PreparedSilhouette],
    band_px: float = WIDE_PX,
    all_rows: bool = False,
) -> Problem:
    """Return the problem at the start: coverage, no priors, rows as far apart as in tracking unless all are asked for."""
    model, _, start = views
    ellipsoids, steps = (
        model.ellipsoids["fine"],
        () if all_rows else rows_apart([band_px] * len(seen)),
    )
    return Problem(
        model, [CoverageTerm(seen, ellipsoids, band_px, model.bones(start), row_steps=steps)]
    )


def _covered_rows(views: Views) -> int:
    """Return how many pixels the model covers: the rows of the Jacobian that BLAS is given."""
    model, _, start = views
    overlap = outline_overlap(prepared(views), model.ellipsoids["fine"], model.bones(start))
    return int(overlap.model.sum())


@alone
def silhouette_iteration_vs_blas() -> dict[str, Any]:
    """Return ratio, ours_ms, reference_ms and what the reference is."""
    views = model, silhouettes, start = views_scene()
    rows, width = _covered_rows(views), len(start)
    problem = views_problem(views, prepared(views), all_rows=True)
    camera, ellipsoids = silhouettes[0].camera, model.ellipsoids["fine"]
    words = (
        f"{_words(rows, width, _COVERED)}; ours: kinematics, conics, derivatives, sums and assembly, "
        f"{len(silhouettes)} cameras {camera.size[0]} × {camera.size[1]}, {len(ellipsoids)} ellipsoids, widest band"
    )
    return _medians(lambda: problem.linearize(start), rows, width, words)


_ROUNDS = 40
_TEN = SolverSettings(iterations=10, cost_tolerance=0.0, step_tolerance=0.0)
_COVERED = " (the pixels that the model covers)"


def _words(rows: int, width: int, of: str = "") -> str:
    return f"BLAS float64 JᵀJ and Jᵀr of a formed {rows} × {width} Jacobian{of}, the quicker of two layouts"


def _medians(ours: Callable[[], Any], rows: int, width: int, reference: str) -> dict[str, Any]:
    """Return figures by medians."""
    own, *blas = alternating_medians([ours, *normal_equations(rows, width)], 60)
    best = min(blas)
    return {"ratio": own / best, "ours_ms": own, "reference_ms": best, "reference": reference}


def lm_iteration_vs_blas() -> dict[str, Any]:
    """Return the time of a complete iteration: linearisation, bounded step, limits, trials; rows as far apart as in tracking."""
    return _iterations(False)


def ten_iterations_vs_blas() -> dict[str, Any]:
    """Return the time of ten of them, with preparing the masks before."""
    return _iterations(True)


def pixels_64x() -> dict[str, Any]:
    """Return by how much an iteration takes longer with 64 times the pixels."""
    return _size_ratio(False)


def pixels_64x_prepare() -> dict[str, Any]:
    """Return the same of preparing the masks."""
    return _size_ratio(True)


@alone
def _iterations(prepares: bool) -> dict[str, Any]:
    """Return the time of ten iterations with preparing the masks before, or of one without."""
    views = _, _, start = views_scene()
    rows, width = _covered_rows(views), len(start)
    known = views_problem(views, prepared(views))

    def solved() -> int:
        problem = views_problem(views, prepared(views)) if prepares else known
        return solve(problem, start, _TEN).iterations

    count = 1 if prepares else solved()
    return _shares(solved, count, rows, width, _COVERED)


def _shares(
    solved: Callable[[], int], count: int, rows: int, width: int, of: str = ""
) -> dict[str, Any]:
    """Return figures by the least, of one in so many of ours."""
    ours, *blas = alternating_timings([solved, *normal_equations(rows, width)], _ROUNDS)
    return ratio_figures([time / count for time in ours], blas, _words(rows, width, of))


@alone
def _size_ratio(prepares: bool) -> dict[str, Any]:
    """Return the time with images 8 times as wide and high, the reference being that of 320 × 240.

    The band keeps its width in the world, so it is 8 times as many pixels, as in tracking; rows are as far apart as there.
    """
    timed: list[Callable[[], Any]] = []
    for size, band_px in (((320, 240), WIDE_PX / 2), ((2560, 1920), WIDE_PX * 4)):
        views = views_scene(size)
        if prepares:
            timed.append(partial(prepared, views))
        else:
            problem = views_problem(views, prepared(views), band_px)
            timed.append(partial(problem.linearize, views[2]))
    small, large = timed
    ours, reference = alternating_timings([large, small], _ROUNDS // 2)
    return ratio_figures(
        ours, [reference], "the same with 3 × 320 × 240 pixels instead of 2560 × 1920"
    )


# ---- A point cloud


@compiled_as_numpy
def dense_rows(
    points, surface, sigma, reference, twist, want_jacobian
):  # pragma: no cover - compiled
    """Return residual (N,) = d/σ and, if wanted, its derivatives by joint parameters (N, S). twist: (B, 6, S)."""
    table, bone, start, members, sharpness, turning = surface
    residual = np.empty(points.shape[0])
    jacobian = np.empty((points.shape[0] if want_jacobian else 0, twist.shape[2]))
    each, wrench = np.empty(table.shape[0]), np.empty(6)
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        best, least = 0, np.inf
        for e in range(table.shape[0]):
            each[e] = ellipsoid_distance(table, e, turning, x, y, z)
            if each[e] < least:
                best, least = e, each[e]
        total = 0.0
        for n in range(start[best], start[best + 1]):
            total += np.exp(-sharpness * (each[members[n]] - least))
        residual[i] = (least - np.log(total) / sharpness) / sigma
        if not want_jacobian:
            continue
        jacobian[i] = 0.0
        rx, ry, rz = x - reference[0], y - reference[1], z - reference[2]
        for n in range(start[best], start[best + 1]):
            e = members[n]
            share = -np.exp(-sharpness * (each[e] - least)) / (total * sigma)
            if share > -1e-12:
                continue
            _, nx, ny, nz = ellipsoid_gradient(table, e, turning, x, y, z)
            wrench[0], wrench[1], wrench[2] = share * nx, share * ny, share * nz
            wrench[3] = share * (ry * nz - rz * ny)
            wrench[4] = share * (rz * nx - rx * nz)
            wrench[5] = share * (rx * ny - ry * nx)
            for k in range(6):
                for s in range(jacobian.shape[1]):
                    jacobian[i, s] += wrench[k] * twist[bone[e], k, s]
    return residual, jacobian


POINTS, NOISE_M, SIGMA_M = 10_000, 0.0003, 0.0005


CloudScene = tuple[ArticulatedModel, MetaballSurface, Floats[N, D3], Floats[P]]
"""a model, its surface, a cloud of that [m], and a start 10 mm and all angles 5° (standard deviation) off, within limits"""


def cloud_scene(seed: int) -> CloudScene:
    """Return a scene of 10,000 points with 0.3 mm noise at a random pose around the relaxed hand (10° an angle)."""
    rng = np.random.default_rng(seed)
    model = load_model("hand26")
    surface = MetaballSurface.of(model)
    truth = model.rest_params()
    truth[6:] += np.deg2rad(10.0) * rng.normal(size=len(truth) - 6)
    truth = model.clipped(truth)
    points, _ = sample_surface(surface, model.bones(truth), POINTS, rng)
    points = points + NOISE_M * rng.normal(size=points.shape)
    way = rng.normal(size=3)
    start = truth.copy()
    start[:3] += 0.010 * way / np.linalg.norm(way)
    start[3:] += np.deg2rad(5.0) * rng.normal(size=len(truth) - 3)
    return model, surface, points, model.clipped(start)


@alone
def cloud_lm_iteration_vs_blas() -> dict[str, Any]:
    """Return the time of a complete iteration: linearisation, bounded step, limits, accepted trial."""
    model, surface, points, start = cloud_scene(1)
    problem = Problem(model, [CloudDistanceTerm(prepare_cloud(points), surface, SIGMA_M)])

    def solved() -> int:
        return solve(problem, start, _TEN).iterations

    return _shares(solved, solved(), len(points), len(start))


@alone
def cloud_iteration_vs_blas() -> dict[str, Any]:
    """Return ratio, ours_ms, reference_ms and what the reference is."""
    model, surface, points, start = cloud_scene(1)
    problem = Problem(model, [CloudDistanceTerm(prepare_cloud(points), surface, SIGMA_M)])

    def step() -> Floats:
        system = problem.linearize(start)
        return bounded_step(system.hessian, system.gradient, start, problem.limits, 1e-2)[1]

    rows, width = len(points), len(start)
    words = (
        f"{_words(rows, width)}; ours: kinematics, closest ellipsoids, distances, derivatives, sums, pull back and the "
        f"bounded step, {len(surface.ellipsoids)} ellipsoids"
    )
    return _medians(step, rows, width, words)


@alone
def cloud_solve_vs_scipy() -> dict[str, Any]:
    """Return the time to come within 1e-6 of the converged cost, ours and scipy's; start and Jacobian are the same."""
    scene = model, surface, points, start = cloud_scene(1)
    problem = Problem(model, [CloudDistanceTerm(prepare_cloud(points), surface, SIGMA_M)])
    goal = (1.0 + 1e-6) * solve(problem, start, SolverSettings(iterations=100)).cost

    reached: list[int] = []
    solve(
        problem,
        start,
        SolverSettings(iterations=100),
        on_iteration=lambda k, params, cost: reached.append(k) if cost <= goal else None,
    )
    enough = SolverSettings(iterations=reached[0])

    def ours() -> None:
        problem = Problem(model, [CloudDistanceTerm(prepare_cloud(points), surface, SIGMA_M)])
        solve(problem, start, enough)

    low, high = problem.bounds(start).T

    def scipy(method: str) -> float:
        """Return the time to the goal [ms]; infinite where it is not reached."""

        def residual(params: Floats) -> Floats:
            r = _dense(scene, params)[0]
            if 0.5 * float(r @ r) <= goal:
                raise StopIteration  # the cost aimed at is reached
            return r

        limits: dict[str, Any] = {} if method == "lm" else {"bounds": (low - 1e-9, high + 1e-9)}
        begin = time.perf_counter()
        try:
            least_squares(
                residual,
                start,
                lambda params: _dense(scene, params, True)[1],  # type: ignore[arg-type]
                method=method,
                x_scale="jac",
                max_nfev=300,
                ftol=1e-12,
                xtol=1e-12,
                gtol=1e-12,
                **limits,
            )
        except StopIteration:
            return 1e3 * (time.perf_counter() - begin)
        return np.inf

    own = alternating_medians([ours], 5, 1)[0]
    methods = {"lm": "no bounds", "trf": "with the limits as bounds"}
    times = {method: np.median([scipy(method) for _ in range(5)]) for method in methods}
    best = min(times, key=lambda method: times[method])
    reference = float(times[best])
    return {
        "ratio": own / reference,
        "ours_ms": own,
        "reference_ms": reference,
        "reference": (
            f"scipy least_squares ({best}, {methods[best]}) with the same analytic Jacobian, compiled and dense, from "
            f"the same start to the same cost {goal:.6g}; ours with the limits, the cloud's ordering included"
        ),
    }


def _dense(
    scene: CloudScene, params: Floats[P], want_jacobian: bool = False
) -> tuple[Floats[N], Floats[N, P]]:
    """Return E1 as a general solver wants it: residuals and, if wanted, their Jacobian."""
    model, surface, points, _ = scene
    bones, twist, _ = model.linearize(params)
    posed = surface.posed(bones)
    residuals, rows = dense_rows(points, posed, SIGMA_M, bones.reference, twist, want_jacobian)
    return residuals, rows @ model.transform.matrix if want_jacobian else rows
