"""init.json: the pose that tracking starts from, as parameters by name or as keypoints."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import D2, D3, D21, Floats, array_dataclass
from handtrack.errors import HandtrackError, unknown_name
from handtrack.files.atomic import replace_text
from handtrack.files.text_files import read_json
from handtrack.geometry.camera import CameraRig
from handtrack.model.articulated import ArticulatedModel, HandScale, keypoint_names
from handtrack.model.model_file import scale_from, scale_table
from handtrack.observation.observation import ImageKeypoints, Observation
from handtrack.tracking.find_pose import PoseEstimate, noted, pose_in_space, poses_by_joints
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.global_search import GIVEN_JOINTS, auto_start
from handtrack.tracking.search.keypoint_start import hands_from_images
from handtrack.tracking.search.scores import shape_of

_CONVENTION = "openpose21"
_PARAMETERS_FORM = '{"frame": 0, "parameters": {"root_tx": 0.1, ...}}'
_FORMS = (
    f"expected {_PARAMETERS_FORM} or "
    '{"frame": 0, "convention": "openpose21", "unit": "m", "xyz": [[x, y, z], ... 21 rows]}'
)
_FLAT_FORM = '{"frame": 0, "convention": "openpose21", "unit": "px", "cameras": {"cam0": [[u, v], ... 21 rows]}}'
_IN_IMAGE = ("uv", "xy", "pixels", "px", "image", "camera", "views")
_LARGEST_HAND_M = 0.6
_SMALLEST_HAND_M = 0.02
_LARGEST_ANGLE = 2 * math.pi
_FARTHEST_ROOT_M = 50.0
_FEWEST_IN_IMAGE = 4


@array_dataclass
class FirstPose:
    """A pose at one frame: parameters, keypoints in space, or keypoints in images; the others are empty or None."""

    frame: int
    parameters: Mapping[str, float] = field(default_factory=dict)
    """joint parameters by name [m, rad]; missing ones are 0."""
    xyz: Floats[D21, D3] | None = None
    """world [m], NaN rows where unknown."""
    pixels: Mapping[str, Floats[D21, D2]] = field(default_factory=dict)
    """by camera, in the image as it was taken [px], NaN rows where unknown."""
    scale: HandScale | None = None
    """the hand's size that parameters were set with, where session.toml leaves it to be fitted."""
    confidence: float | None = None
    """how sure a pose is that the program found, 0 to 1; None: it was given"""

    @classmethod
    def of(cls, found: PoseEstimate) -> FirstPose:
        """Return a pose that was found as init.json holds it."""
        if found.points is not None:
            return cls(found.frame, xyz=found.points, confidence=found.confidence)
        values = found.model.named(found.model.joint_params(found.params))
        return cls(found.frame, values, confidence=found.confidence)


def read_first_pose(path: Path, parameter_names: Sequence[str] | None = None) -> FirstPose:
    """Return the pose of an init.json.

    Parameters
    ----------
    parameter_names
        The model's, None to accept any.

    Raises
    ------
    HandtrackError
        Naming the row or parameter that is wrong.
    """
    data = read_json(path, f"a first pose such as {_PARAMETERS_FORM}")
    if not isinstance(data, dict):
        raise HandtrackError(f"{path}: a {type(data).__name__}; {_FORMS}.")
    frame = data.get("frame")
    if isinstance(frame, bool) or not isinstance(frame, int) or frame < 0:
        raise HandtrackError(
            f"{path}: frame = {frame}; expected the number of the frame the pose belongs to, from "
            "0."
        )
    forms = [form for form in ("parameters", "xyz", "cameras") if form in data]
    if len(forms) > 1:
        raise HandtrackError(f"{path}: both {' and '.join(forms)}; expected one of them.")
    if "parameters" in data:
        parameters = _parameters(data["parameters"], parameter_names, path)
        scale = scale_from(data["scale"], path) if "scale" in data else None
        return FirstPose(frame, parameters, scale=scale)
    if "xyz" in data:
        return _keypoints(data, frame, path)
    if "cameras" in data:
        return _in_images(data, frame, path)
    flat = [key for key in _IN_IMAGE if key in data]
    if flat:
        raise _two_dimensional(path, f"the key '{flat[0]}'")
    raise HandtrackError(f"{path}: neither parameters nor xyz; {_FORMS}.")


