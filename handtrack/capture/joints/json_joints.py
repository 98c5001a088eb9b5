"""Joints in JSON: MediaPipe's results, COCO-WholeBody as RTMPose and MMPose write it, OpenPose."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import Floats
from handtrack.capture.images.frames import frame_number
from handtrack.capture.images.openpose import LAYOUTS, body_points, read_openpose
from handtrack.capture.joints.given_joints import (
    BodyPoints,
    Hand,
    ImportedJoints,
    checked_bodies,
    cleaned,
    frame_of,
    hand_of,
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
_WHOLE_BODY = {_WHOLE: {"left": 91, "right": 112}, 21: {"": 0}}
"""by how many points a person has: where the hands' 21 begin"""
_MIRRORED = {"left": "right", "right": "left"}


def read_json_joints(tree: Any, where: str) -> ImportedJoints | None:
    """Return the joints of one JSON file of all frames; None for other files. Raises HandtrackError."""
    frames = [(number, _by_side(entry)) for number, entry in _frames(tree, where)]
    if any(_landmarks(entry) is not None or _pose(entry) for _, entry in frames):
        return _mediapipe(frames, where)
    people = [(frame, person) for frame, entry in frames for person in _people(entry)]
    return _whole_body(people, frames, where) if people else None


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


# ---- MediaPipe


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


def _landmarks(entry: Mapping[str, Any]) -> list[Any] | None:
    found = next((entry[k] for k in _MEDIAPIPE if k in entry), None)
    return found if isinstance(found, list) else None


def _mediapipe(frames: list[tuple[int, Mapping[str, Any]]], where: str) -> ImportedJoints:
    hands: dict[str, dict[int, Hand]] = {}
    notes = ()
    for frame, entry in frames:
        labels = _labels(entry)
        for i, points in enumerate(_lists(_landmarks(entry) or [], len(JOINTS))):
            if len(points) == _POSE_POINTS:
                continue
            places, _ = _points(points, 1.0, f"{where}: frame {frame}")
            if len(places) != len(JOINTS):
                raise HandtrackError(
                    f"{where}: frame {frame}: a hand of {len(places)} landmarks; expected {len(JOINTS)}."
                )
            said = labels[i] if i < len(labels) else ""
            hand = hand_of(JOINTS, places, np.ones(len(JOINTS)))
            hands.setdefault(said, {}).setdefault(frame, hand)
    if len(hands) == 1:  # what MediaPipe says of a single hand is not needed
        hands = {"": next(iter(hands.values()))}
    else:
        hands = {_MIRRORED.get(side, side): found for side, found in hands.items()}
        notes = (
            "MediaPipe names hands as in a mirror: of images that are not mirrored, its 'Left' is the right hand.",
        )
    people = {
        frame: [_pose_person(one, f"{where}: frame {frame}") for one in _pose(entry)]
        for frame, entry in frames
    }
    bodies = checked_bodies(people, where, "mediapipe33")
    return ImportedJoints("MediaPipe's JSON", hands, "mediapipe21", (), notes, bodies)


def _pose(entry: Mapping[str, Any]) -> list[Any]:
    """Return the people of a frame, each a list of MediaPipe's 33 points."""
    found = next((entry[k] for k in (*_POSE, *_MEDIAPIPE) if isinstance(entry.get(k), list)), [])
    if isinstance(entry.get(_POSE[0]), Mapping):
        found = [entry[_POSE[0]]]
    return [
        one
        for one in _lists(found, _POSE_POINTS)
        if isinstance(one, list) and len(one) == _POSE_POINTS
    ]


def _pose_person(points: list[Any], where: str) -> BodyPoints:
    sure = [p.get("visibility", 1.0) if isinstance(p, Mapping) else 1.0 for p in points]
    return cleaned(np.column_stack(_points(points, sure, where)))


def _lists(found: list[Any], count: int) -> list[Any]:
    """Return the hands, or people, of a frame: a list of lists of points, or of the `count` points of one."""
    hands = [
        hand.get("landmark", hand.get("landmarks", hand)) if isinstance(hand, Mapping) else hand
        for hand in found
    ]
    is_one = len(hands) == count and not any(isinstance(h, list) and len(h) == count for h in hands)
    return [found] if is_one else hands


