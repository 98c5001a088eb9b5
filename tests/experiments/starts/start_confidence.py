"""Benchmark: the automatic start's stated confidence beside how often it was right, on simulated frames."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from handtrack import TrackerSettings, load_model
from handtrack.tracking.search.global_search import auto_start
from handtrack.tracking.search.start_confidence import BASIN_M
from tests.experiments.scenes.start_frames import KINDS, start_frame
from tests.experiments.tracked_frames import mean_mm

FRAMES, SEED = 168, 88000
BINS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0)


@dataclass(frozen=True)
class StartTrial:
    """What was said of a frame's best pose, and how far off it was."""

    kind: str
    confidence: float
    error_mm: float
    seconds: float

    @property
    def is_right(self) -> bool:
        return self.error_mm < 1e3 * BASIN_M


def start_trial(number: int, seed: int = SEED) -> StartTrial:
    """Return how the search of one simulated frame went."""
    frame = start_frame(seed, number)
    models = [load_model(forearm=arm) for arm in (False, True)]
    begin = time.process_time()
    found = auto_start(models, TrackerSettings(), frame.seen)
    seconds = time.process_time() - begin
    if not found:
        return StartTrial(frame.kind, 0.0, np.inf, seconds)
    best = found[0]
    error = mean_mm(best.model.keypoints21(best.model.bones(best.params)), frame.joints)
    return StartTrial(frame.kind, best.confidence, error, seconds)


def reliability(rows: Sequence[StartTrial]) -> dict[str, float]:
    """Return for each stretch of confidence how many frames, what was said and what was so; Brier's score."""
    said = np.array([row.confidence for row in rows])
    right = np.array([row.is_right for row in rows], float)
    figures: dict[str, float] = {
        "frames": len(rows),
        "brier": float(np.mean((said - right) ** 2)),
    }
    for low, high in pairwise(BINS):
        here = (said >= low) & ((said < high) | (high == BINS[-1]))
        if here.any():
            name = f"reported_{100 * low:.0f}_{100 * high:.0f}"
            figures[f"{name}_frames"] = int(here.sum())
            figures[f"{name}_mean"] = float(said[here].mean())
            figures[f"{name}_right"] = float(right[here].mean())
    for kind in KINDS:
        here = np.array([row.kind == kind for row in rows])
        if here.any():
            figures[f"{kind}_reported"] = float(said[here].mean())
            figures[f"{kind}_right"] = float(right[here].mean())
    figures["slowest_s"] = max(row.seconds for row in rows)
    return figures


def start_confidence(frames: int = FRAMES) -> dict[str, float]:
    """Return how sure the automatic start was of simulated frames, and how often it was right."""
    return reliability([start_trial(number) for number in range(frames)])
