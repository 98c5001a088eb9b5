"""The 2D joints that `handtrack new` is given, of one hand in all cameras."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from handtrack.capture.joints.given_joints import (
    GivenJoints,
    Hand,
    in_pixels,
    write_joints,
)
from handtrack.capture.joints.read_joints import read_joints
from handtrack.errors import HandtrackError
from handtrack_app.commands.new_session.sources import Recorded
from handtrack_app.commands.terminal.progress import say


@dataclass(frozen=True)
class CameraJoints:
    """The hand's points in one camera's images."""

    where: str
    given: GivenJoints
    frames: Mapping[int, Hand]
    side: str
    """right or left; empty where the file does not say it."""

    def layout(self, side: str) -> str:
        """Return the session's keypoint_layout."""
        return self.given.layout or f"hand_{side}"

    def pixels(self, size: tuple[int, int]) -> dict[int, Hand]:
        """Return the hand by frame, [px] of images of a size."""
        if not self.given.is_share:
            return dict(self.frames)
        return {frame: in_pixels(hand, size) for frame, hand in self.frames.items()}

    def write(self, folder: Path, side: str, size: tuple[int, int]) -> None:
        """Write a file a frame to a new folder, and say what was taken. size: of the camera's images [px]."""
        write_joints(self.pixels(size), side, folder)
        left = ", ".join(self.given.unknown[:8])
        more = f"; not a hand's, so left out: {left}" if left else ""
        say(f"{self.where}: {self.given.family}, a hand in {len(self.frames)} frames{more}.")
        for note in self.given.notes:
            say(f"note: {note}")


def camera_joints(recorded: Mapping[str, Recorded], side: str | None) -> dict[str, CameraJoints]:
    """Return the joints by camera. Raises HandtrackError where two cameras' are of different sides.

    side: what the user said.
    """
    found: dict[str, CameraJoints] = {}
    for name, cam in recorded.items():
        if cam.keypoints is not None:
            where = f"--keypoints {name}={cam.keypoints}"
            given = read_joints(cam.keypoints, where)
            chosen, frames = given.hand(side, where)
            found[name] = CameraJoints(where, given, frames, chosen)
    sides = {joints.side: joints for joints in found.values() if joints.side}
    if len(sides) > 1:
        first, second = sides.values()
        raise HandtrackError(
            f"{second.where}: a {second.side} hand, but {first.where} has a {first.side} one; say which with --side."
        )
    return found
