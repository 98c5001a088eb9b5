"""MOT: the coordinates of the OpenSim model that osim.py writes, frame by frame [m, °]."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from handtrack.arrays import D3, F, Floats
from handtrack.export.motion.osim import ROOT_TURNS
from handtrack.export.table import ResultsTable
from handtrack.files.atomic import replace_text
from handtrack.geometry.rotation import euler_angles
from handtrack.session.formats.tables import is_length


def write(path: Path, table: ResultsTable) -> list[Path]:
    """Write all joint parameters by their names; the root's turn as three angles about x, y, z, each carried along by those
    before it, in place of the rotation vector. Lost frames hold the last estimate.
    """
    table = table.without_gaps
    track = table.track
    values = track.parameters.copy()
    values[:, 3:6] = root_angles(track.T_world_bone[:, 0, :3, :3])
    names = [*track.parameter_names[:3], *ROOT_TURNS, *track.parameter_names[6:]]
    shown = np.where([is_length(name) for name in names], values, np.rad2deg(values))
    lines = [
        "Coordinates",
        "version=1",
        f"nRows={len(track)}",
        f"nColumns={len(names) + 1}",
        "inDegrees=yes",
        "",
        f"Joint angles of '{table.model.name}' by handtrack; lengths in metres, angles in degrees.",
        "endheader",
        "\t".join(["time", *names]),
    ]
    lines += [
        "\t".join([f"{time_s:.9g}", *(f"{x:.8f}" for x in row)])
        for time_s, row in zip(track.time_s, shown, strict=True)
    ]
    replace_text(path, "\n".join(lines) + "\n")
    return [path]


def root_angles(rotation: Floats[F, D3, D3]) -> Floats[F, D3]:
    """Return the angles [rad] of R = Rx Ry Rz, without jumps of a whole turn."""
    return np.unwrap(euler_angles(rotation, "XYZ"), axis=0)
