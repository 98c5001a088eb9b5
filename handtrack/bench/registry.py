"""The table of benchmarks: name → module, function, and whether it is quick."""

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
        "handtrack.bench.silhouettes.silhouette_speed", "silhouette_iteration_vs_blas"
    ),
    "field_recovery": Benchmark(
        "handtrack.bench.silhouettes.field_recovery", "field_recovery", quick=False
    ),
    "binary_fist": Benchmark("handtrack.bench.silhouettes.binary_fist", "binary_fist", quick=False),
    "cloud_iteration_vs_blas": Benchmark(
        "handtrack.bench.clouds.cloud_speed", "cloud_iteration_vs_blas"
    ),
    "cloud_solve_vs_scipy": Benchmark("handtrack.bench.clouds.cloud_speed", "cloud_solve_vs_scipy"),
    "finger_shift": Benchmark("handtrack.bench.clouds.finger_shift", "finger_shift", quick=False),
    "poor_clouds": Benchmark("handtrack.bench.clouds.poor_clouds", "poor_clouds", quick=False),
    "freedoms": Benchmark("handtrack.bench.clouds.freedoms", "freedoms", quick=False),
    "combined": Benchmark("handtrack.bench.clouds.combined", "combined", quick=False),
    "forearms": Benchmark("handtrack.bench.silhouettes.forearms", "forearms", quick=False),
    "jump_tree_1024": Benchmark("handtrack.bench.jumps.jump_tree", "jump_tree_1024"),
    "jump_polish_1024": Benchmark("handtrack.bench.jumps.jump_polish", "jump_polish_1024"),
    "jumps": Benchmark("handtrack.bench.jumps.minima", "jumps", quick=False),
    "auto_start": Benchmark("handtrack.bench.starts.auto_start", "auto_start", quick=False),
    "start_confidence": Benchmark(
        "handtrack.bench.starts.start_confidence", "start_confidence", quick=False
    ),
    "recovery": Benchmark("handtrack.bench.starts.recovery", "recovery", quick=False),
    "sr305": Benchmark("handtrack.bench.clouds.sr305", "sr305", quick=False),
    "body_retarget": Benchmark("handtrack.bench.jumps.body_retarget", "body_retarget", quick=False),
    "hand_size": Benchmark("handtrack.bench.clouds.hand_size", "hand_size", quick=False),
    "hand_size_clouds": Benchmark(
        "handtrack.bench.clouds.hand_size", "hand_size_clouds", quick=False
    ),
    "dance_appearance": Benchmark(
        "handtrack.bench.jumps.dance_appearance", "dance_appearance", quick=False
    ),
    "monocular_dance": Benchmark(
        "handtrack.bench.jumps.monocular_dance", "monocular_dance", quick=False
    ),
    "balancing": Benchmark("handtrack.bench.silhouettes.balancing", "balancing", quick=False),
}
