"""`.pose` of pose-format, in which sign language research keeps skeletons: MediaPipe's points in space."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from handtrack.export.table import ResultsTable
from handtrack.export.tables.mediapipe import POSE_33
from handtrack.export.tables.openpose import is_body, ordered_points
from handtrack.files.atomic import replacing
from handtrack.model.articulated import keypoint_names

_MM = 1e3
_HAND = [(0, 1), *((i, i + 1) for i in range(1, 20) if i % 4), *((0, i) for i in (5, 9, 13, 17))]
_BODY = [(11, 12), (11, 13), (13, 15), (12, 14), (14, 16), (11, 23), (12, 24), (23, 24), (23, 25), (25, 27), (24, 26), (26, 28)]  # fmt: skip
_MEDIAPIPE = {"index": "index_finger", "middle": "middle_finger", "ring": "ring_finger", "little": "pinky"}  # fmt: skip


def write(path: Path, table: ResultsTable) -> list[Path]:
    """Write one component, RIGHT_HAND_LANDMARKS, LEFT_HAND_LANDMARKS or POSE_WORLD_LANDMARKS, with confidence; in millimetres of
    the world. Lost frames are masked. Raises HandtrackError for a skeleton of the user's own.
    """
    from pose_format import Pose  # type: ignore[import]
    from pose_format.numpy import NumPyPoseBody  # type: ignore[import]
    from pose_format.pose_header import (  # type: ignore[import]
        PoseHeader,
        PoseHeaderComponent,
        PoseHeaderDimensions,
    )

    body = is_body(table)
    names = POSE_33 if body else keypoint_names()
    points, sure = ordered_points(table, names)
    sure = np.where(table.is_lost[:, None], 0.0, sure)
    said = [name.upper() for name in names]
    if not body:
        parts = [name.partition("_") for name in names]
        said = [f"{_MEDIAPIPE.get(a, a)}{b}{c}".upper() for a, b, c in parts]
    kind = "POSE_WORLD" if body else f"{table.track.side.upper()}_HAND"
    limbs = _BODY if body else _HAND
    component = PoseHeaderComponent(f"{kind}_LANDMARKS", said, limbs, [(0, 110, 180)], "XYZC")
    extent = _MM * np.ptp(points[sure > 0], axis=0) if (sure > 0).any() else np.ones(3)
    header = PoseHeader(
        0.2, PoseHeaderDimensions(*np.ceil(extent).astype(int).tolist()), [component]
    )
    time_s = table.track.time_s
    fps = 1.0 / float(np.median(np.diff(time_s))) if len(time_s) > 1 else 1.0
    data = (_MM * points)[:, None].astype(np.float32)
    pose = Pose(header, NumPyPoseBody(fps, data, sure[:, None].astype(np.float32)))
    with replacing(path) as draft, draft.open("wb") as file:
        pose.write(file)
    return [path]
