"""A person in a small recording: what a detector sees of their joints in a few cameras, and nothing else."""

from pathlib import Path

import numpy as np

from handtrack import CameraRig, HandScale, load_model
from handtrack.capture.calibration.rig_file import write_rig
from handtrack.capture.images.openpose import LAYOUTS
from handtrack.capture.joints.given_joints import write_joints
from handtrack.geometry.rotation import rotation_matrix
from handtrack.session.session_file import (
    CameraSettings,
    HandSettings,
    RecordingSettings,
    SessionFile,
    write_session_file,
)
from handtrack.session.truth import Truth, write_truth
from handtrack.simulation.motion import motion as named_motion
from handtrack.simulation.simulate import points_of
from tests.cameras import FACING, pinhole

LAYOUT = "body_25b"
OFFSETS = {
    "left_hip": (-12.0, 30.0, 10.0), "right_hip": (12.0, 30.0, 10.0),
    "left_shoulder": (6.0, -20.0, -15.0), "right_shoulder": (-6.0, -20.0, -15.0),
    "left_knee": (0.0, 15.0, 15.0), "right_knee": (0.0, 15.0, 15.0), "nose": (0.0, 5.0, -15.0),
}  # fmt: skip
"""where the detector sees joints, from ours [mm]: mirror images"""
PERSON = HandScale(1.05, {"thighs": 1.04, "forearms": 0.95}, {}, OFFSETS)


def film(
    folder: Path,
    cameras: int = 3,
    frames: int = 12,
    person: HandScale = PERSON,
    hand: HandSettings = HandSettings("body34", scale="fit"),
    motion: str = "dance",
) -> Path:
    """Write a session of a person before cameras 4 m away, 60° from each other, with the joints' true places."""
    model, rng = load_model("body34", scale=person), np.random.default_rng(4)
    joint = named_motion(model, motion, frames, rng)
    poses = [model.bones(model.clipped(model.transform.solver_params(row))) for row in joint]
    rig = CameraRig(tuple(map(_camera, range(cameras))))
    settings = tuple(
        CameraSettings(c.name, keypoints=f"pose/{c.name}/*.json", keypoint_layout=LAYOUT)
        for c in rig
    )
    folder.mkdir(parents=True)
    file = SessionFile(RecordingSettings("a person", 25.0), hand, settings)
    write_session_file(folder / "session.toml", file)
    write_rig(folder / "calibration.toml", rig)
    places = np.array([model.joint_positions(bones) for bones in poses])
    truth = Truth(np.arange(frames), None, None, model.joint_names, places)
    write_truth(folder / "truth.npz", truth)
    for camera in rig:
        seen = {}
        for frame, bones in enumerate(poses):
            pixels = camera.project(bones.to_world(model.joint_bone, model.observed_point))
            pixels += rng.normal(scale=2.0, size=pixels.shape)
            seen[frame] = points_of(LAYOUTS[LAYOUT], model.joint_names, pixels)
        write_joints(seen, LAYOUT, folder / "pose" / camera.name)
    return folder


def _camera(number):
    turn = rotation_matrix(np.array([0.0, np.deg2rad(60.0) * number, 0.0]))
    return pinhole(f"cam{number}", (720, 960), 800, FACING @ turn.T, (0, 0, 4), at=(360, 480))
