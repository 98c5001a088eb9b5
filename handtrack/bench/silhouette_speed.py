"""Benchmark: time of one Gauss-Newton iteration on silhouettes, beside BLAS on the dense Jacobian."""

from __future__ import annotations

from typing import Any

from handtrack.bench.measuring import alone, alternating_medians, normal_equations
from handtrack.bench.three_views import ThreeViews


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
