"""Where a hand is, of a pose as it is drawn."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D3, Floats, N
from handtrack_app.protocol.snapshots import PoseSnapshot, SessionSnapshot


def hand_balls(session: SessionSnapshot, pose: PoseSnapshot) -> tuple[Floats[N, D3], Floats[N]]:
    """Return centres and radii [m] of balls around a hand, without its forearm; of all of a body."""
    bones = [session.bone_names[bone] for bone in session.ellipsoid_bone]
    chosen = np.array([bone != "forearm" for bone in bones])
    return pose.centre[chosen], session.radii.max(axis=1)[chosen]
