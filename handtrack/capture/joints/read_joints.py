"""Anybody's 2D joints, of hands and bodies: which reader knows a file, by its content, in one place; and JSON of MediaPipe, RTMPose, MMPose and OpenPose."""

from __future__ import annotations

import glob
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.capture.images.frames import files_by_frame, frame_number
from handtrack.capture.images.openpose import height
from handtrack.capture.joints.given_joints import (
    BODY_LAYOUTS,
    HANDS_IN,
    JOINTS,
    LARGEST,
    BodyPoints,
    Hand,
    ImportedJoints,
    checked_bodies,
    cleaned,
    frame_of,
    side_in,
)
from handtrack.capture.joints.table_joints import read_csv_joints, read_h5_joints
from handtrack.errors import HandtrackError
from handtrack.files.text_files import check_file, first_bytes, read_json, read_text

_WHAT = "2D joints"
ACCEPTED = (
    "OpenPose (folder of JSON), MediaPipe (JSON, JSON lines, CSV), Caliscope (xy.csv), RTMPose or COCO-WholeBody (JSON), DeepLabCut (CSV, H5), SLEAP (analysis "
    "H5, .slp), of hands or bodies, or a CSV with the columns frame, joint, x, y, confidence"
)


def read_joints(
    text: str, where: str, names: Mapping[str, str] | None = None, camera: str = ""
) -> ImportedJoints:
    """Return the joints of a file, a folder or a pattern of files.

    Parameters
    ----------
    names
        Our names (`index_tip`) of a table's own points (`D2_tip`).
    camera
        The name of the camera, by whose number it is found where a file has all.

    Raises
    ------
    HandtrackError
        Naming what is accepted; UnknownPoints for a table whose points are no hand's.
    """
    given = names or {}
    path = Path(text)
    if not path.is_file() and (path.is_dir() or any(sign in text for sign in "*?[")):
        found = read_json_joints(_of_files(text, where), text)
    else:
        check_file(path, _WHAT, LARGEST)
        start = first_bytes(path)
        if start[:4] == b"\x89HDF":
            found = read_h5_joints(path, given)
        elif b"\0" in start:
            found = None
        elif start.decode("utf-8-sig", errors="replace").lstrip()[:1] in ("{", "["):
            found = read_json_joints(_frames(_json(path), text), text)
        else:
            found = read_csv_joints(read_text(path, _WHAT, LARGEST), text, given, camera)
    if found is None:
        raise HandtrackError(f"{where}: no joints that are known here. Accepted: {ACCEPTED}.")
    return found


def _json(path: Path) -> Any:
    """Return what a JSON file holds, or the list of what each line of it does."""
    text = read_text(path, _WHAT, LARGEST)
    lines = [line for line in text.splitlines() if line.strip()]
    if len(lines) < 2 or not all(
        line.strip()[0] == "{" and line.strip()[-1] == "}" for line in lines
    ):
        return read_json(path, _WHAT, LARGEST)
    try:
        return [json.loads(line) for line in lines]
    except (ValueError, RecursionError) as error:
        raise HandtrackError(f"{path}: one of its lines is no JSON ({error}).") from None


def _of_files(text: str, where: str) -> Iterator[_Frame]:
    """Yield what each file of a folder, or of a pattern, says of its frame; one that cannot be read is passed over, but not the first."""
    pattern = f"{glob.escape(text.rstrip('/'))}/*.json" if Path(text).is_dir() else text
    files = files_by_frame(Path(name) for name in glob.glob(pattern) if Path(name).is_file())
    if not files:
        raise HandtrackError(
            f"{where}: nothing matches {pattern}; expected one JSON file a frame. Accepted: {ACCEPTED}."
        )
    for frame, path in files.items():
        try:
            entry = {"frame": frame, **_table(read_json(path, _WHAT))}
        except HandtrackError:
            if frame == next(iter(files)):
                raise
            continue
        yield _number(entry, frame, str(path)), entry


# ---- Joints in JSON: MediaPipe's results, OpenPose's, COCO-WholeBody as RTMPose and MMPose write it


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
_BODY = "body"
_OPENPOSE = {
    "hand_left_keypoints_2d": "left",
    "hand_right_keypoints_2d": "right",
    "pose_keypoints_2d": _BODY,
}
_KEYS = {"lefthand_kpts": "left", "righthand_kpts": "right", "keypoints": "", **_OPENPOSE}
"""of a person's points: whose hand they are alone, or that they are a body's; empty: their number tells"""
_MIRRORED = {"left": "right", "right": "left"}
_OF_MEDIAPIPE, _OF_OPENPOSE = "MediaPipe's JSON", "OpenPose's JSON"
_Frame = tuple[int, Mapping[str, Any]]
"""number, and what is there"""


