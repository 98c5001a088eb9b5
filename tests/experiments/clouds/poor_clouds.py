"""Benchmark: palm error of each fallback on simulated poor clouds, as in the 2004 paper's first experiment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from handtrack.arrays import F, Floats, S
from handtrack.model.model_file import load_model
from handtrack.observation.observation import Observation
from handtrack.simulation.motion import motion
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.search.initialize import carried_over
from tests.experiments.scenes.simulated_clouds import DIGICLOPS, Sensor, depth_views
from tests.experiments.tracked_frames import tracked

ModeSearch = Mapping[str, tuple[str, dict[str, Any]]]
WAYS: ModeSearch = {
    "hand26": ("hand26", {"model.fallback": "none"}),
    "glove9": ("glove9", {}),
    "ball6": ("ball6", {}),
    "glove9_doubted": ("glove9", {"cloud.doubt_depth": True}),
    "ball6_doubted": ("ball6", {"cloud.doubt_depth": True}),
    "auto": ("hand26", {}),
}
"""model and settings: alone as the paper had them; with doubted depths; and what is done by itself where a cloud is poor"""
PALM = ("wrist", "middle_mcp")
"""the joints that all of the models have"""
BAR_MM = 15.0
FRAMES = 100


def poor_clouds(seeds: int = 2) -> dict[str, float | int | str]:
    """Return the palm's error of each way to track a closing and opening hand: over all frames of all seeds."""
    figures: dict[str, float | int | str] = {
        "seeds": seeds,
        "frames": FRAMES,
        "bar": f"palm within {BAR_MM:g} mm",
    }
    errors: dict[str, list[Floats]] = {way: [] for way in WAYS}
    held: dict[str, list[float]] = {way: [] for way in WAYS}
    for seed in range(seeds):
        truth, seen = scene(seed)
        for way in WAYS:
            results = track(way, truth, seen)
            errors[way].append(palm_mm(way, results, truth))
            held[way].append(float(np.mean([r.poor_cloud for r in results])))
    for way, parts in errors.items():
        every = np.concatenate(parts)
        figures |= {
            f"{way}_median_mm": float(np.median(every)),
            f"{way}_p90_mm": float(np.quantile(every, 0.9)),
            f"{way}_max_mm": float(every.max()),
            f"{way}_within_bar": float((every <= BAR_MM).mean()),
        }
        if way.startswith("auto"):
            figures[f"{way}_poor"] = float(np.mean(held[way]))
    return figures


def scene(
    seed: int, sensor: Sensor = DIGICLOPS, frames: int = FRAMES
) -> tuple[Floats[F, S], list[Observation]]:
    """Return joint parameters (F, 26) of a motion and what the sensor saw of it."""
    rng = np.random.default_rng(seed)
    model = load_model()
    truth = motion(model, "open_fist_open", FRAMES, rng)[:frames]
    return truth, list(depth_views(model, truth, sensor, rng))


def track(
    way: str, truth: Floats[F, S], seen: Sequence[Observation], ways: ModeSearch = WAYS
) -> list[FrameResult]:
    """Return the frames, tracked from the first true pose."""
    name, values = ways[way]
    whole, model = load_model(), load_model(name)
    start = carried_over(whole, whole.transform.solver_params(truth[0]), model)
    return tracked(model, values, seen, start)


def palm_mm(
    way: str, results: Sequence[FrameResult], truth: Floats[F, S], ways: ModeSearch = WAYS
) -> Floats[F]:
    """Return the mean error of wrist and middle knuckle of each frame [mm]."""
    whole, model = load_model(), load_model(ways[way][0])
    theirs = [whole.joint_names.index(name) for name in PALM]
    ours = [model.joint_names.index(name) for name in PALM]
    true = [
        whole.joint_positions(whole.bones(whole.transform.solver_params(t)))[theirs] for t in truth
    ]
    off = [r.joint_positions[ours] - t for r, t in zip(results, true, strict=True)]
    return 1e3 * np.linalg.norm(off, axis=2).mean(axis=1)
