"""Tidy CSV: a row for each frame and joint; beside it one for each frame and angle, and one for each frame and bone."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from handtrack.errors import HandtrackError
from handtrack.export.isb import isb_angles, isb_std
from handtrack.export.table import ResultsTable
from handtrack.export.tables.cells import beside, number, write_rows, write_sidecar
from handtrack.geometry.rotation import quaternion_wxyz
from handtrack.tracking.frame.result import is_length

_FRAME = ["frame", "time_s", "status"]
_MEANINGS = {
    "joint": "name of a joint or fingertip; std: standard deviation along the world's axes",
    "angle": "in FILE_angles.csv; convention `handtrack`: docs/reference/results.md; `isb`: docs/reference/joint_angles.md",
    "bone": "in FILE_bones.csv; x y z: its proximal end in the world; quaternion w x y z: bone to world",
}


def write(path: Path, table: ResultsTable) -> list[Path]:
    """Write joints to `path`, angles to NAME_angles.csv, bones to NAME_bones.csv, what they mean to NAME.json."""
    track = table.track
    frames = [
        [int(f), number(t), int(s)] for f, t, s in zip(track.frame, track.time_s, track.status)
    ]
    header = [*_FRAME, "joint", "x_m", "y_m", "z_m", "std_x_m", "std_y_m", "std_z_m"]
    joints = (
        [*frames[i], name, *map(number, track.joint_positions[i, j]), *map(number, spread[j])]
        for i, spread in enumerate(table.joint_std)
        for j, name in enumerate(track.joint_names)
    )
    write_rows(path, header, joints)
    angles = [*_FRAME, "convention", "angle", "value_deg", "std_deg"]
    rows = ([*frames[i], *rest] for i, rest in _angles(table))
    angles_file = write_rows(beside(path.with_stem(f"{path.stem}_angles")), angles, rows)
    bones = [*_FRAME, "bone", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"]
    turns = quaternion_wxyz(track.T_world_bone[..., :3, :3])
    carried = (
        [*frames[i], name, *map(number, track.T_world_bone[i, b, :3, 3]), *map(number, turns[i, b])]
        for i in range(len(track))
        for b, name in enumerate(track.bone_names)
    )
    bones_file = write_rows(beside(path.with_stem(f"{path.stem}_bones")), bones, carried)
    return [angles_file, bones_file, write_sidecar(path, table, _MEANINGS)]


def _angles(table: ResultsTable) -> Iterator[tuple[int, list[str]]]:
    """Yield row of the frame; convention, name, value and standard deviation of each angle but the root's turn."""
    track = table.track
    own = [
        (s, name)
        for s, name in enumerate(track.parameter_names)
        if not is_length(name) and not name.startswith("root_r")
    ]
    values, spread = np.rad2deg(track.parameters), np.rad2deg(track.parameter_std)
    try:
        isb = isb_angles(table.model, track.T_world_bone)
        isb_spread = isb_std(table.model, track.parameters, track.parameter_std)
    except HandtrackError:  # of a program that does not say how its model is built
        isb, isb_spread = {}, {}
    for i in range(len(track)):
        for s, name in own:
            yield i, ["handtrack", name, number(values[i, s]), number(spread[i, s])]
        for name, angle in isb.items():
            std = np.rad2deg(isb_spread[name][i])
            yield i, ["isb", name, number(np.rad2deg(angle[i])), number(std)]
