"""The energy's parts of every frame, in words."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from handtrack.arrays import Floats
from handtrack.tracking.frame.result import FrameResult

TERM_WORDS = {
    "coverage": "silhouettes",
    "conic_field": "silhouettes",
    "cloud_distance": "cloud→model",
    "cloud_emptiness": "model→cloud",
    "cloud_rays": "lines of sight",
    "keypoints": "keypoints",
    "edges": "edges",
    "intensity": "intensity",
    "rest": "priors",
    "posture": "priors",
    "motion": "priors",
    "stabilise": "priors",
    "collision": "priors",
    "proportions": "priors",
    "prior": "priors",
}
"""by the name of a term"""


def energy_parts(results: Mapping[int, FrameResult], frames: range) -> dict[str, Floats]:
    """Return the energy's parts (F,) of frames in words, NaN where a frame has none."""
    parts: dict[str, Floats] = {}
    for frame, result in results.items():
        if frame not in frames:
            continue
        for name, cost in result.energies.items():
            row = parts.setdefault(TERM_WORDS.get(name, name), np.full(len(frames), np.nan))
            i = frame - frames.start
            row[i] = np.nan_to_num(row[i]) + cost
    return parts
