"""Joints in JSON: MediaPipe's results, COCO-WholeBody as RTMPose and MMPose write it, OpenPose."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.capture.images.frames import frame_number
from handtrack.capture.images.openpose import LAYOUTS, body_points, read_openpose
from handtrack.capture.joints.given_joints import (
    HANDS_IN,
    BodyPoints,
    Hand,
    ImportedJoints,
    checked_bodies,
    cleaned,
    frame_of,
    side_in,
)
from handtrack.capture.joints.joint_names import BODY_LAYOUTS, JOINTS
from handtrack.errors import HandtrackError
from handtrack.files.text_files import read_text

_MEDIAPIPE = (
    "hand_landmarks",
    "handLandmarks",
    "landmarks",
    "multi_hand_landmarks",
    "multiHandLandmarks",
)
_POSE = ("pose_landmarks", "poseLandmarks")
_POSE_POINTS = BODY_LAYOUTS["mediapipe33"].count
_SIDES = ("handedness", "handednesses", "multi_handedness", "multiHandedness")
_WHOLE = BODY_LAYOUTS["coco133"].count
_BODY_OF_WHOLE = BODY_LAYOUTS["coco17"].count
_KEYS = {"lefthand_kpts": "left", "righthand_kpts": "right", "keypoints": ""}
"""of a person's points, and whose hand they are alone"""
_MIRRORED = {"left": "right", "right": "left"}


def read_json_joints(tree: Any, where: str) -> ImportedJoints | None:
    """Return the joints of one JSON file of all frames; None for other files. Raises HandtrackError."""
    frames = [(number, _by_side(entry)) for number, entry in _frames(tree, where)]
    is_mediapipe = any(
        isinstance(entry.get(key), list | Mapping)
        for _, entry in frames
        for key in (*_MEDIAPIPE, *_POSE)
    )
    numbers = sorted({frame for frame, _ in frames})
    is_numbered = not is_mediapipe and any("frame_id" in entry for _, entry in frames)
    first = int(is_numbered and numbers == list(range(1, len(numbers) + 1)))  # as MMPose's demos
    hands: dict[str, dict[int, Hand]] = {}
    people: dict[int, list[BodyPoints]] = {}
    any_found = False
    for frame, entry in frames:
        for side, points in _detected(entry, f"{where}: frame {frame}"):
            any_found = True
            for part, rows in HANDS_IN.get(len(points), {}).items():
                own, hand = hands.setdefault(side or part, {}), points[list(rows)]
                before = own[frame - first][:, 2].sum() if frame - first in own else 0.0
                if hand[:, 2].sum() > before:
                    own[frame - first] = hand
            body = points[: _BODY_OF_WHOLE if len(points) == _WHOLE else None]
            if len(points) != len(JOINTS) and (body[:, 2] > 0).any():
                people.setdefault(frame - first, []).append(points)
    if is_mediapipe:
        notes = ()
        if len(hands) == 1:  # what MediaPipe says of a single hand is not needed
            hands = {"": hands.popitem()[1]}
        elif hands:
            hands = {_MIRRORED.get(side, side): found for side, found in hands.items()}
            notes = (
                "MediaPipe names hands as in a mirror: of images that are not mirrored, its 'Left' is the right hand.",
            )
        bodies = checked_bodies(people, where, "mediapipe33")
        return ImportedJoints("MediaPipe's JSON", hands, "mediapipe21", (), notes, bodies)
    if not any_found:
        return None
    notes = (f"{where}: frames are counted from 1 there, here from 0.",)[:first]
    bodies = checked_bodies(people, where)
    whole = bodies is None or bodies.count == _WHOLE
    family = "COCO-WholeBody as RTMPose writes it" if whole else "COCO's JSON"
    return ImportedJoints(family, hands, notes=notes, bodies=bodies)


def _frames(tree: Any, where: str) -> Iterator[tuple[int, Mapping[str, Any]]]:
    """Yield every frame's number and what is there: from a list of frames, or a mapping by frame number."""
    if isinstance(tree, Mapping) and isinstance(tree.get("annotations"), list):
        files = {
            i.get("id"): i.get("file_name")
            for i in tree.get("images", [])
            if isinstance(i, Mapping)
        }
        for entry in tree["annotations"]:
            if isinstance(entry, Mapping):
                name = files.get(entry.get("image_id"))
                yield frame_number(name) if name else _number(entry, 0, where), entry
        return
    if isinstance(tree, Mapping):
        keys = ("frames", "instance_info", "results", "predictions")
        tree = next((tree[key] for key in keys if key in tree), tree)
    if isinstance(tree, Mapping) and all(str(key).isdecimal() for key in tree):
        tree = [{"frame": int(key), **_table(entry)} for key, entry in tree.items()]
    for i, entry in enumerate(tree if isinstance(tree, list) else ()):
        yield _number(_table(entry), i, where), _table(entry)


def _table(entry: Any) -> Mapping[str, Any]:
    """Return a frame's entry; one that is no mapping is the list of its people."""
    return entry if isinstance(entry, Mapping) else {"instances": entry}