def write_first_pose(path: Path, pose: FirstPose) -> None:
    """Write an init.json that reads back as the same pose."""
    data: dict[str, Any] = {"frame": pose.frame}
    if pose.pixels:
        rows_of = {name: _written(pixels) for name, pixels in pose.pixels.items()}
        data |= {"convention": _CONVENTION, "unit": "px", "cameras": rows_of}
    elif pose.xyz is None:
        data["parameters"] = dict(pose.parameters)
        if pose.scale is not None:
            data["scale"] = scale_table(pose.scale)
    else:
        rows = _written(pose.xyz)
        data |= {"convention": _CONVENTION, "unit": "m", "xyz": rows}
    replace_text(Path(path), json.dumps(data, indent=1) + "\n")


def _written(points: Floats) -> list[list[float] | None]:
    return [row.tolist() if np.isfinite(row).all() else None for row in points]


def _parameters(given: Any, known: Sequence[str] | None, path: Path) -> dict[str, float]:
    if not isinstance(given, dict):
        raise HandtrackError(f"{path}: parameters = {given}; expected names with numbers [m, rad].")
    for name, value in given.items():
        if known is not None and name not in known:
            raise unknown_name("parameter", name, list(known), str(path))
        if not _is_finite(value):
            raise HandtrackError(f"{path}: parameter {name} = {value}; expected a finite number.")
        most, hint = _LARGEST_ANGLE, "radians; is it in degrees?"
        if name.startswith("root_t"):
            most, hint = _FARTHEST_ROOT_M, "metres; is it in millimetres?"
        if abs(value) > most:
            raise HandtrackError(f"{path}: parameter {name} = {value:g} is implausible in {hint}")
    return {name: float(value) for name, value in given.items()}


def _keypoints(data: dict[str, Any], frame: int, path: Path) -> FirstPose:
    _check_convention(data, path)
    unit = data.get("unit")
    if unit != "m":
        hint = '; divide the coordinates by 1000 and write "m"' if unit == "mm" else ""
        raise HandtrackError(f'{path}: unit = {json.dumps(unit)}; expected "m" (metres){hint}.')
    xyz = _points(data["xyz"], "xyz", "[x, y, z]", path)
    known = xyz[np.isfinite(xyz).all(axis=1)]
    if len(known) < 3:
        raise HandtrackError(
            f"{path}: only {len(known)} of 21 keypoints are known; expected at least 3."
        )
    extent = float(np.linalg.norm(known.max(axis=0) - known.min(axis=0)))
    if extent > _LARGEST_HAND_M:
        raise HandtrackError(
            f"{path}: the keypoints span {extent:g} m, too much for a hand. Are they in "
            "millimetres? Expected metres, in the world frame of the calibration after "
            "world_unit_m."
        )
    if len(known) == 21 and extent < _SMALLEST_HAND_M:
        raise HandtrackError(
            f"{path}: the keypoints span only {extent:g} m, too little for a hand; expected metres."
        )
    return FirstPose(frame, xyz=xyz)


def _check_convention(data: dict[str, Any], path: Path) -> None:
    convention = data.get("convention")
    if convention != _CONVENTION:
        raise HandtrackError(
            f"{path}: unknown convention {json.dumps(convention)}; known: {_CONVENTION}."
        )


