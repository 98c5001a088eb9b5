"""Benchmark: poses found again from nearby in simulated field images, the 2007 paper's first experiment.

A perfect model sees its own field images, so the true pose costs nothing; what is measured is from how far it is found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import F, Floats, P, S
from handtrack.geometry.camera import Camera
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import load_model
from handtrack.model.pose_library import named_pose
from handtrack.simulation.motion import motion
from handtrack.simulation.simulate import simulated_rig
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import Problem
from handtrack.terms.silhouettes.conic_field import ConicFieldTerm
from tests.experiments.scenes.simulated_fields import field_views
from tests.experiments.tracked_frames import joint_error_mm

START_M, START_RAD = 0.005, np.deg2rad(3.0)
ITERATIONS = 20
CONVERGED_MM = 0.05
"""mean joint error below which a pose counts as found again"""

_POSES = ("rest", "open", "fist", "point", "pinch", "curl", "flat")
_WANDER_M, _TURN_RAD = 0.02, 0.25  # of the hand before the cameras
_SETTINGS = SolverSettings(iterations=ITERATIONS, cost_tolerance=0.0, step_tolerance=1e-9)


@dataclass(frozen=True)
class Recovery:
    """One pose and how it was found again."""

    seed: int
    start_mm: float
    """mean joint error of the start"""
    error_mm: float
    """mean joint error of what was found"""
    iterations: int
    truth: Floats[P]
    start: Floats[P]
    found: Floats[P]


def field_recovery(seeds: int = 200) -> dict[str, float | int | str]:
    """Return the experiment's figures for both scales of the field."""
    model, cameras = load_model(), simulated_rig(2).cameras
    figures: dict[str, float | int | str] = {
        "seeds": seeds,
        "cameras": len(cameras),
        "iterations": ITERATIONS,
        "bar": f"median < {CONVERGED_MM} mm",
    }
    for scale in ("normalised", "paper"):
        rows = [recover(model, cameras, seed, scale == "paper") for seed in range(seeds)]
        start = np.array([row.start_mm for row in rows])
        error = np.array([row.error_mm for row in rows])
        found, near = error < CONVERGED_MM, start <= np.median(start)
        figures |= {
            "start_median_mm": float(np.median(start)),
            f"{scale}_median_mm": float(np.median(error)),
            f"{scale}_p90_mm": float(np.percentile(error, 90)),
            f"{scale}_converged": float(found.mean()),
            f"{scale}_converged_nearer_half": float(found[near].mean()),
            f"{scale}_converged_farther_half": float(found[~near].mean()),
        }
    gesture = motion(model, "open_fist_open", 100, np.random.default_rng(0))
    followed = _followed_mm(model, cameras, gesture)
    figures["gesture_median_mm"] = float(np.median(followed))
    figures["gesture_max_mm"] = max(followed)
    figures["gesture_at_double_speed_max_mm"] = max(_followed_mm(model, cameras, gesture[::2]))
    return figures


def recover(
    model: ArticulatedModel, cameras: Sequence[Camera], seed: int, depth_scaled: bool = False
) -> Recovery:
    """Return how a random pose is found again: no priors, limits on, ConicFieldTerm alone."""
    rng = np.random.default_rng(seed)
    truth = _random_pose(model, rng)
    off = rng.normal(size=len(truth)) * ([START_M] * 3 + [START_RAD] * (len(truth) - 3))
    start = model.clipped(truth + off)
    seen = field_views(model, truth, cameras, depth_scaled)
    term = ConicFieldTerm(seen, model.flesh["fine"], normalised=not depth_scaled)
    end = solve(Problem(model, [term]), start, _SETTINGS)
    start_mm, error_mm = (joint_error_mm(model, x, truth) for x in (start, end.params))
    return Recovery(seed, start_mm, error_mm, end.iterations, truth, start, end.params)


def follow(
    model: ArticulatedModel, cameras: Sequence[Camera], joint_params: Floats[F, S]
) -> Floats[F, S]:
    """Return what is found of a gesture, joint parameters, from field images: ten iterations a frame,
    each from the last frame's estimate, the first from the true pose."""
    settings = SolverSettings(iterations=10)
    params = model.transform.solver_params(joint_params[0])
    found = []
    for joint in joint_params:
        seen = field_views(model, model.transform.solver_params(joint), cameras)
        problem = Problem(model, [ConicFieldTerm(seen, model.flesh["fine"])])
        params = solve(problem, params, settings).params
        found.append(model.joint_params(params))
    return np.stack(found)


def _followed_mm(
    model: ArticulatedModel, cameras: Sequence[Camera], joint_params: Floats
) -> list[float]:
    solver = model.transform.solver_params
    pairs = zip(follow(model, cameras, joint_params), joint_params, strict=True)
    return [joint_error_mm(model, solver(found), solver(true)) for found, true in pairs]


def _random_pose(model: ArticulatedModel, rng: np.random.Generator) -> Floats:
    """Return parameters (P,) somewhere between two poses of the library, turned and moved a little."""
    one, other = rng.choice(_POSES, 2, replace=False)
    share = rng.uniform()
    joint = (1 - share) * named_pose(model, str(one)) + share * named_pose(model, str(other))
    joint[3:6] = rng.normal(scale=_TURN_RAD, size=3)
    joint[:3] = rng.normal(scale=_WANDER_M, size=3)
    joint[1] -= 0.09  # the palm's middle, not the wrist, where the cameras look
    return model.clipped(model.transform.solver_params(joint))
