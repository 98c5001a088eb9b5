"""truth.npz: what a recording really shows, where that is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from handtrack.errors import HandtrackError
from handtrack.files.npz_files import read_arrays
from handtrack.observation.truth import Truth
from handtrack.session.formats.tables import checked_arrays, write_arrays

_KNOWN: dict[str, tuple[type, tuple[str | int, ...]]] = {
    "keypoints21": (float, ("F", 21, 3)),
    "joint_positions": (float, ("F", "J", 3)),
    "joint_names": (str, ("J",)),
    "frame": (int, ("F",)),
    "time_s": (float, ("F",)),
}


def read_truth(path: Path) -> Truth:
    """Return the ground truth of a file. Raises HandtrackError naming the array that is wrong."""
    given = read_arrays(path)
    points = [name for name in ("keypoints21", "joint_positions") if name in given]
    if not points:
        raise HandtrackError(
            f"{path}: no keypoints21 and no joint_positions; expected at least one. Found: "
            f"{', '.join(given) or 'nothing'}."
        )
    if "joint_positions" in points and "joint_names" not in given:
        raise HandtrackError(
            f"{path}: joint_positions without joint_names; expected a name for each of the joints."
        )
    arrays = checked_arrays(path, given, _KNOWN)
    for name in points:
        if np.isinf(arrays[name]).any():
            row = int(np.flatnonzero(np.isinf(arrays[name]).any(axis=(1, 2)))[0])
            raise HandtrackError(
                f"{path}: {name} has infinite values, first in row {row}; expected metres, and NaN where a point is not known."
            )
        arrays[name][np.isnan(arrays[name]).any(axis=2)] = np.nan
    frame, time_s = arrays.get("frame", np.arange(len(arrays[points[0]]))), arrays.get("time_s")
    if (frame < 0).any() or len(np.unique(frame)) < len(frame):
        raise HandtrackError(
            f"{path}: frame has negative or repeated numbers; expected each frame once."
        )
    if time_s is not None and not np.isfinite(time_s).all():
        raise HandtrackError(
            f"{path}: time_s has values that are no numbers; expected finite seconds."
        )
    names = tuple(map(str, arrays["joint_names"])) if "joint_positions" in points else ()
    told = given.get("keypoint_definition")
    return Truth(
        frame,
        time_s,
        arrays.get("keypoints21"),
        names,
        arrays.get("joint_positions"),
        None if told is None else str(told),
    )


def write_truth(path: Path, truth: Truth) -> None:
    """Write truth.npz, without what is not known, and without frame numbers where they count from 0."""
    known = {name: value for name, value in vars(truth).items() if value is not None and len(value)}
    if np.array_equal(truth.frame, np.arange(len(truth.frame))):
        del known["frame"]
    write_arrays(path, {name: np.asarray(value) for name, value in known.items()})
