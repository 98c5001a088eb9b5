"""What stands beside each camera's small picture: its name, and how far the hand shown overlaps its mask."""

from __future__ import annotations

from dataclasses import dataclass

import viser

from handtrack_app.page.page import put
from handtrack_app.protocol.score import ScoreSnapshot
from handtrack_app.protocol.snapshots import PoseSnapshot


@dataclass
class CameraNames:
    """The latest score, and the pose that is shown: a number stands only where it is of that pose."""

    score: ScoreSnapshot | None = None
    pose: PoseSnapshot | None = None

    def of(self, camera: str) -> str:
        """Return a camera's name, and its overlap where the pose shown is scored."""
        score, pose = self.score, self.pose
        if score is None or pose is None or not score.is_of(pose.frame, pose.values):
            return camera
        share = score.overlap.get(camera)
        return camera if share is None else f"{camera}  {share:.2f}"

    def write(self, labels: dict[str, viser.LabelHandle]) -> None:
        """Write them beside pictures; what stands there already is not sent again."""
        for camera, label in labels.items():
            put(label, text=self.of(camera))
