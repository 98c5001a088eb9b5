"""Whether a solved frame is to be trusted, and why not, in words."""

from __future__ import annotations

import numpy as np

from handtrack.model.kinematics import BonePoses
from handtrack.terms.outline_overlap import outline_overlap
from handtrack.tracker.frame_terms import FrameTerms
from handtrack.tracker.result import Status


def assess(terms: FrameTerms, bones: BonePoses) -> tuple[Status, str]:
    """Return a frame's status and, unless it is tracked, the reason."""
    if not terms.prepared:
        return Status.DOUBTFUL, "no silhouette was seen; only given keypoints hold the pose"
    limits = terms.settings.tracker
    share = outline_overlap(terms.prepared, terms.model.flesh["fine"], bones).iou
    worst = int(np.argmin(share))
    reason = (
        f"model and silhouette overlap by {100 * share[worst]:.0f} % in {terms.prepared[worst].camera.name}"
    )
    if np.median(share) < limits.lost_overlap:
        return Status.LOST, reason
    if share[worst] < limits.doubtful_overlap:
        return Status.DOUBTFUL, reason
    return Status.TRACKED, ""
