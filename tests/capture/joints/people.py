"""A walking person's 2D joints, made by body38 and a camera, in the orders and the files of detectors of bodies."""

import csv
import json
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import D2, D3, F, Floats, J, K
from handtrack.capture.images.openpose import LAYOUTS
from handtrack.geometry.camera import CameraRig
from handtrack.model.model_file import load_model
from handtrack.simulation.motion import motion as named_motion
from handtrack.simulation.simulate import simulated_rig

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


def in_order(layout: str, seen: Floats[J, D2], confidence: float = 0.8) -> Floats[K, D3]:
    """Return a person's points as a detector orders them; those that the body does not have are near its nose."""
    kind = LAYOUTS[layout]
    points = np.tile([*seen[names().index("nose")] + 3.0, confidence], (kind.count, 1))
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


def _one(layout: str) -> list[Floats[K, D3]]:
    return [in_order(layout, seen) for seen in pixels()]


def _openpose(layout: str) -> Callable[[Path], Path]:
    return lambda folder: openpose(folder / "op", {i: [p] for i, p in enumerate(_one(layout))})


def _coco(layout: str) -> Callable[[Path], Path]:
    """As AlphaPose and COCO's results do: an entry a person."""

    def write(folder: Path) -> Path:
        entries = [
            {"image_id": f"{i:06d}.jpg", "category_id": 1, "keypoints": p.ravel().tolist(), "score": 2.1}
            for i, p in enumerate(_one(layout))
        ]  # fmt: skip
        return _json(folder / "alphapose.json", entries)

    return write


def _mmpose(folder: Path) -> Path:
    entries = [
        {"frame_id": i, "instances": [{"keypoints": p[:, :2].tolist(), "keypoint_scores": p[:, 2].tolist()}]}
        for i, p in enumerate(_one("halpe26"))
    ]  # fmt: skip
    return _json(folder / "mmpose.json", {"instance_info": entries})


def _mediapipe(folder: Path) -> Path:
    frames = []
    for i, p in enumerate(_one("mediapipe33")):
        shares = (p[:, :2] + 0.5) / SIZE
        rows = [{"x": x, "y": y, "z": 0.1, "visibility": 0.8} for x, y in shares.tolist()]
        frames.append({"frame": i, "pose_landmarks": [rows]})
    return _json(folder / "mp.json", frames)


def _mediapipe_csv(folder: Path) -> Path:
    rows: list[list[Any]] = [["frame", "landmark", "x", "y", "z", "visibility"]]
    for i, p in enumerate(_one("mediapipe33")):
        rows += [
            [i, k, *((point[:2] + 0.5) / SIZE).tolist(), 0.0, 0.8] for k, point in enumerate(p)
        ]
    return _csv(folder / "mp.csv", rows)


_SPELT = {
    "nose": "Nose", "neck": "Neck", "pelvis": "MidHip", "head_top": "head_top",
    **{f"{side}_{joint}": f"{side[0].upper()}{word}" for side in ("left", "right") for joint, word in (
        ("shoulder", "Shoulder"), ("elbow", "Elbow"), ("wrist", "Wrist"), ("hip", "Hip"), ("knee", "Knee"),
        ("ankle", "Ankle"), ("toe", "BigToe"))},
}  # fmt: skip


def _deeplabcut(folder: Path) -> Path:
    words = [*_SPELT.values(), "tail"]
    rows: list[list[Any]] = [
        ["scorer", *["DLC"] * 3 * len(words)],
        ["bodyparts", *(word for word in words for _ in "xyl")],
        ["coords", *["x", "y", "likelihood"] * len(words)],
    ]
    for i, seen in enumerate(pixels()):
        points = np.column_stack(
            [seen[[names().index(name) for name in _SPELT]], np.full(len(_SPELT), 0.8)]
        )
        rows.append([i, *points.ravel().tolist(), 5.0, 6.0, 0.9])
    return _csv(folder / "dlc.csv", rows)


def _long_csv(folder: Path) -> Path:
    rows: list[list[Any]] = [["frame", "joint", "x", "y", "confidence"]]
    for i, seen in enumerate(pixels()):
        rows += [[i, name, *seen[names().index(name)].tolist(), 0.8] for name in _SPELT]
    return _csv(folder / "long.csv", rows)


def _sleap(folder: Path) -> Path:
    import h5py  # pyright: ignore[reportMissingImports]

    rows = [names().index(name) for name in _SPELT]
    tracks = pixels()[:, rows].transpose(2, 1, 0)[None]
    with h5py.File(folder / "analysis.h5", "w") as file:
        file["tracks"] = np.concatenate([0.4 * tracks, tracks])  # a smaller person first
        file["point_scores"] = np.full((2, *tracks.shape[2:]), 0.8)
        file["node_names"] = np.array([word.encode() for word in _SPELT.values()])
    return folder / "analysis.h5"


def _json(path: Path, value: Any) -> Path:
    path.write_text(json.dumps(value))
    return path


def _csv(path: Path, rows: list[list[Any]]) -> Path:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    return path


FORMS: dict[str, tuple[str, Callable[[Path], Path]]] = {
    **{f"openpose {layout}": (layout, _openpose(layout))
       for layout in ("body_25", "body_25b", "coco17", "coco18", "halpe26", "coco133", "mediapipe33")},
    **{f"coco {layout}": (layout, _coco(layout)) for layout in ("coco17", "halpe26")},
    "mmpose": ("halpe26", _mmpose), "mediapipe": ("mediapipe33", _mediapipe), "mediapipe csv": ("mediapipe33", _mediapipe_csv),
    "deeplabcut csv": ("body22", _deeplabcut), "long csv": ("body22", _long_csv), "sleap h5": ("body22", _sleap),
}  # fmt: skip
"""by name: the layout that is to be recognised, and what writes the person of `pixels()`, confidence 0.8"""
