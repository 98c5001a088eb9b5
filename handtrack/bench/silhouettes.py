"""Benchmarks on silhouettes: a relaxed hand before three cameras, one iteration and ten beside BLAS, and how they grow with pixels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from handtrack.arrays import Floats, P, array_dataclass
from handtrack.bench.measuring import (
    alone,
    alternating_medians,
    alternating_timings,
    normal_equations,
    ratio_figures,
)
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import load_model
from handtrack.observation.observation import Silhouette
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import Problem
from handtrack.terms.silhouettes.outline_overlap import outline_overlap
from handtrack.terms.silhouettes.prepared_silhouette import PreparedSilhouette, prepare
from handtrack.terms.silhouettes.silhouette_terms import CoverageTerm, rows_apart

WIDE_PX = 6.0
"""the widest band of the schedule is the slowest: spans are longest and overlap most"""


@array_dataclass
class ThreeViews:
    """Silhouettes of the true pose, and a start about 5 mm and 5° an angle beside it."""

    model: ArticulatedModel
    silhouettes: tuple[Silhouette, ...]
    start: Floats[P]

    @classmethod
    def of(cls, size: tuple[int, int] = (640, 480), cameras: int = 3) -> ThreeViews:
        """Return the scene with images of that width and height; growth is measured with more cameras, too."""
        model = load_model()
        truth = model.rest_params()
        truth[1] -= 0.09  # the hand's middle to the world's origin, where the cameras look
        rig = simulated_rig(cameras, size, 0.4).cameras
        off = np.random.default_rng(1).normal(size=len(truth))
        off *= np.where(np.arange(len(off)) < 3, 0.005, np.deg2rad(5.0))  # [m], [rad]
        seen = tuple(mask_views(model, truth, rig).silhouettes)
        return cls(model, seen, model.clipped(truth + off))

    def prepared(self) -> list[PreparedSilhouette]:
        """Return the silhouettes made ready for a term."""
        return [prepare(silhouette) for silhouette in self.silhouettes]

    def problem(
        self, seen: list[PreparedSilhouette], band_px: float = WIDE_PX, all_rows: bool = False
    ) -> Problem:
        """Return the problem at the start: coverage, no priors, rows as far apart as in tracking unless all are asked for."""
        ellipsoids, bones = self.model.ellipsoids["fine"], self.model.bones(self.start)
        steps = () if all_rows else rows_apart([band_px] * len(seen))
        return Problem(
            self.model, [CoverageTerm(seen, ellipsoids, band_px, bones, row_steps=steps)]
        )

    def rows(self) -> int:
        """Return how many pixels the model covers: the rows of the Jacobian that BLAS is given."""
        ellipsoids, bones = self.model.ellipsoids["fine"], self.model.bones(self.start)
        return int(outline_overlap(self.prepared(), ellipsoids, bones).model.sum())


@alone
def silhouette_iteration_vs_blas() -> dict[str, Any]:
    """Return ratio, ours_ms, reference_ms and what the reference is."""
    scene = ThreeViews.of()
    rows, width = scene.rows(), len(scene.start)
    problem = scene.problem(scene.prepared(), all_rows=True)
    ours, *reference = alternating_medians(
        [lambda: problem.linearize(scene.start), *normal_equations(rows, width)], 60
    )
    best = min(reference)
    camera, ellipsoids = scene.silhouettes[0].camera, scene.model.ellipsoids["fine"]
    return {
        "ratio": ours / best,
        "ours_ms": ours,
        "reference_ms": best,
        "reference": (
            f"BLAS float64 JᵀJ and Jᵀr of a formed {rows} × {width} Jacobian (the pixels that the model covers), the "
            "quicker of two memory layouts; ours: kinematics, conics, derivatives, sums and assembly, "
            f"{len(scene.silhouettes)} cameras {camera.size[0]} × {camera.size[1]}, "
            f"{len(ellipsoids)} ellipsoids, widest band"
        ),
    }


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
