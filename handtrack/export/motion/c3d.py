"""C3D: joints as markers [mm], for motion capture programs. Written by ezc3d."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from handtrack.export.motion.trc import marker_name
from handtrack.export.table import ResultsTable
from handtrack.files.atomic import replacing

_MM = 1e3


def write(path: Path, table: ResultsTable) -> list[Path]:
    """Write every named joint as a point. Its residual is the root of the mean variance [mm], −1 in lost frames: C3D's word for a
    point that was not seen.
    """
    import ezc3d  # pyright: ignore[reportMissingImports]

    table = table.without_gaps
    track = table.track
    points = np.ones((4, len(track.joint_names), len(track)))
    points[:3] = _MM * track.joint_positions.transpose(2, 1, 0)
    residuals = _MM * np.sqrt((table.joint_std**2).mean(axis=2)).T[None]
    points[:3, :, table.is_lost] = np.nan  # ezc3d writes those as not seen
    residuals[:, :, table.is_lost] = -1.0
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["parameters"]["POINT"]["RATE"]["value"] = [float(table.fps)]
    file["parameters"]["POINT"]["LABELS"]["value"] = [marker_name(n) for n in track.joint_names]
    file.add_parameter("POINT", "X_SCREEN", ["+X"])  # as all that read it take it: z is up
    file.add_parameter("POINT", "Y_SCREEN", ["+Z"])
    file.add_parameter("MANUFACTURER", "SOFTWARE", ["handtrack"])
    file["parameters"]["POINT"]["DESCRIPTIONS"]["value"] = [
        table.keypoint_definition
    ] * points.shape[1]
    file["header"]["points"]["first_frame"] = int(track.frame[0])  # ezc3d counts from 0, as we do
    file["header"]["points"]["last_frame"] = int(track.frame[-1])
    file["data"]["points"] = points
    file["data"]["meta_points"]["residuals"] = residuals
    with replacing(path) as part:
        file.write(str(part))
    return [path]
