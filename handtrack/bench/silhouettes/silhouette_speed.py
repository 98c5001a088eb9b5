"""Benchmark: time of one Gauss-Newton iteration on silhouettes, beside BLAS on the dense Jacobian."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from handtrack.arrays import Floats
from handtrack.simulation.scenes.silhouette_scene import silhouette_scene
from handtrack.solver.problem import Problem
from handtrack.terms.silhouettes.coverage import CoverageTerm
from handtrack.terms.silhouettes.outline_overlap import outline_overlap
from handtrack.terms.silhouettes.prepared_silhouette import prepare

_ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OPENBLAS", "OMP", "MKL", "VECLIB", "NUMBA")}


def silhouette_iteration_vs_blas() -> dict[str, Any]:
    """Return ratio, ours_ms, reference_ms and what the reference is; in a process of its own with one thread."""
    command = [sys.executable, "-m", "handtrack.bench.silhouettes.silhouette_speed"]
    done = subprocess.run(
        command, env=os.environ | _ONE_THREAD, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


def measure(rounds: int = 60) -> dict[str, Any]:
    """Return the benchmark's figures, measured in this process; call with one BLAS thread."""
    model, silhouettes, params = silhouette_scene()
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


def alternating_medians(
    functions: list[Callable[[], Any]], rounds: int, repeat: int = 5
) -> list[float]:
    """Return each function's median time [ms]; the functions take turns, so that a slow moment meets them all."""
    times: list[list[float]] = [[] for _ in functions]
    for function in functions:
        function()
    for _ in range(rounds):
        for function, kept in zip(functions, times, strict=True):
            for _ in range(repeat):
                start = time.perf_counter()
                function()
                kept.append(time.perf_counter() - start)
    return [1e3 * float(np.median(kept)) for kept in times]


if __name__ == "__main__":
    print(json.dumps(measure()))
