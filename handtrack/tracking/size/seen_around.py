"""What tells a person's size: the hand seen from directions that differ enough."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import D3, Floats
from handtrack.observation.observation import ImageKeypoints, Observation, Silhouette

_ANGLE = np.deg2rad(20.0)  # between two lines of sight
FEWEST_BY_JOINTS = 4
"""frames; fewer do not tell an offset from a posture"""


def seen_around(seen: Observation, place: Floats[D3]) -> bool:
    """Return whether silhouettes, or joints, show the hand from directions that differ enough to tell its size; place: where it is, world.

    From one side a hand that is larger and further back, or flatter, looks the same; a cloud is one-sided too.
    """
    return _apart([*seen.silhouettes, *seen.image_keypoints], place)


def joints_around(used: Sequence[tuple[Observation, Floats[D3]]]) -> tuple[str, ...]:
    """Return the joints that a detector saw in frames enough, from directions that differ enough."""
    sets = [seen.image_keypoints for seen, place in used if _apart(seen.image_keypoints, place)]
    if len(sets) < FEWEST_BY_JOINTS:
        return ()
    return tuple(dict.fromkeys(name for points in sets for p in points for name in p.names))


def _apart(views: Sequence[Silhouette | ImageKeypoints], place: Floats[D3]) -> bool:
    sights: list[Floats[D3]] = [place - view.camera.centre for view in views]
    sights = [sight / np.linalg.norm(sight) for sight in sights]
    least = min((float(a @ b) for a in sights for b in sights), default=1.0)
    return least < np.cos(_ANGLE)
