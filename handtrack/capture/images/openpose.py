"""2D joints in OpenPose's JSON files, one a frame, several people in it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import D3, Floats, K
from handtrack.errors import HandtrackError
from handtrack.files.atomic import replace_text
from handtrack.files.text_files import read_json


@dataclass(frozen=True)
class Layout:
    """Which of a detector's points are which joints."""

    keys: tuple[str, ...]
    """of the numbers in the file: one of them"""
    count: int
    points: Mapping[str, int]
    """joint name → row"""


def _body(count: int, left: Sequence[int], right: Sequence[int], **middle: int) -> Layout:
    """left, right: rows of the joints of `_PAIRS`, as many as there are."""
    sides = {"left": left, "right": right}.items()
    paired = {f"{side}_{joint}": row for side, rows in sides for joint, row in zip(_PAIRS, rows)}
    return Layout(_BODY, count, middle | paired)


_BODY = ("pose_keypoints_2d",)
_PAIRS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "toe", "index", "pinky")
_LIMBS = ("shoulder", "elbow", "wrist", "hand", "hip", "knee", "ankle", "toe")
_BODY_JOINTS = (
    *("pelvis", "chest", "neck", "head", "nose", "head_top"),
    *(f"{side}_{joint}" for side in ("left", "right") for joint in _LIMBS),
)
"""joints that have names in use: what named points are written as"""
_LEFT, _RIGHT = "hand_left_keypoints_2d", "hand_right_keypoints_2d"
FINGERS = {
    "thumb": ("cmc", "mcp", "ip", "tip"),
    **dict.fromkeys(("index", "middle", "ring", "little"), ("mcp", "pip", "dip", "tip")),
}
_JOINTS = (
    "wrist",
    *(f"{finger}_{joint}" for finger, joints in FINGERS.items() for joint in joints),
)
_HAND = {joint: row for row, joint in enumerate(_JOINTS)}
_COCO = (5, 7, 9, 11, 13, 15), (6, 8, 10, 12, 14, 16)
LAYOUTS: dict[str, Layout] = {
    "body_25": _body(
        25, (5, 6, 7, 12, 13, 14, 19), (2, 3, 4, 9, 10, 11, 22), nose=0, neck=1, pelvis=8
    ),
    "body_25b": _body(25, (*_COCO[0], 19), (*_COCO[1], 22), nose=0, neck=17, head_top=18),
    "coco18": _body(18, (5, 6, 7, 11, 12, 13), (2, 3, 4, 8, 9, 10), nose=0, neck=1),
    "coco17": _body(17, *_COCO, nose=0),
    "halpe26": _body(26, (*_COCO[0], 20), (*_COCO[1], 21), nose=0, head_top=17, neck=18, pelvis=19),
    "coco133": _body(133, (*_COCO[0], 17, 96, 108), (*_COCO[1], 20, 117, 129), nose=0),
    "mediapipe33": _body(
        33, (11, 13, 15, 23, 25, 27, 31, 19, 17), (12, 14, 16, 24, 26, 28, 32, 20, 18), nose=0
    ),
    "body22": Layout(_BODY, 22, {name: row for row, name in enumerate(_BODY_JOINTS)}),
    "hand_left": Layout((_LEFT,), 21, _HAND),
    "hand_right": Layout((_RIGHT,), 21, _HAND),
    "mediapipe21": Layout((_RIGHT, _LEFT), 21, _HAND),
}


def landmark_definition(layout: str) -> str:
    """Return by what name a detector's points go, wherever in a file they stand: `openpose21` for hands of OpenPose's files."""
    return "openpose21" if layout in ("hand_left", "hand_right") else layout


def is_body(layout: Layout) -> bool:
    """Return whether a layout is a body's, not a hand's."""
    return layout.keys == _BODY


def read_openpose(path: Path, layout: Layout) -> Floats[K, D3] | None:
    """Return column and row [px] and confidence of the person who stands tallest in the image.

    Points that were not found are NaN with confidence 0. None when nobody was found. Raises HandtrackError.
    """
    people = []
    for number, person in enumerate(_read(path)):
        key, values = _values(person, layout, f"{path}: person {number}")
        if len(values):
            people.append(_points(values, layout.count, f"{path}: '{key}' of person {number}"))
    return max((person for person in people if person is not None), key=height, default=None)


def height(points: Floats[K, D3]) -> float:
    """Return how many pixels a person's points reach from the highest to the lowest."""
    rows = points[np.isfinite(points[:, 1]), 1]
    return float(np.ptp(rows)) if len(rows) else 0.0


def _points(values: Sequence[Any], count: int, who: str) -> Floats[K, D3] | None:
    """Return (count, 3); None where no point was found. Raises HandtrackError for other numbers."""
    if len(values) != 3 * count or not all(isinstance(v, (int, float)) for v in values):
        raise HandtrackError(
            f"{who} has {len(values)} values; expected {count} times x, y, confidence."
        )
    points = np.array(values, dtype=float).reshape(count, 3)
    missing = ~np.isfinite(points).all(axis=1) | (points[:, 2] <= 0)
    points[missing] = (np.nan, np.nan, 0.0)
    return None if missing.all() else points


def _values(person: Any, layout: Layout, who: str) -> tuple[str, Sequence[Any]]:
    """Return the key and the numbers of a person; none where this person has none."""
    known = (
        {k: person[k] for k in layout.keys if k in person} if isinstance(person, Mapping) else {}
    )
    filled = [key for key, values in known.items() if values]
    if not known:
        raise HandtrackError(
            f"{who} has no '{layout.keys[0]}'. Another keypoint_layout may fit: {', '.join(LAYOUTS)}."
        )
    if len(filled) > 1:
        raise HandtrackError(
            f"{who} has two hands, {' and '.join(filled)}; expected one. Say which by keypoint_layout: hand_left or hand_right."
        )
    key = (filled or list(known))[0]
    return key, known[key]


def write_points(path: Path, points: Floats[K, D3] | None, layout: Layout, writer: str) -> None:
    """Write one hand's or person's points, or that none was found, as OpenPose does.

    Parameters
    ----------
    points
        Column and row [px], confidence; where that is 0 the point counts as missing.
    writer
        A mark that `written_by` finds again.
    """
    people = []
    if points is not None:
        rows = np.where(points[:, 2:] > 0, points, 0.0)
        numbers = [round(float(value), 4) for value in rows.reshape(-1)]
        people = [{layout.keys[0]: numbers}]
    table = {"version": 1.3, "writer": writer, "people": people}
    replace_text(path, json.dumps(table) + "\n")


def written_by(path: Path) -> str | None:
    """Return the mark that `write_points` left in a file; None in files of others, and in what cannot be read."""
    try:
        table = read_json(path, "joints")
    except HandtrackError:
        return None
    return table.get("writer") if isinstance(table, Mapping) else None


def _read(path: Path) -> Sequence[Any]:
    table = read_json(path, "joints as OpenPose writes them")
    people = table.get("people") if isinstance(table, Mapping) else None
    if not isinstance(people, list):
        raise HandtrackError(f"{path}: no list 'people'; expected a file as OpenPose writes it.")
    return people
