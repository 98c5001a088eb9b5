"""TRC: joints as markers, for OpenSim and Pose2Sim [mm]."""

from __future__ import annotations

from pathlib import Path

from handtrack.export.table import ResultsTable
from handtrack.files.atomic import replace_text

_MM = 1e3


def write(path: Path, table: ResultsTable) -> list[Path]:
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
    return [path]


def marker_name(joint: str) -> str:
    """Return a joint's name without what ends a cell."""
    return "_".join(joint.split()) or "_"
