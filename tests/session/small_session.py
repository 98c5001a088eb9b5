"""A tiny session folder for tests to damage: two cameras, square masks, truth, first pose."""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from handtrack import CameraRig, Session
from handtrack.arrays import D3, D21, F, Floats
from handtrack.capture.calibration.rig_file import write_rig
from handtrack.capture.images.openpose import LAYOUTS, write_points
from handtrack.files.toml_edit import edit_toml
from handtrack.session.session_file import (
    CameraSettings,
    HandSettings,
    RecordingSettings,
    SessionFile,
    read_session_file,
    write_session_file,
)

FRAMES = 4
SETTINGS = """
[session]
format = 1
name = "small"
fps = 10.0

[hand]
model = "hand26"
side = "right"
scale = "fit"

[[camera]]
name = "cam0"
images = "cam0/*.png"
masks = "masks/cam0/*.png"

[[camera]]
name = "cam1"
masks = "masks/cam1/*.png"
"""
CALIBRATION = """
[cam_0]
name = "cam0"
size = [64, 48]
matrix = [[80.0, 0.0, 31.5], [0.0, 80.0, 23.5], [0.0, 0.0, 1.0]]
distortions = [0.0, 0.0, 0.0, 0.0, 0.0]
rotation = [0.0, 0.0, 0.0]
translation = [0.0, 0.0, 0.5]

[cam_1]
name = "cam1"
size = [64, 48]
matrix = [[80.0, 0.0, 31.5], [0.0, 80.0, 23.5], [0.0, 0.0, 1.0]]
distortions = [0.0, 0.0, 0.0, 0.0, 0.0]
rotation = [0.0, 0.7, 0.0]
translation = [0.0, 0.0, 0.5]
"""


def keypoints() -> Floats:
    """(21, 3) [m]: a stylised open hand around the origin, 90 mm from wrist to middle knuckle."""
    points = [[0.0, 0.07, 0.0]]
    for finger in range(5):
        x = 0.018 * (finger - 2)
        points += [[x, y, 0.0] for y in (-0.02, -0.04, -0.06, -0.08)]
    return np.array(points)


def make_session(folder: Path) -> Path:
    """Write the session into a folder and return it."""
    (folder / "session.toml").write_text(SETTINGS)
    (folder / "calibration.toml").write_text(CALIBRATION)
    mask = np.zeros((48, 64), np.uint8)
    mask[5:43, 17:47] = 255
    for camera in ("cam0", "cam1"):
        (folder / "masks" / camera).mkdir(parents=True)
        for frame in range(FRAMES):
            cv2.imwrite(str(folder / "masks" / camera / f"{frame:03d}.png"), mask)
    write_images(folder / "cam0", range(0, FRAMES * 40, 40))
    write_init(folder)
    write_truth(folder)
    return folder


def write_images(folder: Path, levels: Iterable[int]) -> None:
    """Write images 0, 1, 2 … of these grey levels."""
    folder.mkdir(exist_ok=True)
    for number, level in enumerate(levels):
        cv2.imwrite(str(folder / f"{number:03d}.png"), np.full((48, 64, 3), level, np.uint8))


def write_init(folder: Path, **changes: Any) -> None:
    """Write init.json with some keys changed; None leaves a key away."""
    data = {"frame": 0, "convention": "openpose21", "unit": "m", "xyz": keypoints().tolist()}
    data = {key: value for key, value in {**data, **changes}.items() if value is not None}
    (folder / "init.json").write_text(json.dumps(data))


def write_truth(folder: Path, **changes: Any) -> None:
    """Write truth.npz with some arrays changed; None leaves an array away."""
    data: dict[str, Any] = {
        "keypoints21": np.repeat(keypoints()[None], FRAMES, axis=0),
        "joint_names": np.array(["wrist", "palm"]),
        "joint_positions": np.zeros((FRAMES, 2, 3)),
        "time_s": np.arange(FRAMES) / 10,
    }
    kept = {key: value for key, value in {**data, **changes}.items() if value is not None}
    np.savez(folder / "truth.npz", **kept)


def edit(path: Path, old: str, new: str) -> None:
    """Replace a text that must be there."""
    text = path.read_text()
    assert old in text, f"{old!r} is not in {path.name}"
    path.write_text(text.replace(old, new, 1))


def joints_session(folder: Path, rig: CameraRig, hand: HandSettings = HandSettings()) -> Path:
    """Write a session of cameras that have no files yet."""
    cameras = tuple(CameraSettings(camera.name) for camera in rig)
    file = SessionFile(RecordingSettings("joints", 30.0), hand, cameras)
    write_session_file(folder / "session.toml", file)
    write_rig(folder / "calibration.toml", rig)
    return folder


def add_seen(
    folder: Path,
    points: Floats[F, D21, D3],
    noise_px: float,
    off_px: Mapping[str, tuple[float, float]] = {},
) -> Path:
    """Give all cameras of a session the 2D joints of points [m], with noise; off_px: by how much some see all of them elsewhere."""
    rng = np.random.default_rng(1)
    return add_joints(folder, {
        camera.name: {
            frame: camera.project(hand) + rng.normal(scale=noise_px, size=(21, 2)) + off_px.get(camera.name, (0, 0))
            for frame, hand in enumerate(points)
        }
        for camera in Session.open(folder).rig
    })  # fmt: skip


def add_joints(folder: Path, seen: Mapping[str, Mapping[int, Floats]]) -> Path:
    """Give cameras of a session 2D joints: by camera and frame (21, 2) pixels, or (21, 3) with confidences."""
    changes = {}
    for number, camera in enumerate(read_session_file(folder / "session.toml").cameras):
        at = folder / "keypoints" / camera.name
        at.mkdir(parents=True, exist_ok=True)
        for frame, rows in seen.get(camera.name, {}).items():
            points = rows if rows.shape[1] == 3 else np.column_stack([rows, np.ones(21)])
            write_points(at / f"{frame:06d}.json", points, LAYOUTS["hand_right"], "test")
        if camera.name in seen:
            changes[f"camera.{number}.keypoints"] = f"keypoints/{camera.name}/*.json"
            changes[f"camera.{number}.keypoint_layout"] = "mediapipe21"
    edit_toml(folder / "session.toml", changes, "a session's settings")
    return folder