def read_json_joints(frames: Iterable[_Frame], where: str) -> ImportedJoints | None:
    """Return the joints of all frames; None for what is of no known form. Raises HandtrackError."""
    programs, numbers, is_numbered = set[str](), set[int](), False
    detected: list[tuple[int, str, BodyPoints]] = []
    for frame, entry in frames:
        programs.add(_program(entry))
        numbers.add(frame)
        is_numbered |= "frame_id" in entry
        found = _detected(entry, f"{where}: frame {frame}")
        detected += [(frame, part, points) for part, points in found]
    is_mediapipe, is_openpose = _OF_MEDIAPIPE in programs, programs == {_OF_OPENPOSE}
    if not (detected or is_mediapipe or is_openpose):
        return None
    counted = is_numbered and not is_mediapipe and min(numbers) == 1  # as MMPose's demos
    first = int(counted and len(numbers) == max(numbers))
    size = height if is_openpose else _confidence
    hands: dict[str, dict[int, Hand]] = {}
    people: dict[int, list[BodyPoints]] = {}
    for number, part, points in detected:
        frame = number - first
        for side, rows in HANDS_IN.get(len(points), {}).items() if part != _BODY else ():
            own, hand = hands.setdefault(part or side, {}), points[list(rows)]
            if _confidence(hand) > 0 and (frame not in own or size(hand) > size(own[frame])):
                own[frame] = hand
        body = points[: _BODY_OF_WHOLE if len(points) == _WHOLE else None]
        if (part == _BODY or len(points) != len(JOINTS)) and _confidence(body) > 0:
            people.setdefault(frame, []).append(points)
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
        return ImportedJoints(_OF_MEDIAPIPE, hands, "mediapipe21", (), notes, bodies)
    notes = (f"{where}: frames are counted from 1 there, here from 0.",)[:first]
    bodies = checked_bodies(people, where)
    whole = bodies is None or bodies.count == _WHOLE
    family = "COCO-WholeBody as RTMPose writes it" if whole else "COCO's JSON"
    return ImportedJoints(
        _OF_OPENPOSE if is_openpose else family, hands, notes=notes, bodies=bodies
    )


def _program(entry: Mapping[str, Any]) -> str:
    """Return whose form a frame has; empty for one that several programs share."""
    if any(isinstance(entry.get(key), list | Mapping) for key in (*_MEDIAPIPE, *_POSE)):
        return _OF_MEDIAPIPE
    people = entry.get("people")
    is_openpose = isinstance(people, list) and all(
        isinstance(person, Mapping) and not _OPENPOSE.keys().isdisjoint(person) for person in people
    )
    return _OF_OPENPOSE if is_openpose else ""


def _confidence(points: BodyPoints) -> float:
    return float(points[:, 2].sum())


def _frames(tree: Any, where: str) -> Iterator[_Frame]:
    """Yield every frame of a file: from a list of frames, a mapping by frame number, or the one of OpenPose."""
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
    if isinstance(tree, Mapping) and _program(tree) == _OF_OPENPOSE:
        tree = [tree]
    elif isinstance(tree, Mapping) and all(str(key).isdecimal() for key in tree):
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


def _detected(entry: Mapping[str, Any], where: str) -> Iterator[tuple[str, BodyPoints]]:
    """Yield the hands and bodies of a frame, each with the side that stands with it, or as a body."""
    said = next((entry[k] for k in _SIDES if k in entry), [])
    for keys in (_MEDIAPIPE, _POSE):
        found = next((entry[k] for k in keys if k in entry), [])
        if isinstance(found, Mapping) and all(map(side_in, map(str, found))):
            said, found = list(found), list(found.values())
        labels = [side_in(str(one)) for one in (said if isinstance(said, list) else [said])]
        for i, one in enumerate(_lists(found)):
            is_pose = len(one) == _POSE_POINTS
            sure = [p.get("visibility", 1.0) if isinstance(p, Mapping) else 1.0 for p in one]
            points = _points(one, sure if is_pose else 1.0, where)
            if len(points) not in (len(JOINTS), _POSE_POINTS):
                raise HandtrackError(
                    f"{where}: a hand of {len(points)} landmarks; expected {len(JOINTS)}."
                )
            yield _BODY if is_pose else labels[i] if i < len(labels) else "", points
    inner = entry.get("instances", entry.get("people", entry.get("predictions")))
    for person in (entry, *(inner if isinstance(inner, list) else ())):
        for key, part in _KEYS.items() if isinstance(person, Mapping) else ():
            if person.get(key):
                sure = None if part else person.get("keypoint_scores", person.get("scores"))
                points = _points(person[key], sure, where)
                if part in ("", _BODY) or len(points) == len(JOINTS):
                    yield part, points


def _lists(found: Any, depth: int = 4) -> Iterator[list[Any]]:
    """Yield the lists of points in a frame's landmarks: of a list of hands or people, of one, in tables, or as columns by axis."""
    if isinstance(found, Mapping):
        columns = [found.get(axis) for axis in "xy"]
        if all(isinstance(column, Mapping | list) for column in columns):
            lists = (c.values() if isinstance(c, Mapping) else c for c in columns)
            yield [list(row) for row in zip(*lists)]
        else:
            found = found.get("landmark", found.get("landmarks"))
    if isinstance(found, list) and found:
        if _is_point(found[0]):
            yield found
        elif depth:
            for one in found:
                yield from _lists(one, depth - 1)


def _is_point(value: Any) -> bool:
    """Return whether a value is a point or a number of one, and no list of points."""
    if isinstance(value, list):
        return 0 < len(value) <= 4 and not isinstance(value[0], list | Mapping)
    inner = value.get("x") if isinstance(value, Mapping) else value
    return isinstance(inner, int | float | str) or (
        isinstance(value, Mapping) and "position" in value
    )


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
