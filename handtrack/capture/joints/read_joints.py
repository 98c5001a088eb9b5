"""Anybody's 2D joints, of hands and bodies: which reader knows a file, by its content, in one place."""

from __future__ import annotations

import glob
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from handtrack.capture.images.frames import files_by_frame
from handtrack.capture.joints.given_joints import LARGEST, ImportedJoints
from handtrack.capture.joints.json_joints import read_json_joints, read_openpose_files
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
