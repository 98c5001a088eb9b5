"""Anybody's 2D joints, of hands and bodies: which reader knows a file, by its content, in one place; and JSON of MediaPipe, RTMPose, MMPose and OpenPose."""

from __future__ import annotations

import glob
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.capture.images.frames import files_by_frame, frame_number
from handtrack.capture.images.openpose import LAYOUTS, body_points, read_openpose
from handtrack.capture.joints.given_joints import (
    HANDS_IN,
    LARGEST,
    BodyPoints,
    Hand,
    ImportedJoints,
    checked_bodies,
    cleaned,
    frame_of,
    side_in,
)
from handtrack.capture.joints.joint_names import BODY_LAYOUTS, JOINTS
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
        return _folder(text, where)
    check_file(path, _WHAT, LARGEST)
    start = first_bytes(path)
    if start[:4] == b"\x89HDF":
        return _known(read_h5_joints(path, given), where)
    if b"\0" in start:
        raise _unknown(where)
    if start.decode("utf-8-sig", errors="replace").lstrip()[:1] in ("{", "["):
        tree = _json(path)
        return (
            read_openpose_files({0: path})
            if _is_openpose(tree)
            else _known(read_json_joints(tree, str(path)), where)
        )
    return _known(read_csv_joints(read_text(path, _WHAT, LARGEST), str(path), given, camera), where)


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


def _folder(text: str, where: str) -> ImportedJoints:
    pattern = f"{glob.escape(text.rstrip('/'))}/*.json" if Path(text).is_dir() else text
    files = files_by_frame(Path(name) for name in glob.glob(pattern) if Path(name).is_file())
    if not files:
        raise HandtrackError(
            f"{where}: nothing matches {pattern}; expected one JSON file a frame. Accepted: {ACCEPTED}."
        )
    first = read_json(next(iter(files.values())), _WHAT)
    if _is_openpose(first):
        return read_openpose_files(files)
    trees = [
        {"frame": frame, "instances": tree} if isinstance(tree, list) else {"frame": frame, **tree}
        for frame, path in files.items()
        if isinstance(tree := read_json(path, _WHAT), list | dict)
    ]
    return _known(read_json_joints(trees, text), where)


def _is_openpose(tree: Any) -> bool:
    people = tree.get("people") if isinstance(tree, dict) else None
    return isinstance(people, list) and all(
        isinstance(person, dict) and any(key.endswith("keypoints_2d") for key in person)
        for person in people
    )


def _known(found: ImportedJoints | None, where: str) -> ImportedJoints:
    if found is None:
        raise _unknown(where)
    return found


def _unknown(where: str) -> HandtrackError:
    return HandtrackError(f"{where}: no joints that are known here. Accepted: {ACCEPTED}.")


# ---- Joints in JSON: MediaPipe's results, COCO-WholeBody as RTMPose and MMPose write it


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
