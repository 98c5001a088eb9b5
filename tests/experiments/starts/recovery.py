"""Benchmark: how often tracking finds a hand again that ten frames did not show, with and without recovery."""

from __future__ import annotations

import numpy as np

from handtrack import HandScale, Observation, load_model
from handtrack.arrays import Floats, K
from handtrack.model.articulated import FINGERS
from handtrack.simulation.motion import motion
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from tests.experiments.tracked_frames import mean_mm, tracked

SEEN_BEFORE, BLANK, SEEN_AFTER = 8, 10, 6
CAMERAS, BACK_MM = 3, 15.0
_FRAMES = 50  # of the whole motion, a piece of which is looked at
_WANDER = 2.5  # times the usual wandering: about 5 cm and 40°
_SIZE_SIGMA, _PART_SIGMA = 0.04, 0.02  # by how much the filmed hand's size is not the model's


def gap_errors(seed: int) -> tuple[float, dict[bool, Floats[K]]]:
    """Return how far the hand moved in ten frames without any silhouette, and the errors after them, with jumps (True) and without [mm].

    Three cameras; the hand goes through the poses of `gestures` and wanders; its size is not quite the model's.
    """
    rng = np.random.default_rng(seed)
    parts = dict(
        zip(FINGERS, np.exp(_PART_SIGMA * rng.normal(size=len(FINGERS))).tolist(), strict=True)
    )
    filmed = load_model(scale=HandScale(float(np.exp(_SIZE_SIGMA * rng.normal())), parts))
    model = load_model()
    joint = motion(filmed, "gestures", _FRAMES, rng, _WANDER)
    count = SEEN_BEFORE + BLANK + SEEN_AFTER
    first = int(rng.integers(_FRAMES - count + 1))
    poses = [filmed.transform.solver_params(x) for x in joint[first : first + count]]
    rig = simulated_rig(CAMERAS)
    blank = range(SEEN_BEFORE, SEEN_BEFORE + BLANK)

    seen = [
        Observation(i, i / 25.0) if i in blank else mask_views(filmed, pose, rig.cameras, i)
        for i, pose in enumerate(poses)
    ]
    truth = np.stack([filmed.joint_positions(filmed.bones(x)) for x in poses])
    moved = mean_mm(truth[blank.stop], truth[blank.start - 1])
    gaps = {}
    for jumps in (True, False):
        results = tracked(model, {"tracker.recovery": jumps}, seen, poses[0])
        off = np.stack([r.joint_positions for r in results[blank.stop :]]) - truth[blank.stop :]
        gaps[jumps] = 1e3 * np.linalg.norm(off, axis=2).mean(axis=1)
    return moved, gaps


def recovery(seeds: int = 50) -> dict[str, float | str]:
    """Return the share of seeds that are back within 15 mm, at once and six frames after the gap, with jumps and without."""
    figures: dict[str, float | str] = {
        "bar": f"with jumps ≥ 90 % of {seeds} seeds back within {BACK_MM:g} mm"
    }
    runs = [gap_errors(seed) for seed in range(seeds)]
    moved = np.array([far for far, _ in runs])
    for name, jumps in (("with", True), ("without", False)):
        errors = np.array([gaps[jumps] for _, gaps in runs])
        first, last = errors[:, 0], errors[:, -1]
        figures |= {
            f"{name}_back": float(np.mean(last <= BACK_MM)),
            f"{name}_back_at_once": float(np.mean(first <= BACK_MM)),
            f"{name}_median_mm": float(np.median(last)),
            f"{name}_p90_mm": float(np.quantile(last, 0.9)),
            "moved_median_mm": float(np.median(moved)),
            "moved_p90_mm": float(np.quantile(moved, 0.9)),
        }
    return figures
