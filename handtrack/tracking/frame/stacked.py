"""What only some frames have (reasons, probabilities, other poses), stacked into the arrays of a sequence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from handtrack.tracking.frame.reason import Reason

if TYPE_CHECKING:
    from handtrack.tracking.frame.result import FrameResult


def stacked_reasons(frames: Sequence[FrameResult]) -> dict[str, Any]:
    """Return the arrays of reasons; none where no frame has one."""
    reasons = [frame.reason for frame in frames]
    if not any(reasons):
        return {}
    none = Reason("")
    known = [reason or none for reason in reasons]
    return {
        "reason": np.array([frame.note for frame in frames]),
        "reason_kind": np.array([reason.kind for reason in known]),
        "reason_where": np.array([(reason.part, reason.camera) for reason in known]),
        "reason_numbers": np.array([(reason.number, reason.other) for reason in known]),
    }


def stacked_probabilities(frames: Sequence[FrameResult], parts: tuple[str, ...]) -> dict[str, Any]:
    """Return the arrays of probabilities of being off, and those by part; none where no frame has them: a body has no parts."""
    whole = np.array([frame.p_off_25mm for frame in frames], dtype=float)
    if all(frame.p_off_10mm is None for frame in frames):
        return {"p_off_25mm": whole} if np.isfinite(whole).any() else {}
    unknown = np.full(len(parts), np.nan)
    by_part = [unknown if frame.p_off_10mm is None else frame.p_off_10mm for frame in frames]
    return {
        "p_off_25mm": whole,
        "p_off_10mm": np.stack(by_part).astype(float),
        "part_names": parts,
    }


def stacked_alternatives(frames: Sequence[FrameResult]) -> dict[str, Any]:
    """Return the arrays of hypotheses; none where one pose alone was carried."""
    most = max(len(frame.alternatives) for frame in frames)
    if not most:
        return {}
    shape = (len(frames), most)
    parameters = np.full((*shape, len(frames[0].parameters)), np.nan)
    energy, weight = np.full(shape, np.nan), np.full(shape, np.nan)
    parent = np.full(shape, -1)
    origin = [
        [a.origin for a in f.alternatives] + [""] * (most - len(f.alternatives)) for f in frames
    ]
    for row, frame in enumerate(frames):
        for column, pose in enumerate(frame.alternatives):
            parameters[row, column], parent[row, column] = pose.parameters, pose.parent
            energy[row, column], weight[row, column] = pose.energy, pose.weight
    return {
        "hypothesis_parameters": parameters,
        "hypothesis_energy": energy,
        "hypothesis_weight": weight,
        "hypothesis_parent": parent,
        "hypothesis_origin": np.array(origin),
    }
