"""Benchmark: poses that are 10° a joint and 10 mm off before masks of three cameras: a first pose tracked from, a frame refined with others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import F, Floats, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import load_model
from handtrack.observation.observation import Observation
from handtrack.simulation.motion import motion
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.descent import stage_problem
from handtrack.tracking.frame.doubt.judgement import Judgement
from handtrack.tracking.frame.frame_result import posed_result
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.sequence import refine_recording
from handtrack.tracking.tracker import Tracker
from tests.experiments.tracked_frames import joint_error_mm, tracked

CAMERAS, FRAMES, OFF_FRAME, SEEDS = 3, 7, 3, 200
OFF_RAD, OFF_M, RIGHT_MM = np.deg2rad(10.0), 0.010, 5.0
_OF_MOTION = 50
"""frames of the whole motion, a piece of which is looked at"""


def off_runs(seed: int, size: tuple[int, int] = (640, 480)) -> tuple[float, float]:
    """Return mean joint errors [mm] of a first pose that was off, once tracked, and of one frame of seven that was off, once all were refined.

    The hand is the model's own; every angle and turn is off by a normal 10°, the place by 10 mm in some direction, within the limits.
    """
    rng, model = np.random.default_rng(seed), load_model()
    first = int(rng.integers(_OF_MOTION - FRAMES))
    joint = motion(model, "gestures", _OF_MOTION, rng)[first : first + FRAMES]
    poses = np.array([model.transform.solver_params(x) for x in joint])
    cameras = simulated_rig(CAMERAS, size).cameras
    seen = [
        replace(mask_views(model, pose, cameras, frame), time_s=frame / 25.0)
        for frame, pose in enumerate(poses)
    ]
    start = _off(model, poses[0], rng)
    alone = tracked(model, {}, seen[:1], start)
    refined = _refined(model, poses, seen, _off(model, poses[OFF_FRAME], rng))
    found = alone[0], refined[OFF_FRAME]
    truth = poses[0], poses[OFF_FRAME]
    first_mm, frame_mm = (
        joint_error_mm(model, model.transform.solver_params(result.parameters), pose)
        for result, pose in zip(found, truth, strict=True)
    )
    return first_mm, frame_mm


def _refined(
    model: ArticulatedModel, poses: Floats[F, P], seen: Sequence[Observation], off: Floats[P]
) -> list[FrameResult]:
    """Return frames refined together, that were tracked from the first's true pose; one of them stands at a pose that is off."""
    live, tracker = tracked(model, {}, seen, poses[0]), Tracker(model, TrackerSettings())
    terms = frame_terms(model, tracker.settings, seen[OFF_FRAME], model.bones(off), None)
    cost = stage_problem(model, terms, terms.stages - 1, off).cost(off)
    wrong = replace(
        posed_result(model, seen[OFF_FRAME], off, Judgement(Status.TRACKED)), energy=cost
    )
    live[OFF_FRAME] = replace(wrong, views=terms.views)
    return refine_recording(tracker, lambda frame, *_: seen[frame], live)


def _off(model: ArticulatedModel, pose: Floats[P], rng: np.random.Generator) -> Floats[P]:
    aside = rng.normal(size=3)
    step = rng.normal(scale=OFF_RAD, size=len(pose))
    step[:3] = OFF_M * aside / np.linalg.norm(aside)
    return model.clipped(pose + step)


def off_pose(seeds: int = SEEDS) -> dict[str, float | str]:
    """Return the shares of seeds that are right again, and what the others are off by."""
    first, frame = np.array([off_runs(seed) for seed in range(seeds)]).T
    figures: dict[str, float | str] = {
        "bar": f"≥ 95 % of {seeds} seeds within {RIGHT_MM:g} mm, mean of the joints"
    }
    for name, off in (("first_pose", first), ("frame", frame)):
        figures |= {
            f"{name}_right": float((off <= RIGHT_MM).mean()),
            f"{name}_median_mm": float(np.median(off)),
            f"{name}_p95_mm": float(np.quantile(off, 0.95)),
            f"{name}_worst_mm": float(off.max()),
        }
    return figures
