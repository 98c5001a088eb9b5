"""A person in a small recording: what a detector sees of their joints in a few cameras, and nothing else."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from handtrack import ArticulatedModel, Camera, CameraRig, HandScale, load_model
from handtrack.arrays import F, Floats, P
from handtrack.capture.calibration.rig_file import write_rig
from handtrack.capture.images.openpose import LAYOUTS, write_points
from handtrack.geometry.rotation import rotation_matrix
from handtrack.simulation.motion import motion as named_motion
from tests.cameras import FACING, pinhole

LAYOUT = LAYOUTS["body_25b"]
FPS = 25.0
OFFSETS = {
    "left_hip": (-12.0, 30.0, 10.0), "right_hip": (12.0, 30.0, 10.0),
    "left_shoulder": (6.0, -20.0, -15.0), "right_shoulder": (-6.0, -20.0, -15.0),
    "left_knee": (0.0, 15.0, 15.0), "right_knee": (0.0, 15.0, 15.0), "nose": (0.0, 5.0, -15.0),
}  # fmt: skip
"""where the detector sees joints, from ours [mm]: mirror images"""
PERSON = HandScale(1.05, {"thighs": 1.04, "forearms": 0.95}, {}, OFFSETS)


@dataclass(frozen=True, eq=False)
class Filmed:
    """A recording, and who is in it."""

    folder: Path
    model: ArticulatedModel
    poses: Floats[F, P]

    def joints(self, frame: int) -> Floats:
        """Return the named joints' true places, world [m]."""
        return self.model.joint_positions(self.model.bones(self.poses[frame]))


def film(
    folder: Path,
    cameras: int = 3,
    frames: int = 12,
    person: HandScale = PERSON,
    hand: Mapping[str, object] | None = None,
    motion: str = "dance",
) -> Filmed:
    """Write a session of a person before cameras 4 m away, 60° from each other.

    hand: what [hand] says beside the model.
    """
    model, rng = load_model("body34", scale=person), np.random.default_rng(4)
    joint = named_motion(model, motion, frames, rng)
    poses = np.array([model.clipped(model.transform.solver_params(row)) for row in joint])
    rig = CameraRig(tuple(_camera(k) for k in range(cameras)))
    folder.mkdir(parents=True)
    write_rig(folder / "calibration.toml", rig)
    table = {"model": "body34", **(hand or {})}
    lines = ["[session]", "format = 1", 'name = "a person"', f"fps = {FPS}", "", "[hand]"]
    lines += [f"{name} = {json.dumps(value)}" for name, value in table.items()]
    for camera in rig.cameras:
        (folder / "pose" / camera.name).mkdir(parents=True)
        lines += ["", "[[camera]]", f'name = "{camera.name}"', f'keypoints = "pose/{camera.name}/*.json"', 'keypoint_layout = "body_25b"']  # fmt: skip
        for frame, pose in enumerate(poses):
            pixels = camera.project(
                model.bones(pose).to_world(model.joint_bone, model.observed_point)
            )
            pixels += rng.normal(scale=2.0, size=pixels.shape)
            rows = np.zeros((LAYOUT.count, 3))
            for name, row in LAYOUT.points.items():
                rows[row] = (*pixels[model.joint_names.index(name)], 0.9)
            path = folder / "pose" / camera.name / f"{frame:06d}.json"
            write_points(path, rows, LAYOUT, "test")
    (folder / "session.toml").write_text("\n".join(lines) + "\n")
    return Filmed(folder, model, poses)


def _camera(number: int) -> Camera:
    turn = rotation_matrix(np.array([0.0, np.deg2rad(60.0) * number, 0.0]))
    return pinhole(f"cam{number}", (720, 960), 800, FACING @ turn.T, (0, 0, 4), at=(360, 480))
