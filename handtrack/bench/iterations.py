"""Benchmarks: whole Levenberg-Marquardt iterations on silhouettes beside BLAS, and how they grow with pixels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from handtrack.bench.measuring import (
    alone,
    alternating_timings,
    normal_equations,
    ratio_figures,
)
from handtrack.bench.three_views import WIDE_PX, ThreeViews
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import Problem

_ROUNDS = 40
_TEN = SolverSettings(iterations=10, cost_tolerance=0.0, step_tolerance=0.0)
_REFERENCE = "BLAS float64 JᵀJ and Jᵀr of a formed {rows} × {width} Jacobian (the pixels that the model covers), the quicker of two layouts"


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
    scene = ThreeViews.of()
    rows, width = scene.rows(), len(scene.start)
    seen = scene.prepared()
    problems = scene.problem(seen), scene.problem(seen, all_rows=True)

    def ten(problem: Problem) -> int:
        return solve(problem, scene.start, _TEN).iterations

    shares = [1, 1]
    chosen: list[Callable[[], int]] = [
        lambda: ten(scene.problem(scene.prepared())),
        lambda: ten(scene.problem(scene.prepared(), all_rows=True)),
    ]
    if not prepares:
        shares = [ten(problem) for problem in problems]
        chosen = [lambda: ten(problems[0]), lambda: ten(problems[1])]
    timings = alternating_timings([*chosen, *normal_equations(rows, width)], _ROUNDS)
    ours, of_all = (
        [time / share for time in times] for times, share in zip(timings, shares, strict=False)
    )
    figures = ratio_figures(ours, timings[2:], _REFERENCE.format(rows=rows, width=width))
    of_all_rows = min(of_all) / figures["reference_ms"]
    return figures | {"ratio_with_all_rows": of_all_rows, "iterations": chosen[0]()}


@alone
def _size_ratio(prepares: bool) -> dict[str, Any]:
    """Return the time with images 8 times as wide and high, the reference being that of 320 × 240.

    The band keeps its width in the world, so it is 8 times as many pixels, as in tracking; rows are as far apart as there.
    """
    few, many = ThreeViews.of((320, 240)), ThreeViews.of((2560, 1920))
    if prepares:
        small, large = few.prepared, many.prepared
    else:
        seen = few.prepared(), many.prepared()
        problems = few.problem(seen[0], WIDE_PX / 2), many.problem(seen[1], WIDE_PX * 4)
        starts = few.start, many.start
        small, large = (
            lambda problem=problem, start=start: problem.linearize(start)
            for problem, start in zip(problems, starts, strict=True)
        )
    ours, reference = alternating_timings([large, small], _ROUNDS // 2)
    return ratio_figures(
        ours, [reference], "the same with 3 × 320 × 240 pixels instead of 2560 × 1920"
    )
