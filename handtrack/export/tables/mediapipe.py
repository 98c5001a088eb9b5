"""MediaPipe's landmarks in space as JSON: hands of 21, bodies of 33; all frames in one file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from handtrack.export.table import ResultsTable
from handtrack.export.tables.openpose import is_body, ordered_points
from handtrack.files.atomic import replace_text
from handtrack.model.articulated import keypoint_names

POSE_33 = (
    "nose", "left_eye_inner", "left_eye", "left_eye_outer", "right_eye_inner", "right_eye", "right_eye_outer",
    "left_ear", "right_ear", "mouth_left", "mouth_right", "left_shoulder", "right_shoulder", "left_elbow",
    "right_elbow", "left_wrist", "right_wrist", "left_pinky", "right_pinky", "left_index", "right_index",
    "left_thumb", "right_thumb", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
    "left_heel", "right_heel", "left_toe", "right_toe",
)  # fmt: skip
"""MediaPipe's points of a body in its order (`left_toe` is its left_foot_index); those that a model lacks have visibility 0"""


def write(path: Path, table: ResultsTable) -> list[Path]:
    """Write `{"frames": [{"frame", "time_s", "hand_world_landmarks": [[{x, y, z, visibility} …]], "handedness": [[…]]}]}`, of a
    body `pose_world_landmarks`; in metres of the world, where MediaPipe has them from the hand's middle. Lists of lost frames
    are empty. Raises HandtrackError for a skeleton of the user's own.
    """
    body = is_body(table)
    names = POSE_33 if body else keypoint_names()
    key = "pose_world_landmarks" if body else "hand_world_landmarks"
    points, sure = ordered_points(table, names)
    track, side = table.track, table.track.side.capitalize()
    frames: list[dict[str, Any]] = []
    for row, lost in enumerate(table.is_lost):
        marks = [
            {**dict(zip("xyz", (round(float(x), 6) for x in point))), "visibility": float(seen)}
            for point, seen in zip(points[row], sure[row], strict=True)
        ]
        frame: dict[str, Any] = {"frame": int(track.frame[row]), "time_s": float(track.time_s[row])}
        frame[key] = [] if lost else [marks]
        if not body:
            frame["handedness"] = [] if lost else [[{"category_name": side, "score": 1.0}]]
        frames.append(frame)
    told: dict[str, Any] = {"unit": "m", "names": list(names)}
    told |= {"keypoint_definition": table.keypoint_definition, "frames": frames}
    replace_text(path, json.dumps(told) + "\n")
    return [path]
