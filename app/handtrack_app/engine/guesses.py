"""The poses that a frame may have: found without a first pose, or carried along by the tracker."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from handtrack.arrays import Floats
from handtrack.model.articulated import ArticulatedModel
from handtrack.session.first_pose.first_pose_candidate import FirstPoseCandidate
from handtrack.session.session_state import NOTHING, DecidedPose, Edit, StartPose, decide, in_turn
from handtrack_app.engine.document import Document
from handtrack_app.engine.store import edits
from handtrack_app.protocol.snapshots import Guess, GuessesSnapshot

_MOST = 8  # of a list


@dataclass(frozen=True, eq=False)
class _Pose:
    model: ArticulatedModel
    params: Floats
    guess: Guess


@dataclass
class Guesses:
    """What was found, by frame; what is carried stands in the tracker's results. On the worker's thread only."""

    document: Document
    found: dict[int, list[FirstPoseCandidate]] = field(default_factory=dict)
    """by frame, the surest first"""
    _published: tuple[int, str, int] = (-1, "", 0)

    def keep(self, candidates: list[FirstPoseCandidate]) -> None:
        """Keep what a search found."""
        if candidates:
            self.found[candidates[0].frame] = candidates

    def snapshot(self, is_new: bool = False) -> GuessesSnapshot | None:
        """Return the list of the frame shown; None where the page has it already."""
        frame = self.document.frame
        kind, poses = self._poses(frame)
        key = (frame, kind, id(poses[0].params) if poses else 0)
        if key == self._published or (not poses and not self._published[1]):
            return None
        self._published = key
        if not poses:
            return GuessesSnapshot(frame, "")
        bones = [pose.model.bones(pose.params) for pose in poses]
        counts = [len(b.position) for b in bones]
        return GuessesSnapshot(
            frame,
            kind,
            tuple(pose.guess for pose in poses),
            np.repeat(np.arange(len(poses)), counts),
            np.concatenate([b.position for b in bones]),
            np.concatenate([b.rotation for b in bones]),
            np.concatenate([pose.model.skeleton.length for pose in poses]),
            is_new,
        )

    def take(self, frame: int, index: int) -> Edit:
        """Return what setting a frame's pose to one of its list changes: the model may get a forearm for it, or a size
        still to be fitted; where the session has no first pose, tracking begins there.
        """
        kind, poses = self._poses(frame)
        if not 0 <= index < len(poses):
            return NOTHING
        document, pose = self.document, poses[index]
        arm = pose.model.has_forearm and not document.model.has_forearm
        arm = arm and document.model.has_keypoints21
        changed = [decide(forearm=True)] if arm else []
        if document.size_pending and pose.model.scale != document.run.scale:
            changed.append(edits.size(pose.model.scale, pending=True))
        joint = pose.model.joint_params(pose.params)
        known = dict(zip(pose.model.parameter_names, joint.tolist(), strict=True))
        changed.append(decide(pose={frame: DecidedPose(known, found=kind == "found")}))
        if document.run.first is None:
            changed.append(decide(start=StartPose(frame, known)))
        return in_turn(*changed)

    def _poses(self, frame: int) -> tuple[str, list[_Pose]]:
        result = self.document.results.get(frame)
        if frame in self.found:
            rows = self.found[frame][:_MOST]
            return "found", [_Pose(c.model, c.params, Guess(c.confidence, c.note)) for c in rows]
        carried = () if result is None else result.alternatives[:_MOST]
        if len(carried) < 2:
            return "", []
        model = self.document.model
        return "carried", [
            _Pose(
                model,
                model.transform.solver_params(h.parameters),
                Guess(h.weight, f"{h.origin}, cost {h.energy:.1f}"),
            )
            for h in carried
        ]