def _number(entry: Mapping[str, Any], otherwise: int, where: str) -> int:
    for key in ("frame", "frame_id", "frame_index", "frame_number", "frameIndex", "image_id"):
        value = entry.get(key)
        if isinstance(value, int | float):
            return frame_of(value, where)
        if isinstance(value, str) and re.search(r"\d", value):
            return frame_number(value)
    return otherwise


def _by_side(entry: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a frame whose landmarks stand by side, each as columns of numbers by point, as MediaPipe writes a frame."""
    sides = entry.get("landmarks")
    if (
        not isinstance(sides, Mapping)
        or not sides
        or not all(str(k).lower() in _MIRRORED for k in sides)
    ):
        return entry
    hands = [_in_rows(hand) for hand in sides.values()]
    return {**entry, "landmarks": hands, "handedness": [str(side) for side in sides]}


def _in_rows(hand: Any) -> Any:
    if not isinstance(hand, Mapping) or not all(
        isinstance(hand.get(k), Mapping | list) for k in "xy"
    ):
        return hand
    columns = [list(hand[k].values()) if isinstance(hand[k], Mapping) else hand[k] for k in "xy"]
    return [list(row) for row in zip(*columns, strict=False)]


def _detected(entry: Mapping[str, Any], where: str) -> Iterator[tuple[str, BodyPoints]]:
    """Yield the hands and bodies of a frame, each with the side that stands with it."""
    said = next((entry[k] for k in _SIDES if k in entry), [])
    labels = [side_in(str(one)) for one in (said if isinstance(said, list) else [said])]
    for keys in (_MEDIAPIPE, _POSE):
        for i, one in enumerate(_lists(next((entry[k] for k in keys if k in entry), []))):
            is_pose = isinstance(one, list) and len(one) == _POSE_POINTS
            sure = [p.get("visibility", 1.0) if isinstance(p, Mapping) else 1.0 for p in one]
            points = _points(one, sure if is_pose else 1.0, where)
            if len(points) not in (len(JOINTS), _POSE_POINTS):
                raise HandtrackError(
                    f"{where}: a hand of {len(points)} landmarks; expected {len(JOINTS)}."
                )
            yield labels[i] if i < len(labels) and not is_pose else "", points
    inner = entry.get("instances", entry.get("people", entry.get("predictions")))
    for person in (entry, *(inner if isinstance(inner, list) else ())):
        for key, side in _KEYS.items() if isinstance(person, Mapping) else ():
            if key in person:
                sure = None if side else person.get("keypoint_scores", person.get("scores"))
                points = _points(person[key], sure, where)
                if not side or len(points) == len(JOINTS):
                    yield side, points


def _lists(found: Any) -> list[Any]:
    """Return the hands, or people, of a frame as lists of points: of a list of them, of one, or of one's points."""
    several = found if isinstance(found, list) else [found]
    people = [
        one.get("landmark", one.get("landmarks", one)) if isinstance(one, Mapping) else one
        for one in several
    ]
    lists = [one for one in people if isinstance(one, list) and one]
    lists = [one for one in lists if isinstance(one[0], list | Mapping) or len(one) > 4]
    return lists or ([found] if isinstance(found, list) and found else [])


def _points(values: Any, scores: Any, where: str) -> BodyPoints:
    """Return points from N times x, y, or flat x, y, confidence where no scores stand beside.

    scores: one a point, or one number for all.
    """
    try:
        if isinstance(values, list) and values and isinstance(values[0], Mapping):
            places = [point.get("position", point) for point in values]  # TensorFlow.js
            scores = [point.get("score", 1.0) for point in values] if scores is None else scores
            values = [[place["x"], place["y"]] for place in places]
        array = np.array(values, dtype=float)
        if array.ndim == 1:
            array = array.reshape(-1, 3 if scores is None else 2)
        array = array.reshape(len(array), -1)
        if scores is None:
            scores = array[:, 2] if array.shape[1:] == (3,) else 1.0
        sure = np.array(scores, float).ravel()
        sure = np.full(len(array), sure) if isinstance(scores, float) else sure
    except (TypeError, ValueError, KeyError, AttributeError, OverflowError):
        raise HandtrackError(f"{where}: points that are no numbers x, y, confidence.") from None
    if array.shape[1] < 2 or len(sure) != len(array):
        raise HandtrackError(
            f"{where}: {len(array)} keypoints with {len(sure)} scores; expected as many."
        )
    return cleaned(np.column_stack([array[:, :2], sure]))


# ---- OpenPose


def read_openpose_files(files: Mapping[int, Path]) -> ImportedJoints:
    """Return the hands and bodies of OpenPose's files by frame. Raises HandtrackError for a first file that is none."""
    hands: dict[str, dict[int, Hand]] = {"left": {}, "right": {}}
    people: dict[int, list[BodyPoints]] = {}
    first = next(iter(files))
    for frame, path in files.items():
        try:
            people[frame] = body_points(path)
        except HandtrackError:
            if frame == first:
                raise
        for side, found in hands.items():
            layout = LAYOUTS[f"hand_{side}"]
            try:
                points = read_openpose(path, layout)
            except HandtrackError:
                if frame == first and layout.keys[0] in read_text(path, "joints"):
                    raise
                continue
            if points is not None:
                found[frame] = points
    where = str(files[first].parent)
    return ImportedJoints("OpenPose's JSON", hands, bodies=checked_bodies(people, where))
