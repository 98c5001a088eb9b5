"""The benchmarks by name."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Benchmark:
    """Where a benchmark's function lives; it returns its figures as a dict."""

    module: str
    function: str
    quick: bool = True
    """whether `handtrack bench` without a name runs it"""


BENCHMARKS = {
    "silhouette_iteration_vs_blas": Benchmark(
        "handtrack.bench.silhouettes", "silhouette_iteration_vs_blas"
    ),
    "field_recovery": Benchmark("handtrack.bench.field_recovery", "field_recovery", quick=False),
    "binary_fist": Benchmark("handtrack.bench.binary_fist", "binary_fist", quick=False),
    "cloud_iteration_vs_blas": Benchmark("handtrack.bench.clouds", "cloud_iteration_vs_blas"),
    "cloud_solve_vs_scipy": Benchmark("handtrack.bench.clouds", "cloud_solve_vs_scipy"),
    "finger_shift": Benchmark("handtrack.bench.finger_shift", "finger_shift", quick=False),
    "poor_clouds": Benchmark("handtrack.bench.poor_clouds", "poor_clouds", quick=False),
    "freedoms": Benchmark("handtrack.bench.freedoms", "freedoms", quick=False),
    "combined": Benchmark("handtrack.bench.combined", "combined", quick=False),
    "forearms": Benchmark("handtrack.bench.forearms", "forearms", quick=False),
    "jump_tree_1024": Benchmark("handtrack.bench.jump_tree", "jump_tree_1024"),
    "jump_polish_1024": Benchmark("handtrack.bench.jump_polish", "jump_polish_1024"),
    "jumps": Benchmark("handtrack.bench.jumps", "jumps", quick=False),
    "auto_start": Benchmark("handtrack.bench.auto_start", "auto_start", quick=False),
    "start_confidence": Benchmark(
        "handtrack.bench.start_confidence", "start_confidence", quick=False
    ),
    "recovery": Benchmark("handtrack.bench.recovery", "recovery", quick=False),
    "sr305": Benchmark("handtrack.bench.sr305", "sr305", quick=False),
    "body_retarget": Benchmark("handtrack.bench.body_retarget", "body_retarget", quick=False),
    "hand_size": Benchmark("handtrack.bench.hand_size", "hand_size", quick=False),
    "hand_size_clouds": Benchmark("handtrack.bench.hand_size", "hand_size_clouds", quick=False),
    "dance_appearance": Benchmark(
        "handtrack.bench.dance_appearance", "dance_appearance", quick=False
    ),
    "monocular_dance": Benchmark("handtrack.bench.monocular_dance", "monocular_dance", quick=False),
    "balancing": Benchmark("handtrack.bench.balancing", "balancing", quick=False),
}