def _in_images(data: dict[str, Any], frame: int, path: Path) -> FirstPose:
    """Return keypoints of one or more cameras' images."""
    _check_convention(data, path)
    cameras = data["cameras"]
    if data.get("unit") != "px":
        raise HandtrackError(
            f'{path}: unit = {json.dumps(data.get("unit"))}; points in images are in pixels: expected "px".'
        )
    if not isinstance(cameras, dict) or not cameras:
        raise HandtrackError(
            f"{path}: cameras = {cameras}; expected keypoints by camera: {_FLAT_FORM}."
        )
    pixels = {
        str(name): _points(rows, f"camera '{name}'", "[u, v]", path)
        for name, rows in cameras.items()
    }
    known = max(int(np.isfinite(p).all(axis=1).sum()) for p in pixels.values())
    if known < _FEWEST_IN_IMAGE:
        raise HandtrackError(
            f"{path}: no camera has more than {known} of 21 keypoints; expected at least {_FEWEST_IN_IMAGE} in one."
        )
    return FirstPose(frame, pixels=pixels)


def _points(rows: Any, what: str, form: str, path: Path) -> Floats:
    """Return 21 rows of numbers, NaN where unknown. form: a row in words, such as `[u, v]`."""
    if not isinstance(rows, list) or len(rows) != 21:
        found = f"{len(rows)} rows" if isinstance(rows, list) else type(rows).__name__
        raise HandtrackError(
            f"{path}: {what} has {found}; expected 21 rows {form}, null where unknown."
        )
    columns = form.count(",") + 1
    points = np.full((21, columns), np.nan)
    for index, row in enumerate(rows):
        if row is None or row == [None] * columns:
            continue
        if columns == 3 and isinstance(row, list) and len(row) == 2:
            raise _two_dimensional(path, f"row {index} of {what}")
        numbers = isinstance(row, list) and all(map(_is_finite, row))
        if not numbers or len(row) != columns:
            unit = " in pixels," if columns == 2 else ""
            raise HandtrackError(
                f"{path}: row {index} of {what} is {row}; expected {form}{unit} or null."
            )
        points[index] = row
    return points


def _is_finite(value: Any) -> bool:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and math.isfinite(value)


def _two_dimensional(path: Path, what: str) -> HandtrackError:
    return HandtrackError(
        f"{path}: {what} looks like points in an image; say of which cameras: {_FLAT_FORM}. Or triangulate them: "
        f"{_FORMS}."
    )


# ---- Joints in images, brought into space: triangulated, or all that one camera leaves open


def poses_from_images(
    rig: CameraRig,
    settings: TrackerSettings,
    model: ArticulatedModel,
    first: FirstPose,
    seen: Observation,
) -> list[PoseEstimate]:
    """Return the poses that joints in images may mean, the surest first.

    Where two cameras agree on most joints there is one, the points in space. Otherwise fingers may
    bend to or from the camera: silhouettes and cloud of the frame decide as far as there are any.

    Parameters
    ----------
    model
        A hand with all joints.

    Raises
    ------
    HandtrackError
        For a camera that the session does not have, and for too few joints.
    """
    images = image_keypoints(rig, settings, first)
    placed = pose_in_space(settings, model, first.frame, images)
    if placed is not None:
        return [placed]
    candidates = [
        replace(c, shape=shape_of(model, model.joint_params(c.params), "given"))
        for c in hands_from_images(model, images)[: GIVEN_JOINTS.most]
    ]
    with_joints = replace(seen, keypoints=tuple(images))
    found = auto_start((), settings, with_joints, found=candidates)
    rows = [PoseEstimate.of(candidate, first.frame) for candidate in found]
    return noted(rows, images) if rows else poses_by_joints(model, first.frame, images)


def image_keypoints(
    rig: CameraRig, settings: TrackerSettings, first: FirstPose
) -> list[ImageKeypoints]:
    """Return a first pose's joints in the undistorted images of a session's cameras. Raises HandtrackError."""
    found = []
    for name, pixels in first.pixels.items():
        if name not in rig:
            raise unknown_name("camera", name, rig.names, "the first pose")
        camera = rig[name]
        flat = camera.without_distortion()
        found.append(
            ImageKeypoints(
                flat,
                keypoint_names(),
                camera.undistort_points(pixels),
                settings.keypoints.detected_px,
            )
        )
    return found