def _labels(entry: Mapping[str, Any]) -> list[str]:
    found = next((entry[k] for k in _SIDES if k in entry), [])
    found = found if isinstance(found, list) else [found]
    return [side_in(str(one)) for one in found]


# ---- COCO-WholeBody


def _people(entry: Mapping[str, Any]) -> list[Any]:
    if "keypoints" in entry or "righthand_kpts" in entry or "lefthand_kpts" in entry:
        return [entry]
    inner = entry.get("instances", entry.get("people", entry.get("predictions")))
    people = inner if isinstance(inner, list) else ()
    return [person for person in people if isinstance(person, Mapping) and "keypoints" in person]


def _whole_body(
    people: list[tuple[int, Any]], frames: list[tuple[int, Mapping[str, Any]]], where: str
) -> ImportedJoints:
    best: dict[str, dict[int, Hand]] = {}
    everybody: dict[int, list[BodyPoints]] = {}
    for frame, person in people:
        body, sides = _person(person, f"{where}: frame {frame}")
        if body is not None:
            everybody.setdefault(frame, []).append(body)
        for side, hand in sides.items():
            known = best.setdefault(side, {})
            sure = hand[:, 2].sum()
            if sure > 0 and (frame not in known or sure > known[frame][:, 2].sum()):
                known[frame] = hand
    numbers = sorted({frame for frame, _ in frames})
    is_numbered = any("frame_id" in entry for _, entry in frames)
    notes = ()
    if is_numbered and numbers == list(range(1, len(numbers) + 1)):  # as MMPose's demos count
        best = {
            side: {frame - 1: hand for frame, hand in found.items()} for side, found in best.items()
        }
        everybody = {frame - 1: found for frame, found in everybody.items()}
        notes = (f"{where}: frames are counted from 1 there, here from 0.",)
    bodies = checked_bodies(everybody, where)
    whole = bodies is None or bodies.count == _WHOLE
    family = "COCO-WholeBody as RTMPose writes it" if whole else "COCO's JSON"
    return ImportedJoints(family, best, notes=notes, bodies=bodies)


def _person(person: Mapping[str, Any], where: str) -> tuple[BodyPoints | None, dict[str, Hand]]:
    """Return a person's points, of whatever detector, None where they are a hand's, or none was found; and the hands by side."""
    hands: dict[str, Hand] = {}
    for side in ("left", "right"):
        if f"{side}hand_kpts" in person:
            points, sure = _points(person[f"{side}hand_kpts"], None, where)
            if len(points) == len(JOINTS):
                hands[side] = hand_of(JOINTS, points, sure)
    if "keypoints" not in person:
        return None, hands
    scores = person.get("keypoint_scores", person.get("scores"))
    points, sure = _points(person["keypoints"], scores, where)
    for side, start in ({} if hands else _WHOLE_BODY.get(len(points), {})).items():
        part = slice(start, start + len(JOINTS))
        hands[side] = hand_of(JOINTS, points[part], sure[part])
    body = cleaned(np.column_stack([points, sure]))
    seen = body[: BODY_LAYOUTS["coco17"].count] if len(body) == _WHOLE else body
    return body if len(body) != len(JOINTS) and (seen[:, 2] > 0).any() else None, hands


def _points(values: Any, scores: Any, where: str) -> tuple[Floats, Floats]:
    """Return points (N, 2) [px] and confidence (N,), from N times x, y, or flat x, y, confidence where no scores stand beside.

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
        one = isinstance(scores, float)
        sure = np.full(len(array), scores) if one else np.array(scores, float).ravel()
    except (TypeError, ValueError, KeyError, AttributeError, OverflowError):
        raise HandtrackError(f"{where}: points that are no numbers x, y, confidence.") from None
    if array.shape[1] < 2 or len(sure) != len(array):
        raise HandtrackError(
            f"{where}: {len(array)} keypoints with {len(sure)} scores; expected as many."
        )
    return array[:, :2], np.where(np.isfinite(sure), sure, 0.0)


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
