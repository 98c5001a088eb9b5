"""truth.npz: what a recording really shows, where that is known."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from handtrack.arrays import D3, D21, Array, F, Floats, Ints, J, K, array_dataclass
from handtrack.errors import HandtrackError
from handtrack.files.npz_files import read_arrays


@array_dataclass
class Truth:
    """Ground truth of F frames."""

    frame: Ints[F]
    """frame numbers, each once."""
    time_s: Floats[F] | None
    """[s], or None when not given."""
    keypoints21: Floats[F, D21, D3] | None
    """world [m], NaN where a point is not known."""
    joint_names: tuple[str, ...]
    """J names; empty without joint positions."""
    joint_positions: Floats[F, J, D3] | None
    """world [m], NaN where a joint is not known."""
    keypoint_definition: str | None = None
    """whose points they are, as exports say it: `joints`, `mediapipe21`, …; None where the file does not"""

    def points_at(self, frame: int, joint_names: Sequence[str]) -> Floats[K, D3] | None:
        """Return the 21 keypoints of a frame, else the joints of a model with these names, world [m]; None where it has none."""
        points = self.keypoints21
        if points is None and self.joint_names == joint_names:
            points = self.joint_positions
        row = frame - int(self.frame[0]) if len(self.frame) else -1  # where none is left out
        if not (0 <= row < len(self.frame) and self.frame[row] == frame):
            row = next(iter(np.flatnonzero(self.frame == frame)), -1)
        return None if points is None or row < 0 else points[row]


def mean_error_mm(found: Floats[K, D3] | None, true: Floats[K, D3] | None) -> float:
    """Return the mean distance of points [mm]; NaN where there is nothing to compare."""
    if found is None or true is None or found.shape != true.shape:
        return float("nan")
    away = np.linalg.norm(found - true, axis=1)
    return float(np.nanmean(away) * 1e3) if np.isfinite(away).any() else float("nan")


def read_truth(path: Path) -> Truth:
    """Return the ground truth of a file. Raises HandtrackError naming the array that is wrong."""
    arrays = read_arrays(path)
    keypoints = _positions(arrays, "keypoints21", path)
    joints = _positions(arrays, "joint_positions", path)
    if keypoints is None and joints is None:
        raise HandtrackError(
            f"{path}: no keypoints21 and no joint_positions; expected at least one. Found: "
            f"{', '.join(arrays) or 'nothing'}."
        )
    if keypoints is not None and keypoints.shape[1] != 21:
        raise HandtrackError(
            f"{path}: keypoints21 has the shape {keypoints.shape}; expected (F, 21, 3)."
        )
    names = _joint_names(arrays, joints, path)
    counts = {len(a) for a in (keypoints, joints) if a is not None}
    if len(counts) > 1:
        raise HandtrackError(
            f"{path}: keypoints21 and joint_positions differ in their number of frames: "
            f"{sorted(counts)}."
        )
    count = counts.pop()
    frame = _frames(arrays.get("frame"), count, path)
    definition = arrays.get("keypoint_definition")
    told = None if definition is None else str(definition)
    return Truth(frame, _times(arrays.get("time_s"), count, path), keypoints, names, joints, told)


def _positions(arrays: dict[str, Array], name: str, path: Path) -> Floats | None:
    array = arrays.get(name)
    if array is None:
        return None
    if array.ndim != 3 or array.shape[2] != 3 or array.dtype.kind not in "fiu":
        raise HandtrackError(
            f"{path}: {name} has the shape {array.shape} of {array.dtype}; expected (F, points, "
            "3) numbers [m]."
        )
    points = array.astype(float)
    if np.isinf(points).any():
        row = int(np.flatnonzero(np.isinf(points).any(axis=(1, 2)))[0])
        raise HandtrackError(
            f"{path}: {name} has infinite values, first in row {row}; expected metres, and NaN where a point is not known."
        )
    points[np.isnan(points).any(axis=2)] = np.nan
    return points


def _joint_names(arrays: dict[str, Array], joints: Floats | None, path: Path) -> tuple[str, ...]:
    names = arrays.get("joint_names")
    if joints is None:
        return ()
    if names is None or names.ndim != 1 or names.dtype.kind != "U" or len(names) != joints.shape[1]:
        found = "none" if names is None else f"shape {names.shape} of {names.dtype}"
        raise HandtrackError(
            f"{path}: joint_positions has {joints.shape[1]} joints, so joint_names must be as "
            f"many texts; found {found}."
        )
    return tuple(str(name) for name in names)


def _frames(frame: Array | None, count: int, path: Path) -> Ints:
    if frame is None:
        return np.arange(count)
    if frame.shape != (count,) or frame.dtype.kind not in "iu":
        raise HandtrackError(
            f"{path}: frame has the shape {frame.shape} of {frame.dtype}; expected ({count},) "
            "integers."
        )
    if (frame < 0).any() or len(np.unique(frame)) != count:
        raise HandtrackError(
            f"{path}: frame has negative or repeated numbers; expected each frame once."
        )
    return frame.astype(np.int64)


def _times(time_s: Array | None, count: int, path: Path) -> Floats | None:
    if time_s is None:
        return None
    if time_s.shape != (count,) or time_s.dtype.kind not in "fiu" or not np.isfinite(time_s).all():
        raise HandtrackError(
            f"{path}: time_s has the shape {time_s.shape}; expected ({count},) finite seconds."
        )
    return time_s.astype(float)
