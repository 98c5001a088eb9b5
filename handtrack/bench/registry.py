"""The table of benchmarks: name → module, function, and whether it is quick."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Benchmark:
    """Where a benchmark's function lives; it returns its figures as a dict."""

    module: str
    function: str
    quick: bool
    """whether `handtrack bench` without a name runs it"""


_QUICK = {
    "silhouette_iteration_vs_blas": "silhouettes.silhouette_speed",
    "lm_iteration_vs_blas": "speed.iterations",
    "ten_iterations_vs_blas": "speed.iterations",
    "frame_vs_blas": "speed.frames",
    "frame_p99_vs_median": "speed.frames",
    "pixels_64x": "speed.iterations",
    "pixels_64x_prepare": "speed.iterations",
    "growth": "speed.growth",
    "cloud_iteration_vs_blas": "clouds.cloud_speed",
    "cloud_solve_vs_scipy": "clouds.cloud_speed",
    "cloud_lm_iteration_vs_blas": "clouds.cloud_speed",
    "jump_tree_1024": "jumps.jump_tree",
    "jump_polish_1024": "jumps.jump_polish",
}
_LONG = {
    "cloud_frame_vs_blas": "speed.frames",
    "two_cores": "speed.frames",
    "as_if_live": "speed.as_if_live",
    "whole_length": "speed.whole_length",
    "first_pose_warm": "speed.first_pose",
    "first_pose_cold": "speed.first_pose",
    "papers": "papers",
    "field_recovery": "silhouettes.field_recovery",
    "binary_fist": "silhouettes.binary_fist",
    "finger_shift": "clouds.finger_shift",
    "poor_clouds": "clouds.poor_clouds",
    "real_stereo": "clouds.real_stereo",
    "freedoms": "clouds.freedoms",
    "combined": "clouds.combined",
    "forearms": "silhouettes.forearms",
    "jumps": "jumps.minima",
    "failing_leaves": "jumps.failing_leaves",
    "three_links": "jumps.three_links",
    "auto_start": "starts.auto_start",
    "start_confidence": "starts.start_confidence",
    "recovery": "starts.recovery",
    "off_pose": "starts.off_pose",
    "detector": "starts.detector",
    "triangulated_landmarks": "starts.triangulated_landmarks",
    "sr305": "clouds.sr305",
    "body_retarget": "jumps.body_retarget",
    "simulated_hands": "honesty.simulated_hands",
    "person_scan": "honesty.person_scan",
    "dance_appearance": "jumps.dance_appearance",
    "monocular_dance": "jumps.monocular_dance",
    "balancing": "silhouettes.balancing",
    "honesty": "honesty.honesty",
    "honesty_bodies": "honesty.bodies",
    "body_offsets": "honesty.body_offsets",
    "four_cameras": "silhouettes.four_cameras",
    "batch": "workbench.batch",
    "hostile": "workbench.hostile",
    "soak": "workbench.soak",
    "pin_latency": "workbench.pin_latency",
    "long_page": "workbench.long_page",
}
"""function → the module below `handtrack.bench`"""

BENCHMARKS = {
    name: Benchmark(f"handtrack.bench.{module}", name, name in _QUICK)
    for name, module in (_QUICK | _LONG).items()
}
