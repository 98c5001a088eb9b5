"""Benchmark: how time, memory and files grow with cameras, points and frames, each beside a smaller number of them."""

from __future__ import annotations

import resource
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from handtrack import Session, TrackerState, TrackingRun, bundled_session
from handtrack.bench.iterations import SIGMA_M, cloud_scene, prepared, views_problem, views_scene
from handtrack.bench.measuring import alone, alternating_timings, ratio_figures
from handtrack.session.takes import about_take
from handtrack.solver.problem import Problem
from handtrack.store.store import Store, WritableStore
from handtrack.terms.clouds import CloudDistanceTerm, prepare_cloud
from tests.experiments.workbench.long_recordings import opened

_FRAMES = (1_000, 20_000)


def growth() -> dict[str, Any]:
    """Return by how much an iteration takes longer with 12 cameras instead of 3, with 100,000 points instead of 10,000, and
    what a stored frame and the workbench cost with 20,000 frames, and before, with 1,000.
    """
    figures = cameras()
    more = points()
    figures |= {"points_10x_ratio": more["ratio"], "points_10x_ms": more["ours_ms"]}
    few, many = (frames(count) for count in _FRAMES)
    for name, value in many.items():
        figures |= {f"frames_20x_{name}": value, f"frames_20x_{name}_ratio": value / few[name]}
    for words, truth in (("", False), ("_with_truth", True)):
        few, many = (opened(count, truth) for count in _FRAMES)
        for name, value in many.items():
            figures[f"workbench{words}_20x_{name}"] = value
            figures[f"workbench{words}_20x_{name}_before"] = few[name]
    return figures


@alone
def cameras(rounds: int = 20) -> dict[str, Any]:
    """Return an iteration's time with 12 cameras, the reference being 3."""
    scenes = [views_scene(cameras=count) for count in (12, 3)]
    problems = [(views_problem(scene, prepared(scene)), scene[2]) for scene in scenes]
    ours, reference = alternating_timings(
        [lambda p=problem, x=start: p.linearize(x) for problem, start in problems], rounds
    )
    return ratio_figures(ours, [reference], "the same with 3 cameras of 640 × 480 instead of 12")


@alone
def points(rounds: int = 20) -> dict[str, Any]:
    """Return an iteration's time with 100,000 points, the reference being 10,000."""
    model, surface, seen, start = cloud_scene(1)
    noise = 1e-3 * np.random.default_rng(2).normal(size=(10, *seen.shape))
    clouds = (seen + noise).reshape(-1, 3), seen
    problems = [
        Problem(model, [CloudDistanceTerm(prepare_cloud(cloud), surface, SIGMA_M)])
        for cloud in clouds
    ]
    ours, reference = alternating_timings(
        [lambda p=problem: p.linearize(start) for problem in problems], rounds
    )
    return ratio_figures(ours, [reference], "the same with 10,000 points")


@alone
def frames(count: int) -> dict[str, float]:
    """Return what a take of so many frames costs to write, to list and to read, and the memory that it takes at most."""
    run = TrackingRun.open(
        Session.open(bundled_session("open_fist_open")), {"model.fit_size": False}
    )
    start, params = run.initial()
    state, _ = run.tracker.step(TrackerState.beginning_at(params), run.observation(start))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        begun = time.process_time()
        with WritableStore(folder, "handtrack bench") as store:
            take = store.begin(about_take(run, "handtrack bench", range(count), start, params))
            for frame in range(count):
                take.add(replace(state.step, result=replace(state.step.result, frame=frame)))
            take.finish()
        written = time.process_time()
        (found,) = Store(folder).takes()
        assert len(found.frames) == count
        listed, size = time.process_time(), found.bytes
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        found.track()
        read = time.process_time()
    return {
        "write_ms_a_frame": 1e3 * (written - begun) / count,
        "list_ms_a_frame": 1e3 * (listed - written) / count,
        "read_ms_a_frame": 1e3 * (read - listed) / count,
        "bytes_a_frame": size / count,
        "memory_mb_to_write_and_list": max((peak - before) / 1024, 0.1),
    }
