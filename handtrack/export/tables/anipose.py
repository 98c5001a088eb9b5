"""Anipose's table of 3D points: columns `<joint>_x, _y, _z, _error, _ncams, _score` [mm], a row a frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from handtrack.export.table import ResultsTable
from handtrack.export.tables.cells import number, write_rows
from handtrack.tracking.frame.tables.labelled import joint_confidence

_MM = 1e3


def write(path: Path, table: ResultsTable) -> None:
    """Write the table. `_score` is the confidence; `_error` [px] and `_ncams` are not known of a joint, which is no triangulated
    point: the first is empty, the second the session's number of cameras. Points of lost frames are empty.
    """
    track, cameras = table.track, 0 if table.rig is None else len(table.rig)
    header = [
        f"{joint}_{what}"
        for joint in track.joint_names
        for what in ("x", "y", "z", "error", "ncams", "score")
    ]
    header += [f"M_{i}{j}" for i in range(3) for j in range(3)]
    header += [f"center_{i}" for i in range(3)]
    places = np.where(table.is_lost[:, None, None], np.nan, _MM * track.joint_positions)
    turned = [*map(number, np.eye(3).ravel()), "0", "0", "0"]  # Anipose's own turn of the world
    rows = (
        [
            *(
                cell
                for place, sure in zip(points, score, strict=True)
                for cell in (*map(number, place), "", str(cameras), number(sure))
            ),
            *turned,
            int(frame),
        ]
        for frame, points, score in zip(
            track.frame, places, joint_confidence(table.track), strict=True
        )
    )
    write_rows(path, [*header, "fnum"], rows)
