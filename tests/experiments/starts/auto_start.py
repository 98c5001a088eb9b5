"""Benchmark: how many first frames the automatic start finds, how fast and how surely.

Needs the shared test data (HANDTRACK_DATA).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from handtrack import Session, TrackingRun
from handtrack.bench.measuring import recording
from handtrack.session.first_pose.first_pose_search import find_first_poses
from tests.experiments.tracked_frames import mean_mm

FRAMES: dict[str, Sequence[int]] = {
    "webxr_open_close_3cam": (0, 9, 18, 27, 45, 54, 63, 72, 81, 99),
    "webxr_fist_6cam": (0, 2, 4, 6, 8, 69, 72, 75, 77, 79),
    "webxr_stereo_768": tuple(range(0, 60, 6)),
    "webxr_depth_640": tuple(range(0, 80, 8)),
    "webxr_exact_depth_768": tuple(range(0, 60, 6)),
}
"""with an open or half-open hand: in the first two sessions the fingers' joints bend by 45° at most on average"""
BASIN_MM = 12.0


@dataclass(frozen=True)
class Start:
    """One frame's search."""

    error_mm: float
    """mean over the 21 joints"""
    seconds: float
    """of processor time, one thread"""
    confidence: float


def searched(session: Session, frames: Sequence[int]) -> list[Start]:
    """Return how the search went in frames of a session with truth; the hand's size is the adults' mean."""
    run = TrackingRun.open(session, use_init=False)
    find_first_poses(run, frames[0])  # compiles
    return [search(run, frame) for frame in frames]


def search(run: TrackingRun, frame: int) -> Start:
    """Return how the search went in one frame."""
    truth = run.session.truth
    assert truth is not None and truth.keypoints21 is not None
    run.seen(frame)  # what is read and computed of a frame is kept
    begin = time.process_time()
    found = find_first_poses(run, frame)
    seconds = time.process_time() - begin
    if not found:
        return Start(np.inf, seconds, 0.0)
    best = found[0]
    points = best.model.keypoints21(best.model.bones(best.params))
    row = int(np.flatnonzero(truth.frame == frame)[0])
    return Start(mean_mm(points, truth.keypoints21[row]), seconds, best.confidence)


def auto_start() -> dict[str, float | str]:
    """Return for each session the share of frames within 12 mm, the median error, time and confidence."""
    figures: dict[str, float | str] = {
        "bar": "≥ 18 of 20 frames of 3 and 6 cameras within 12 mm, ≤ 5 s each; same for stereo and depth"
    }
    for name, frames in FRAMES.items():
        starts = searched(recording(name), frames)
        errors = np.array([start.error_mm for start in starts])
        figures |= {
            f"{name}_found": f"{int((errors <= BASIN_MM).sum())} of {len(frames)}",
            f"{name}_median_mm": float(np.median(errors)),
            f"{name}_worst_mm": float(errors.max()),
            f"{name}_slowest_s": max(start.seconds for start in starts),
            f"{name}_least_confidence": min(start.confidence for start in starts),
        }
    return figures
