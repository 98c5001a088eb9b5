"""TRC and C3D: joints as markers [mm], for OpenSim, Pose2Sim and motion capture programs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from handtrack.export.table import ResultsTable
from handtrack.files.atomic import replace_text, replacing

_MM = 1e3


def write(path: Path, table: ResultsTable) -> None:
    """Write every named joint as a marker. Rows are at the recording's rate, frame numbers count from 1 as the format wants;
    points of lost frames are empty, which readers take for missing.
    """
    table = table.without_gaps
    track, rate = table.track, f"{table.fps:.9g}"
    names, count = track.joint_names, len(track)
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{path.name}",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate}\t{rate}\t{count}\t{len(names)}\tmm\t{rate}\t{track.frame[0] + 1}\t{count}",
        "Frame#\tTime\t" + "\t\t\t".join(marker_name(name) for name in names) + "\t\t",
        "\t\t" + "\t".join(f"X{k}\tY{k}\tZ{k}" for k in range(1, len(names) + 1)),
        "",
    ]
    for row, lost in enumerate(table.is_lost):
        places = _MM * track.joint_positions[row].ravel()
        cells = [""] * (len(places) + 1) if lost else [f"{x:.5f}" for x in places]
        lines.append("\t".join([str(row + 1), f"{track.time_s[row]:.9g}", *cells]))
    replace_text(path, "\n".join(lines) + "\n")


def marker_name(joint: str) -> str:
    """Return a joint's name without what ends a cell."""
    return "_".join(joint.split()) or "_"


# ---- C3D: joints as markers [mm], for motion capture programs. Written by ezc3d


def write_c3d(path: Path, table: ResultsTable) -> None:
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
