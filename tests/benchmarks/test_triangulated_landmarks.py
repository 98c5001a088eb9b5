"""The reference of triangulated landmarks, small."""

from __future__ import annotations

import numpy as np

from handtrack.session.session import Session
from handtrack.simulation.simulate import Simulation, simulate
from tests.experiments.starts.triangulated_landmarks import triangulated_points


def test_a_sessions_joints_are_where_its_cameras_see_them(tmp_path):
    what = Simulation(cameras=3, frames=2, images=False, joints_px=0.5, seed=2)
    session = Session.open(simulate(tmp_path / "session", what))
    assert session.truth is not None
    assert session.truth.keypoints21 is not None
    off = np.linalg.norm(triangulated_points(session) - session.truth.keypoints21, axis=2)
    assert off.shape == (2, 21)
    assert 0 < 1e3 * off.max() < 5.0
