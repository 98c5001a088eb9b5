"""OpenPose's JSON with keypoints in space: hands of 21, bodies as BODY_25; all frames in one file."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import D3, F, Floats, K
from handtrack.errors import HandtrackError
from handtrack.export.table import ResultsTable
from handtrack.files.atomic import replace_text, replacing
from handtrack.model.articulated import keypoint_names
from handtrack.tracking.frame.tables.labelled import joint_confidence

BODY_25 = (
    "nose", "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist",
    "pelvis", "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle", "right_eye", "left_eye",
    "right_ear", "left_ear", "left_toe", "left_small_toe", "left_heel", "right_toe", "right_small_toe", "right_heel",
)  # fmt: skip
"""OpenPose's points in its order, by our joints' names; those that a model lacks have confidence 0"""


def write(path: Path, table: ResultsTable) -> list[Path]:
    """Write `{"frames": [{"frame", "time_s", "people": [{"hand_right_keypoints_3d": [x, y, z, confidence, …]}]}]}`, in metres of
    the world. Each frame's `people` is as in OpenPose's own files, of which there is one a frame. Raises HandtrackError for a
    skeleton of the user's own.
    """
    people, names = _people(table)
    track = table.track
    frames = [
        {"frame": int(frame), "time_s": float(time_s), "people": those}
        for frame, time_s, those in zip(track.frame, track.time_s, people, strict=True)
    ]
    told: dict[str, Any] = {"version": 1.3, "unit": "m", "names": list(names)}
    told |= {"keypoint_definition": table.keypoint_definition, "frames": frames}
    replace_text(path, json.dumps(told) + "\n")
    return [path]


def write_files(path: Path, table: ResultsTable) -> list[Path]:
    """Write a ZIP of `STEM_000000000003_keypoints.json`, a file a frame with all keys of OpenPose's, as `--write_json` does.

    What was not tracked is an empty list, as there. Raises HandtrackError for a skeleton of the user's own.
    """
    parts = ("pose", "face", "hand_left", "hand_right")
    blank = {f"{part}_keypoints_{n}d": [] for n in (2, 3) for part in parts}
    people, _ = _people(table)
    with replacing(path) as draft, zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED) as archive:
        for frame, those in zip(table.track.frame, people, strict=True):
            told = {"version": 1.3, "people": [{**blank, **person} for person in those]}
            name = f"{path.stem}_{int(frame):012d}_keypoints.json"
            archive.writestr(zipfile.ZipInfo(name), json.dumps(told))
    return [path]


def _people(table: ResultsTable) -> tuple[list[list[dict[str, Any]]], tuple[str, ...]]:
    """Return the people of each frame in OpenPose's words, none where the pose is lost, and the points' names."""
    key, names = _layout(table)
    points, sure = ordered_points(table, names)
    rows = np.concatenate([points, sure[..., None]], axis=2)
    people = [
        [] if lost else [{"person_id": [-1], key: [round(float(x), 6) for x in row.ravel()]}]
        for lost, row in zip(table.is_lost, rows, strict=True)
    ]
    return people, names


def ordered_points(
    table: ResultsTable, names: tuple[str, ...]
) -> tuple[Floats[F, K, D3], Floats[F, K]]:
    """Return joints by names in another order [m], and confidences; zeros, with confidence 0, where there is no such joint."""
    track, sure = table.track, joint_confidence(table.track)
    points, known = np.zeros((len(track), len(names), 3)), np.zeros((len(track), len(names)))
    for k, name in enumerate(names):
        if name in track.joint_names:
            joint = track.joint_names.index(name)
            points[:, k], known[:, k] = track.joint_positions[:, joint], sure[:, joint]
    return points, known


def is_body(table: ResultsTable) -> bool:
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


def _layout(table: ResultsTable) -> tuple[str, tuple[str, ...]]:
    if is_body(table):
        return "pose_keypoints_3d", BODY_25
    return f"hand_{table.track.side}_keypoints_3d", keypoint_names()
