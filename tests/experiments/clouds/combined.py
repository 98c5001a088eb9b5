"""Benchmark: joint error from silhouettes, cloud and keypoints, alone and together, on recordings of another hand.

The recordings are those of the contracts' test data (HANDTRACK_DATA). Keypoints are simulated: the true joints with noise.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from handtrack import Keypoints, Observation, TrackingRun, evaluate
from handtrack.bench.measuring import recording
from handtrack.model.articulated import keypoint_names
from handtrack.session.formats.truth import Truth
from handtrack.tracking.sequence import track_frames

RUNS = ("webxr_stereo_768", "webxr_exact_depth_768", "webxr_depth_640")
KINDS = ("silhouettes", "cloud", "keypoints")
SIGMA_M = 0.008
"""noise of the simulated keypoints, each coordinate: the tracker's `keypoints.sigma_mm`"""
FRAMES = 20


def combined(frames: int = FRAMES) -> dict[str, float | int | str]:
    """Return mpjpe_mm of each recording and each set of what is looked at."""
    figures: dict[str, float | int | str] = {"frames": frames, "keypoint_noise_mm": 1e3 * SIGMA_M}
    for name in RUNS:
        for used, error in compared(name, frames):
            figures[f"{name}_{'+'.join(used)}_mm"] = error
    return figures


def compared(name: str, frames: int) -> Iterator[tuple[tuple[str, ...], float]]:
    """Yield what is looked at and the mean joint error [mm] of one of RUNS, all with one first pose and one hand size."""
    run = TrackingRun.open(recording(name), {"model.fit_size": False})
    truth = run.session.truth
    assert truth is not None
    first, start = run.initial()
    rng = np.random.default_rng(0)
    seen = [_with_keypoints(run.session.observation(f), truth, rng) for f in range(frames)]
    known = [kind for kind in KINDS if any(_has(each, kind) for each in seen)]
    for count in range(1, len(known) + 1):
        for used in combinations(known, count):
            views = [_only(each, used) for each in seen]
            found = track_frames(run.tracker, lambda f, *_: views[f], first, start, range(frames))  # noqa: B023
            rows = truth.frame < frames
            assert truth.keypoints21 is not None
            part = replace(
                truth,
                frame=truth.frame[rows],
                keypoints21=truth.keypoints21[rows],
                joint_positions=None,
            )
            yield used, float(evaluate(run.result(found), part)["mpjpe_mm"] or np.nan)


def _with_keypoints(seen: Observation, truth: Truth, rng: np.random.Generator) -> Observation:
    row = int(np.flatnonzero(truth.frame == seen.frame)[0])
    assert truth.keypoints21 is not None
    points = truth.keypoints21[row] + SIGMA_M * rng.normal(size=(21, 3))
    return replace(seen, keypoints=(Keypoints(keypoint_names(), points, SIGMA_M),))


def _has(seen: Observation, kind: str) -> bool:
    return seen.cloud is not None if kind == "cloud" else bool(getattr(seen, kind))


def _only(seen: Observation, used: tuple[str, ...]) -> Observation:
    """Return what is looked at of a frame, and nothing else."""
    return replace(
        seen,
        silhouettes=seen.silhouettes if "silhouettes" in used else (),
        keypoints=seen.keypoints if "keypoints" in used else (),
        cloud=seen.cloud if "cloud" in used else None,
    )
