"""Benchmark: time of one Gauss-Newton iteration on silhouettes, beside BLAS on the dense Jacobian."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np

from handtrack.arrays import Floats
from handtrack.bench.measuring import alone, alternating_medians
from handtrack.model.model_file import load_model
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.solver.problem import Problem
from handtrack.terms.silhouettes.coverage import CoverageTerm
from handtrack.terms.silhouettes.outline_overlap import outline_overlap
from handtrack.terms.silhouettes.prepared_silhouette import prepare


def silhouette_iteration_vs_blas() -> dict[str, Any]:
    """Return ratio, ours_ms, reference_ms and what the reference is."""
    return alone("handtrack.bench.silhouettes.silhouette_speed")


def measure(rounds: int = 60) -> dict[str, Any]:
    """Return the benchmark's figures, measured in this process; call with one BLAS thread."""
    model = load_model()
    truth = model.rest_params()
    truth[1] -= 0.09  # the hand's middle to the world's origin, where the cameras look
    silhouettes = mask_views(model, truth, simulated_rig(3, (640, 480), 0.4).cameras).silhouettes
    off = np.random.default_rng(1).normal(size=len(truth))
    off *= np.where(np.arange(len(off)) < 3, 0.005, np.deg2rad(5.0))  # [m], [rad]
    params = model.clipped(truth + off)
    prepared = [prepare(s) for s in silhouettes]
    flesh, bones = model.flesh["fine"], model.bones(params)
    # the widest band of the schedule is the slowest: spans are longest and overlap most
    problem = Problem(model, [CoverageTerm(prepared, flesh, 6.0, bones)])
    rows = int(outline_overlap(prepared, flesh, bones).model.sum())
    width = len(params)
    rng = np.random.default_rng(0)
    residual, layouts = rng.normal(size=rows), [rng.normal(size=(rows, width))]
    layouts.append(np.asfortranarray(layouts[0]))

    def blas(jacobian: Floats) -> Callable[[], Any]:
        return lambda: (jacobian.T @ jacobian, jacobian.T @ residual)

    ours, *reference = alternating_medians(
        [lambda: problem.linearize(params), *(blas(j) for j in layouts)], rounds
    )
    best = min(reference)
    return {
        "ratio": ours / best,
        "ours_ms": ours,
        "reference_ms": best,
        "reference": (
            f"BLAS float64 JᵀJ and Jᵀr of a formed {rows} × {width} Jacobian (the pixels that the model covers), the "
            "quicker of two memory layouts; ours: kinematics, conics, derivatives, sums and assembly, "
            f"{len(prepared)} cameras {silhouettes[0].camera.size[0]} × {silhouettes[0].camera.size[1]}, "
            f"{len(flesh)} ellipsoids, widest band"
        ),
    }


if __name__ == "__main__":
    print(json.dumps(measure()))
