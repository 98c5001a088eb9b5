"""CSV with a row a frame (contracts §5): angles in degrees, lengths in metres, joints in the world."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from handtrack.export.table import ResultsTable
from handtrack.export.tables.cells import number, write_rows, write_sidecar
from handtrack.session.formats.tables import is_length
from handtrack.tracking.frame.result import TrackResult

_MEANINGS = {
    "frame": "number of the frame, from 0",
    "time_s": "time [s]",
    "status": "0 tracked, 1 doubtful, 2 lost (holds the last estimate), 3 set by hand",
    "energy": "what is left unexplained; to be compared within a session only",
    "p_off_25mm": "probability that some joint is more than 25 mm off, beside a constant offset of definition",
    "reason": "why the frame is doubtful or lost",
}


def write(path: Path, table: ResultsTable) -> list[Path]:
    """Write the table and, beside it, what it means (.json)."""
    write_csv(path, table.track)
    return [path, write_sidecar(path, table, _meanings(table.track))]


def write_csv(path: Path | str, track: TrackResult) -> None:
    """Write the columns of contracts §5; then, where they are known, how probably each frame is off, and the reason."""
    header = ["frame", "time_s", "status", "energy", *_parameter_columns(track)]
    header += [f"{joint}_{axis}_m" for joint in track.joint_names for axis in "xyz"]
    angle = np.array([not is_length(name) for name in track.parameter_names])
    values = np.where(angle, np.rad2deg(track.parameters), track.parameters)
    parts = np.zeros((len(track), 0))
    if track.p_off_25mm is not None:
        header.append("p_off_25mm")
        parts = track.p_off_25mm[:, None]
    if track.p_off_10mm is not None and track.part_names is not None:
        header += [f"p_off_10mm_{part}" for part in track.part_names]
        parts = np.concatenate([parts, track.p_off_10mm], axis=1)
    if track.reason is not None:
        header.append("reason")
    rows = [
        [
            int(frame),
            number(track.time_s[i]),
            int(track.status[i]),
            number(track.energy[i]),
            *map(number, values[i]),
            *map(number, track.joint_positions[i].ravel()),
            *map(number, parts[i]),
            *([] if track.reason is None else [str(track.reason[i])]),
        ]
        for i, frame in enumerate(track.frame)
    ]
    write_rows(Path(path), header, rows)


def _parameter_columns(track: TrackResult) -> list[str]:
    return [f"{name}_m" if is_length(name) else f"{name}_deg" for name in track.parameter_names]


def _meanings(track: TrackResult) -> dict[str, str]:
    told = dict(_MEANINGS)
    for name in _parameter_columns(track):
        told[name] = "place of the root in the world [m]" if name.endswith("_m") else "angle [°]"
        if name.startswith("root_r"):
            told[name] = "turn of the root in the world: a rotation vector's component [°]"
    for joint in track.joint_names:
        told |= {f"{joint}_{axis}_m": f"{axis} of {joint} in the world [m]" for axis in "xyz"}
    for part in track.part_names or ():
        told[f"p_off_10mm_{part}"] = f"probability that some joint of {part} is more than 10 mm off"
    return told
