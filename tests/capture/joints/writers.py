"""A moving hand's 2D joints in the forms that detectors write."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import D3, D21, F, Floats
from handtrack.capture.joints.joint_names import JOINTS

SIZE = (640, 480)
FRAMES = 3


def hand() -> Floats[F, D21, D3]:
    """Return column, row [px], confidence of three frames; one point of the second is missing."""
    rng = np.random.default_rng(5)
    points = np.concatenate(
        [rng.uniform(100, 400, (FRAMES, 21, 2)), rng.uniform(0.65, 0.95, (FRAMES, 21, 1))], axis=2
    )
    points = np.round(points, 3)
    points[1, 7] = (np.nan, np.nan, 0.0)
    return points


def openpose(folder: Path, points: Floats[F, D21, D3]) -> Path:
    (folder / "op").mkdir()
    for i, rows in enumerate(np.nan_to_num(points)):
        person = {
            "pose_keypoints_2d": [0.0] * 75,
            "hand_left_keypoints_2d": [0.0] * 63,
            "hand_right_keypoints_2d": rows.ravel().tolist(),
        }
        (folder / "op" / f"cam_{i:012d}_keypoints.json").write_text(
            json.dumps({"version": 1.3, "people": [person]})
        )
    return folder / "op"


def _shares(points: Floats[F, D21, D3]) -> Floats[F, D21, D3]:
    """Return columns and rows as shares of the image; MediaPipe misses no point of a hand, so all are there."""
    shares = points.copy()
    shares[..., :2] = (shares[..., :2] + 0.5) / SIZE
    return shares


def mediapipe_tasks(folder: Path, points: Floats[F, D21, D3]) -> Path:
    frames = [
        {"frame": i, "timestamp_ms": 33 * i, "handedness": [[{"category_name": "Left", "score": 0.98}]],
         "hand_landmarks": [[{"x": x, "y": y, "z": 0.01} for x, y, _ in rows.tolist()]]}
        for i, rows in enumerate(_shares(points))
    ]  # fmt: skip
    return _json(folder / "mp.json", frames)


def mediapipe_legacy(folder: Path, points: Floats[F, D21, D3]) -> Path:
    frames = [
        {"multi_hand_landmarks": [{"landmark": [{"x": x, "y": y, "z": 0.0} for x, y, _ in rows.tolist()]}],
         "multi_handedness": [{"classification": [{"index": 0, "score": 0.9, "label": "Right"}]}]}
        for rows in _shares(points)
    ]  # fmt: skip
    return _json(folder / "legacy.json", {"frames": frames})


def mediapipe_long_csv(folder: Path, points: Floats[F, D21, D3]) -> Path:
    rows = [
        [i, "Right", k, *_shares(points)[i, k, :2], 0.0] for i in range(FRAMES) for k in range(21)
    ]
    return _csv(folder / "long.csv", [["frame", "hand", "landmark", "x", "y", "z"], *rows])


def mediapipe_wide_csv(folder: Path, points: Floats[F, D21, D3]) -> Path:
    names = ["WRIST", *(f"THUMB_{j}" for j in ("CMC", "MCP", "IP", "TIP"))]
    names += [
        f"{f}_FINGER_{j}" if f != "PINKY" else f"PINKY_{j}"
        for f in ("INDEX", "MIDDLE", "RING", "PINKY")
        for j in ("MCP", "PIP", "DIP", "TIP")
    ]
    head = ["frame", *(f"{name}_{axis}" for name in names for axis in "xyz")]
    rows = [
        [i, *(v for x, y, _ in _shares(points)[i].tolist() for v in (x, y, 0.0))]
        for i in range(FRAMES)
    ]
    return _csv(folder / "wide.csv", [head, *rows])


def numbered_csv(folder: Path, points: Floats[F, D21, D3]) -> Path:
    head = [f"{axis}{k}" for k in range(21) for axis in "xy"]
    return _csv(folder / "numbered.csv", [head, *(rows[:, :2].ravel().tolist() for rows in points)])


def mmpose(folder: Path, points: Floats[F, D21, D3]) -> Path:
    """As MMPose's inferencer writes a video of one person, counted from 0."""
    entries = []
    for i, rows in enumerate(np.nan_to_num(points)):
        body = np.zeros((133, 3))
        body[112:133] = rows
        entries.append(
            {
                "frame_id": i,
                "instances": [
                    {"keypoints": body[:, :2].tolist(), "keypoint_scores": body[:, 2].tolist()}
                ],
            }
        )
    return _json(
        folder / "mmpose.json",
        {"meta_info": {"dataset_name": "coco_wholebody"}, "instance_info": entries},
    )


def mmpose_from_one(folder: Path, points: Floats[F, D21, D3]) -> Path:
    """As its demos do, which count from 1."""
    table = json.loads(mmpose(folder, points).read_text())
    for entry in table["instance_info"]:
        entry["frame_id"] += 1
    return _json(folder / "demo.json", table)


