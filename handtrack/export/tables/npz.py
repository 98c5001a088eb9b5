"""poses.npz again: everything, for Python; or joint positions alone, in the form of a session's truth.npz (contracts §2)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from handtrack.arrays import Array
from handtrack.export.table import ResultsTable
from handtrack.model.articulated import keypoint_names
from handtrack.session.formats.tables import write_arrays, write_npz


def write(path: Path, table: ResultsTable) -> None:
    """Write the result as it was read."""
    write_npz(path, table.track)


# ---- Joint positions alone, in the form of a session's truth.npz (contracts §2)


def write_keypoints(path: Path, table: ResultsTable) -> None:
    """Write joint positions by name, the 21 keypoints of hands, and whose points they are."""
    track = table.track
    arrays: dict[str, Array] = {
        "frame": track.frame,
        "time_s": track.time_s,
        "joint_names": np.asarray(track.joint_names),
        "joint_positions": track.joint_positions,
        "keypoint_definition": np.array(table.keypoint_definition),
    }
    if track.keypoints21 is not None:
        arrays["keypoint_names"] = np.asarray(keypoint_names())
        arrays["keypoints21"] = track.keypoints21
    write_arrays(path, arrays)
