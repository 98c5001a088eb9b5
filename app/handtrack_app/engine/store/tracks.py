"""Tracks: all frames with poses set by hand as one; rows of an earlier version."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from handtrack.arrays import Floats
from handtrack.errors import HandtrackError
from handtrack.tracking.frame.reason import KINDS, Reason
from handtrack.tracking.frame.result import FrameResult, Status, TrackResult
from handtrack_app.engine.document import Document


def whole_track(document: Document) -> TrackResult:
    """Return all frames as one TrackResult; poses set by hand are keyframes."""
    frames = dict(document.results)
    frames.update({frame: _keyframe(document, frame) for frame in document.by_hand})
    if not frames:
        raise HandtrackError(
            f"There is nothing to save yet: track some frames, or pose the {document.model.kind}, first."
        )
    track = document.run.result(sorted(frames.values(), key=lambda result: result.frame))
    return replace(track, refinement=document.results.refinement)


def _keyframe(document: Document, frame: int) -> FrameResult:
    model, values = document.model, document.by_hand[frame]
    joints = len(model.joint_names)
    return _complete(
        document, frame, values, Status.KEYFRAME, float("nan"), 0,
        np.full(len(values), np.inf), np.tile(np.eye(3), (joints, 1, 1)),
    )  # fmt: skip


def _complete(
    document: Document,
    frame: int,
    values: Floats,
    status: Status,
    energy: float,
    iterations: int,
    std: ArrayLike,
    spread: ArrayLike,
) -> FrameResult:
    model = document.model
    values = np.asarray(values, dtype=float)
    bones = model.bones(model.transform.solver_params(values))
    return FrameResult(
        frame=frame,
        time_s=float(document.run.session.time_s(frame)),
        parameters=values,
        status=status,
        energy=energy,
        iterations=iterations,
        parameter_std=np.asarray(std, dtype=float),
        joint_covariance=np.asarray(spread, dtype=float),
        T_world_bone=bones.T_world_bone,
        joint_positions=model.joint_positions(bones),
        keypoints21=model.keypoints21(bones) if model.has_keypoints21 else None,
    )


def result_of_row(row: dict[str, Any], document: Document) -> FrameResult:
    """Return the frame that the journal of an earlier version kept. Raises ValueError for one of another model."""
    values = np.asarray(row["parameters"], dtype=float)
    if values.shape != (len(document.model.parameter_names),):
        raise ValueError("another model's pose")
    found = _complete(
        document, int(row["frame"]), values, Status(row["status"]), float(row["energy"]), int(row["iterations"]),
        row["std"], row["spread"],
    )  # fmt: skip
    energies = {k: float(v) for k, v in row.get("energies", {}).items()}
    return replace(found, energies=energies, reason=_reason(row))


def _reason(row: dict[str, Any]) -> Reason | None:
    """Return why a kept frame is doubtful. Raises ValueError for a reason that is none."""
    if row.get("unknown"):  # an older journal: only this kind was kept
        return Reason("open", part="hand")
    kept = row.get("reason")
    if kept is not None and kept.get("kind") not in KINDS:
        raise ValueError("a reason of an unknown kind")
    return None if kept is None else Reason(**kept)
