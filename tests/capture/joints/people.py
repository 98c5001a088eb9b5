"""A walking person's 2D joints, made by body38 and a camera, in the orders and the files of detectors of bodies."""

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np

from handtrack import CameraRig, load_model
from handtrack.arrays import D2, D3, F, Floats, J, K
from handtrack.capture.images.openpose import LAYOUTS
from handtrack.simulation.motion import motion as named_motion
from handtrack.simulation.simulate import simulated_rig
from tests.capture.sample_files import sample

SIZE = (640, 480)
FRAMES = 12


@cache
def names() -> tuple[str, ...]:
    return load_model("body38").joint_names


@cache
def places(motion: str = "greet", frames: int = FRAMES) -> Floats[F, J, D3]:
    """Return joints world [m] of a body about the origin, upright."""
    model = load_model("body38")
    poses = named_motion(model, motion, frames, np.random.default_rng(3))
    bones = [model.bones(model.transform.solver_params(pose)) for pose in poses]
    return np.stack([model.joint_positions(one) for one in bones])


def rig(cameras: int = 2) -> CameraRig:
    return simulated_rig(cameras, SIZE, 3.5)


def pixels(camera: int = 0, motion: str = "greet") -> Floats[F, J, D2]:
    return np.round(rig().cameras[camera].project(places(motion)), 3)


def in_order(layout: str, seen: Floats[J, D2]) -> Floats[K, D3]:
    """Return a person's points as a detector orders them; those that the body does not have are near its nose."""
    kind = LAYOUTS[layout]
    points = np.tile([*seen[names().index("nose")] + 3.0, 0.8], (kind.count, 1))
    for name, row in kind.points.items():
        points[row, :2] = seen[names().index(name)]
    return points


def openpose(
    folder: Path,
    people: Mapping[int, list[Floats[K, D3]]],
    name: str = "cam_{:012d}_keypoints.json",
) -> Path:
    """Write a file a frame, everybody in it."""
    folder.mkdir(parents=True)
    for frame, everybody in people.items():
        rows = [
            {"person_id": [-1], "pose_keypoints_2d": np.nan_to_num(points).ravel().tolist(),
             "hand_left_keypoints_2d": [], "hand_right_keypoints_2d": []}
            for points in everybody
        ]  # fmt: skip
        (folder / name.format(frame)).write_text(json.dumps({"version": 1.3, "people": rows}))
    return folder


LAYOUTS_OF = {
    "coco_coco17": "coco17", "coco_halpe26": "halpe26", "mmpose": "halpe26", "mediapipe": "mediapipe33",
    "mediapipe_csv": "mediapipe33", "deeplabcut_csv": "body22", "long_csv": "body22", "sleap_h5": "body22",
}  # fmt: skip
OPENPOSE = "body_25 body_25b coco17 coco18 halpe26 coco133 mediapipe33"


def person_in(form: str, folder: Path) -> tuple[Path, str]:
    """Return a file with the person of `pixels()`, confidence 0.8, and the layout that is to be recognised."""
    if form in OPENPOSE.split():
        seen = {i: [in_order(form, points)] for i, points in enumerate(pixels())}
        return openpose(folder / "op", seen), form
    (path,) = sample(f"bodies/{form}", folder)
    return path, LAYOUTS_OF[form]
