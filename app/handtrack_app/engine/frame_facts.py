"""What is said of a frame: why it is doubtful or lost, and how far it is from the truth."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import Floats
from handtrack.tracking.fallback import is_simplified
from handtrack.tracking.frame.result import FrameResult


def told(result: FrameResult) -> str:
    """Return why a frame is doubtful or lost; saved results keep no more than that the fingers were held."""
    if is_simplified(result):
        return f"Fingers held. {result.note[:1].upper()}{result.note[1:]}".rstrip(". ") + "."
    return result.note[:1].upper() + result.note[1:]


def mean_error_mm(found: Floats | None, truth: Floats | None) -> float:
    """Return the mean distance of keypoints [mm]; NaN where there is nothing to compare."""
    if found is None or truth is None or found.shape != truth.shape:
        return float("nan")
    distance = np.linalg.norm(found - truth, axis=1)
    return float(np.nanmean(distance) * 1e3) if np.isfinite(distance).any() else float("nan")
