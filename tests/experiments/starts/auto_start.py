"""Benchmark: how many first frames the automatic start finds, how fast and how surely.

Needs the shared test data (HANDTRACK_DATA).
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence

import numpy as np

from handtrack import Session, TrackingRun
from handtrack.bench.measuring import recording
from handtrack.session.first_pose_search import find_first_poses
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


def searched(session: Session, frames: Sequence[int]) -> Iterator[tuple[float, float, float]]:
    """Yield each frame's error over the 21 joints [mm], processor time of one thread [s], and confidence; the hand's size is the adults' mean."""
    run, truth = TrackingRun.open(session, use_init=False), session.truth
    assert truth is not None and truth.keypoints21 is not None
    find_first_poses(run, frames[0])  # compiles
    for frame in frames:
        run.observed(frame)  # what is read and computed of a frame is kept
        begin = time.process_time()
        found = find_first_poses(run, frame)
        seconds = time.process_time() - begin
        if not found:
            yield np.inf, seconds, 0.0
            continue
        best = found[0]
        points = best.model.keypoints21(best.model.bones(best.params))
        row = int(np.flatnonzero(truth.frame == frame)[0])
        yield mean_mm(points, truth.keypoints21[row]), seconds, best.confidence


def auto_start() -> dict[str, float | str]:
    """Return for each session the share of frames within 12 mm, the median error, time and confidence."""
    figures: dict[str, float | str] = {
        "bar": "≥ 18 of 20 frames of 3 and 6 cameras within 12 mm, ≤ 5 s each; same for stereo and depth"
    }
    for name, frames in FRAMES.items():
        errors, seconds, confidences = np.array(list(searched(recording(name), frames))).T
        figures |= {
            f"{name}_found": f"{int((errors <= BASIN_MM).sum())} of {len(frames)}",
            f"{name}_median_mm": np.median(errors),
            f"{name}_worst_mm": errors.max(),
            f"{name}_slowest_s": seconds.max(),
            f"{name}_least_confidence": confidences.min(),
        }
    return figures
