"""Keypoints in space in the orders of OpenPose (hands 21, bodies BODY_25) and MediaPipe (21, 33), all frames in one file; and `.pose` of pose-format."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import D3, F, Floats, K
from handtrack.capture.images.openpose import LAYOUTS
from handtrack.errors import HandtrackError
from handtrack.export.table import ResultsTable
from handtrack.files.atomic import replace_text, replacing
from handtrack.model.articulated import keypoint_names
from handtrack.tracking.frame.result import joint_confidence


def _detectors_points(layout: str, others: str) -> tuple[str, ...]:
    """Return a detector's points in its order, by our joints' names; those that a model lacks have confidence 0.

    others: of those that no model of ours has, in this order.
    """
    known, unknown = (
        {row: name for name, row in LAYOUTS[layout].points.items()},
        iter(others.split()),
    )
    return tuple(known.get(row) or next(unknown) for row in range(LAYOUTS[layout].count))


BODY_25 = _detectors_points(
    "body_25",
    "right_eye left_eye right_ear left_ear left_small_toe left_heel right_small_toe right_heel",
)


def write(path: Path, table: ResultsTable) -> None:
    """Write `{"frames": [{"frame", "time_s", "people": [{"hand_right_keypoints_3d": [x, y, z, confidence, …]}]}]}`, in metres of
    the world. Each frame's `people` is as in OpenPose's own files, of which there is one a frame. Raises HandtrackError for a
    skeleton of the user's own.
    """
    people, names = _people(table)
    _write(path, table, {"version": 1.3}, names, [{"people": those} for those in people])


def _write(
    path: Path,
    table: ResultsTable,
    head: dict[str, Any],
    names: tuple[str, ...],
    frames: list[dict[str, Any]],
) -> None:
    """Write all frames to one file. frames: what stands in each beside its number and time."""
    track = table.track
    rows = [
        {"frame": int(frame), "time_s": float(time_s), **own}
        for frame, time_s, own in zip(track.frame, track.time_s, frames, strict=True)
    ]
    entry = {**head, "unit": "m", "names": list(names)}
    entry |= {"keypoint_definition": table.keypoint_definition, "frames": rows}
    replace_text(path, json.dumps(entry) + "\n")


def write_files(path: Path, table: ResultsTable) -> None:
    """Write a ZIP of `STEM_000000000003_keypoints.json`, a file a frame with all keys of OpenPose's, as `--write_json` does.

    What was not tracked is an empty list, as there. Raises HandtrackError for a skeleton of the user's own.
    """
    parts = ("pose", "face", "hand_left", "hand_right")
    blank = {f"{part}_keypoints_{n}d": [] for n in (2, 3) for part in parts}
    people, _ = _people(table)
    with replacing(path) as draft, zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED) as archive:
        for frame, those in zip(table.track.frame, people, strict=True):
            entry = {"version": 1.3, "people": [{**blank, **person} for person in those]}
            name = f"{path.stem}_{int(frame):012d}_keypoints.json"
            archive.writestr(zipfile.ZipInfo(name), json.dumps(entry))


def _people(table: ResultsTable) -> tuple[list[list[dict[str, Any]]], tuple[str, ...]]:
    """Return the people of each frame in OpenPose's words, none where the pose is lost, and the points' names."""
    names, points, sure = _ordered_points(table, BODY_25)
    key = f"{'pose' if names is BODY_25 else f'hand_{table.track.side}'}_keypoints_3d"
    rows = np.concatenate([points, sure[..., None]], axis=2)
    people = [
        [] if lost else [{"person_id": [-1], key: [round(float(x), 6) for x in row.ravel()]}]
        for lost, row in zip(table.is_lost, rows, strict=True)
    ]
    return people, names


def _ordered_points(
    table: ResultsTable, of_body: tuple[str, ...]
) -> tuple[tuple[str, ...], Floats[F, K, D3], Floats[F, K]]:
    """Return the names of a hand's keypoints, or those given of a body; joints in this order [m], and confidences; zeros, with
    confidence 0, where there is no such joint. Raises HandtrackError for a skeleton that is neither.
    """
    names = of_body if _is_body(table) else keypoint_names()
    track, sure = table.track, joint_confidence(table.track)
    points, known = np.zeros((len(track), len(names), 3)), np.zeros((len(track), len(names)))
    for k, name in enumerate(names):
        if name in track.joint_names:
            joint = track.joint_names.index(name)
            points[:, k], known[:, k] = track.joint_positions[:, joint], sure[:, joint]
    return names, points, known


def _is_body(table: ResultsTable) -> bool:
    """Return whether a sequence is of a body. Raises HandtrackError where it is neither that nor a whole hand."""
    joints = table.track.joint_names
    if set(keypoint_names()) <= set(joints):
        return False
    if {"left_shoulder", "right_hip", "left_knee"} <= set(joints):
        return True
    raise HandtrackError(
        f"{table.source}: the model '{table.track.model}' is neither a whole hand nor a body, whose points this format lists; "
        f"its joints: {', '.join(joints)}. Choose csv, trc, c3d, anipose or netcdf, which take any joints."
    )


# ---- MediaPipe's landmarks in space as JSON: hands of 21, bodies of 33; all frames in one file


POSE_33 = _detectors_points(
    "mediapipe33",
    "left_eye_inner left_eye left_eye_outer right_eye_inner right_eye right_eye_outer left_ear right_ear mouth_left mouth_right "
    "left_thumb right_thumb left_heel right_heel",
)
"""`left_toe` is its left_foot_index"""


def write_mediapipe(path: Path, table: ResultsTable) -> None:
    """Write `{"frames": [{"frame", "time_s", "hand_world_landmarks": [[{x, y, z, visibility} …]], "handedness": [[…]]}]}`, of a
    body `pose_world_landmarks`; in metres of the world, where MediaPipe has them from the hand's middle. Lists of lost frames
    are empty. Raises HandtrackError for a skeleton of the user's own.
    """
    names, points, sure = _ordered_points(table, POSE_33)
    body = names is POSE_33
    key = "pose_world_landmarks" if body else "hand_world_landmarks"
    side = table.track.side.capitalize()
    frames: list[dict[str, Any]] = []
    for row, lost in enumerate(table.is_lost):
        marks = [
            {**dict(zip("xyz", (round(float(x), 6) for x in point))), "visibility": float(seen)}
            for point, seen in zip(points[row], sure[row], strict=True)
        ]
        frame: dict[str, Any] = {key: [] if lost else [marks]}
        if not body:
            frame["handedness"] = [] if lost else [[{"category_name": side, "score": 1.0}]]
        frames.append(frame)
    _write(path, table, {}, names, frames)


# ---- `.pose` of pose-format, in which sign language research keeps skeletons: MediaPipe's points in space


_MM = 1e3
_HAND = [(0, 1), *((i, i + 1) for i in range(1, 20) if i % 4), *((0, i) for i in (5, 9, 13, 17))]
_BODY = [
    (11, 12),
    (11, 13),
    (13, 15),
    (12, 14),
    (14, 16),
    (11, 23),
    (12, 24),
    (23, 24),
    (23, 25),
    (25, 27),
    (24, 26),
    (26, 28),
]
_MEDIAPIPE = {
    "index": "index_finger",
    "middle": "middle_finger",
    "ring": "ring_finger",
    "little": "pinky",
}


def write_pose(path: Path, table: ResultsTable) -> None:
    """Write one component, RIGHT_HAND_LANDMARKS, LEFT_HAND_LANDMARKS or POSE_WORLD_LANDMARKS, with confidence; in millimetres of
    the world. Lost frames are masked. Raises HandtrackError for a skeleton of the user's own.
    """
    from pose_format import Pose  # type: ignore[import]
    from pose_format.numpy import NumPyPoseBody  # type: ignore[import]
    from pose_format.pose_header import (  # type: ignore[import]
        PoseHeader,
        PoseHeaderComponent,
        PoseHeaderDimensions,
    )

    names, points, sure = _ordered_points(table, POSE_33)
    body = names is POSE_33
    sure = np.where(table.is_lost[:, None], 0.0, sure)
    said = [name.upper() for name in names]
    if not body:
        parts = [name.partition("_") for name in names]
        said = [f"{_MEDIAPIPE.get(a, a)}{b}{c}".upper() for a, b, c in parts]
    kind = "POSE_WORLD" if body else f"{table.track.side.upper()}_HAND"
    limbs = _BODY if body else _HAND
    component = PoseHeaderComponent(f"{kind}_LANDMARKS", said, limbs, [(0, 110, 180)], "XYZC")
    extent = _MM * np.ptp(points[sure > 0], axis=0) if (sure > 0).any() else np.ones(3)
    header = PoseHeader(
        0.2, PoseHeaderDimensions(*np.ceil(extent).astype(int).tolist()), [component]
    )
    data = (_MM * points)[:, None].astype(np.float32)
    pose = Pose(header, NumPyPoseBody(table.fps, data, sure[:, None].astype(np.float32)))
    with replacing(path) as draft, draft.open("wb") as file:
        pose.write(file)
