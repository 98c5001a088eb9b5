"""The table of benchmarks: the quick ones are part of the program; the others are experiments of its repository."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from handtrack.errors import HandtrackError, unknown_name

REPOSITORY = Path(__file__).resolve().parents[2]


QUICK = {
    "silhouette_iteration_vs_blas": "iterations",
    "lm_iteration_vs_blas": "iterations",
    "ten_iterations_vs_blas": "iterations",
    "frame_vs_blas": "frames",
    "frame_p99_vs_median": "frames",
    "pixels_64x": "iterations",
    "pixels_64x_prepare": "iterations",
    "cloud_iteration_vs_blas": "iterations",
    "cloud_solve_vs_scipy": "iterations",
    "cloud_lm_iteration_vs_blas": "iterations",
    "jump_tree_1024": "jumps",
    "jump_polish_1024": "jumps",
}
"""those that `handtrack bench` without a name runs, and their modules"""
_LONG = {
    "cloud_frame_vs_blas": "frames",
    "two_cores": "frames",
    "first_pose_warm": "frames",
    "first_pose_cold": "frames",
}
_EXPERIMENTS = {
    "growth": "speed.growth",
    "as_if_live": "speed.as_if_live",
    "whole_length": "speed.whole_length",
    "papers": "papers",
    "freedoms": "clouds.freedoms",
    "capture": "clouds.capture",
    "jumps": "jumps.minima",
    "auto_start": "starts.auto_start",
    "start_confidence": "starts.start_confidence",
    "recovery": "starts.recovery",
    "triangulated_landmarks": "starts.triangulated_landmarks",
    "joints_and_masks": "starts.joints_and_masks",
    "simulated_hands": "honesty.simulated_hands",
    "person_scan": "honesty.person_scan",
    "balancing": "silhouettes.four_cameras",
    "honesty_bodies": "honesty.bodies",
    "four_cameras": "silhouettes.four_cameras",
    "batch": "workbench.batch",
    "hostile": "workbench.hostile",
    "soak": "workbench.soak",
    "pin_latency": "workbench.pin_latency",
}

BENCHMARKS = {
    **{name: f"handtrack.bench.{module}" for name, module in (QUICK | _LONG).items()},
    **{name: f"tests.experiments.{module}" for name, module in _EXPERIMENTS.items()},
}
"""modules, by the functions in them, which return their figures as a dict"""


def benchmark(name: str) -> Callable[[], dict[str, Any]]:
    """Return a benchmark's function.

    Raises
    ------
    HandtrackError
        There is no such benchmark, or it is an experiment and this is an installation without the repository.
    """
    if name not in BENCHMARKS:
        raise unknown_name("benchmark", name, tuple(BENCHMARKS))
    module = BENCHMARKS[name]
    if module.startswith("tests."):
        if not (REPOSITORY / "tests" / "experiments").is_dir():
            raise HandtrackError(
                f"The benchmark '{name}' is an experiment of the project's repository, which is not here: {REPOSITORY} "
                "has no tests/experiments. Clone the repository and run the command from its environment."
            )
        sys.path.insert(0, str(REPOSITORY))
    return getattr(importlib.import_module(module), name)