def coco_annotations(folder: Path, points: Floats[F, D21, D3]) -> Path:
    images = [{"id": 70 + i, "file_name": f"shots/{i:05d}.jpg"} for i in range(FRAMES)]
    rows = [
        {
            "image_id": 70 + i,
            "keypoints": [0] * 51,
            "lefthand_kpts": [0.0] * 63,
            "righthand_kpts": np.nan_to_num(p).ravel().tolist(),
        }
        for i, p in enumerate(points)
    ]
    return _json(folder / "coco.json", {"images": images, "annotations": rows})


def deeplabcut_csv(folder: Path, points: Floats[F, D21, D3]) -> Path:
    names = [f"right_{name}" for name in JOINTS] + ["elbow"]
    head = [
        ["scorer", *["DLC_resnet50"] * 66],
        ["bodyparts", *(n for n in names for _ in "xyl")],
        ["coords", *["x", "y", "likelihood"] * 22],
    ]
    rows = [
        [i, *np.where(np.isnan(p), 0, p).ravel().tolist(), 5.0, 6.0, 0.9]
        for i, p in enumerate(points)
    ]
    return _csv(folder / "camDLC.csv", [*head, *rows])


def deeplabcut_h5(folder: Path, points: Floats[F, D21, D3]) -> Path:
    """By pandas and PyTables, as DeepLabCut does."""
    import pandas  # pyright: ignore[reportMissingImports]

    names = [("DLC_resnet50", name, kind) for name in JOINTS for kind in ("x", "y", "likelihood")]
    columns = pandas.MultiIndex.from_tuples(names, names=["scorer", "bodyparts", "coords"])
    frame = pandas.DataFrame(np.nan_to_num(points).reshape(FRAMES, -1), columns=columns)
    frame.to_hdf(folder / "camDLC.h5", key="df_with_missing", format="table", mode="w")
    return folder / "camDLC.h5"


def sleap_h5(folder: Path, points: Floats[F, D21, D3]) -> Path:
    import h5py  # pyright: ignore[reportMissingImports]

    with h5py.File(folder / "analysis.h5", "w") as file:
        file["tracks"] = points[None, :, :, :2].transpose(0, 3, 2, 1)
        file["point_scores"] = points[None, :, :, 2].transpose(0, 2, 1)
        file["node_names"] = np.array([name.encode() for name in JOINTS])
        file["track_names"] = np.array([b"track_0"])
        file["track_occupancy"] = np.ones((FRAMES, 1), np.uint8)
    return folder / "analysis.h5"


def _json(path: Path, value: Any) -> Path:
    path.write_text(json.dumps(value))
    return path


def _csv(path: Path, rows: list[list[Any]]) -> Path:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(
            [["" if isinstance(v, float) and np.isnan(v) else v for v in row] for row in rows]
        )
    return path


def wide_csv(folder: Path, points: Floats[F, D21, D3]) -> Path:
    """A row a frame with columns h0_x0, h0_y0 …, and a second hand that is nowhere."""
    head = [f"h{h}_{axis}{i}" for h in (0, 1) for i in range(21) for axis in "xyz"]
    rows = [",".join(["frame", *head])]
    for frame, hand_ in enumerate(points):
        numbers = [f"{v:.6g}" for row in hand_[:, :2] for v in (*row, 0.0)]
        rows.append(",".join([str(frame), *numbers, *[""] * 63]))
    (folder / "wide.csv").write_text("\n".join(rows))
    return folder / "wide.csv"


def timestamp_csv(folder: Path, points: Floats[F, D21, D3]) -> Path:
    rows = ["timestamp,hand,x,y,z"]
    for frame, hand_ in enumerate(points):
        rows += [f"{12.5 + frame / 30:.4f},,{x},{y},0" for x, y in hand_[:, :2]]
    (folder / "stamped.csv").write_text("\n".join(rows))
    return folder / "stamped.csv"


def json_lines(folder: Path, points: Floats[F, D21, D3]) -> Path:
    lines = [
        json.dumps({"frame": frame, "landmarks": {"Right": {a: {str(i): hand_[i, k] for i in range(21)} for k, a in enumerate("xy")}}})
        for frame, hand_ in enumerate(points)
    ]  # fmt: skip
    (folder / "lines.jsonl").write_text("\n".join(lines))
    return folder / "lines.jsonl"


WITH_CONFIDENCE: dict[str, Callable[[Path, Floats[F, D21, D3]], Path]] = {
    "openpose": openpose, "mmpose": mmpose, "mmpose from one": mmpose_from_one, "coco": coco_annotations,
    "deeplabcut csv": deeplabcut_csv, "deeplabcut h5": deeplabcut_h5, "sleap h5": sleap_h5,
}  # fmt: skip
WITHOUT: dict[str, Callable[[Path, Floats[F, D21, D3]], Path]] = {
    "mediapipe": mediapipe_tasks, "mediapipe legacy": mediapipe_legacy, "mediapipe long csv": mediapipe_long_csv,
    "mediapipe wide csv": mediapipe_wide_csv, "numbered csv": numbered_csv, "h0_x0 csv": wide_csv,
    "time stamps": timestamp_csv, "json lines": json_lines,
}  # fmt: skip
LIBRARIES = {"deeplabcut h5": ("h5py", "pandas", "tables"), "sleap h5": ("h5py",)}
