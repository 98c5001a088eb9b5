"""NWB with ndx-pose: joints for neuroscience archives. Written by pynwb."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from handtrack.arrays import D2, Bytes, N
from handtrack.export.shown.links import joint_links
from handtrack.export.table import ResultsTable
from handtrack.files.atomic import replacing
from handtrack.session.formats.anatomy import AXES
from handtrack.tracking.frame.tables.labelled import joint_confidence

_BEGUN = datetime(1970, 1, 1, tzinfo=UTC)
"""NWB wants a date: a recording has none, and one that is made up should look so"""


def write(path: Path, table: ResultsTable) -> list[Path]:
    """Write the joints as an ndx-pose `PoseEstimation` in the module `behavior` [m], with confidences; NaN in lost frames. The
    session's begin is not known and is 1970-01-01: set it before archiving.
    """
    import ndx_pose  # pyright: ignore[reportMissingImports]
    import pynwb  # pyright: ignore[reportMissingImports]

    made: Any = ndx_pose  # its classes are made of a specification when it is imported: no type checker knows them
    whole: Any = pynwb

    track, sure = table.track, joint_confidence(table.track)
    places = np.where(table.is_lost[:, None, None], np.nan, track.joint_positions)
    series = [
        made.PoseEstimationSeries(
            name=name,
            data=places[:, j],
            unit="meters",
            reference_frame=AXES,
            timestamps=track.time_s,
            confidence=sure[:, j],
            confidence_definition="1 - P(more than 10 mm off), 0 where the frame is lost",
        )
        for j, name in enumerate(track.joint_names)
    ]
    links = _links(table)
    skeleton = made.Skeleton(name=track.model, nodes=list(track.joint_names), edges=links)
    estimate = made.PoseEstimation(
        name="PoseEstimation",
        pose_estimation_series=series,
        description=f"{track.model} ({track.side}) fitted to calibrated cameras; points: {table.keypoint_definition}",
        scorer="handtrack",
        source_software="handtrack",
        source_software_version=track.version,
        skeleton=skeleton,
    )
    file = whole.NWBFile(
        session_description=track.session or "tracked by handtrack",
        identifier=f"{track.session} frames {track.frame[0]}-{track.frame[-1]}",
        session_start_time=_BEGUN,
    )
    module = file.create_processing_module("behavior", "poses by handtrack")
    module.add(made.Skeletons(skeletons=[skeleton]))
    module.add(estimate)
    with replacing(path) as part, whole.NWBHDF5IO(str(part), "w") as writer:
        writer.write(file)
    return [path]


def _links(table: ResultsTable) -> Bytes[N, D2]:
    """Return pairs of joints that a chain of bones connects."""
    return np.array(joint_links(table.model), np.uint8).reshape(-1, 2)
