"""Ground truth: what a recording really shows, where that is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import D3, D21, F, Floats, Ints, J, K, array_dataclass


@array_dataclass
class Truth:
    """Ground truth of F frames."""

    frame: Ints[F]
    """frame numbers, each once."""
    time_s: Floats[F] | None
    """[s], or None when not given."""
    keypoints21: Floats[F, D21, D3] | None
    """world [m], NaN where a point is not known."""
    joint_names: tuple[str, ...]
    """J names; empty without joint positions."""
    joint_positions: Floats[F, J, D3] | None
    """world [m], NaN where a joint is not known."""
    keypoint_definition: str | None = None
    """whose points they are, as exports say it: `joints`, `mediapipe21`, …; None where the file does not"""

    def points_at(self, frame: int, joint_names: Sequence[str]) -> Floats[K, D3] | None:
        """Return the 21 keypoints of a frame, else the joints of a model with these names, world [m]; None where it has none."""
        points = self.keypoints21
        if points is None and self.joint_names == joint_names:
            points = self.joint_positions
        row = frame - int(self.frame[0]) if len(self.frame) else -1  # where none is left out
        if not (0 <= row < len(self.frame) and self.frame[row] == frame):
            row = next(iter(np.flatnonzero(self.frame == frame)), -1)
        return None if points is None or row < 0 else points[row]


def mean_error_mm(found: Floats[K, D3] | None, true: Floats[K, D3] | None) -> float:
    """Return the mean distance of points [mm]; NaN where there is nothing to compare."""
    if found is None or true is None or found.shape != true.shape:
        return float("nan")
    away = np.linalg.norm(found - true, axis=1)
    return float(np.nanmean(away) * 1e3) if np.isfinite(away).any() else float("nan")
