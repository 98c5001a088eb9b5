"""How far a detector's joints are off, told from several cameras' disagreement."""

import numpy as np
import pytest

from handtrack import Session, load_model
from handtrack.session.sources.joint_errors import joint_sigma_px
from handtrack.simulation.simulate import Simulation, simulate
from tests.session.small_session import add_joints
from tests.session.test_offsets_of_joints import seen_points

SIGMA_PX = 6.0


@pytest.mark.parametrize(("cameras", "off_px"), [(2, (0.0, 0.0)), (4, (20.0, -12.0))])
def test_joints_are_as_exact_as_they_scatter_however_a_camera_is_turned(tmp_path, cameras, off_px):
    what = Simulation(cameras=cameras, frames=16, size=(320, 240), images=False, seed=3)
    folder = simulate(tmp_path / "session", what)
    rng = np.random.default_rng(1)
    joints = {}
    for camera in Session.open(folder).rig:
        joints[camera.name] = {
            frame: camera.project(points) + rng.normal(scale=SIGMA_PX, size=(21, 2)) + off_px
            for frame, points in enumerate(seen_points(load_model()))
        }
        off_px = 0.0, 0.0  # one camera alone
    found = joint_sigma_px(tuple(Session.open(add_joints(folder, joints)).views))
    assert found == pytest.approx(SIGMA_PX, rel=0.12)
