"""How far a detector's joints are off, told from several cameras' disagreement."""

import pytest

from handtrack import Session, TrackingRun, load_model
from handtrack.session.sources.views import joint_sigma_px
from handtrack.simulation.simulate import simulated_rig
from tests.session.small_session import add_seen, joints_session
from tests.session.test_offsets_of_joints import seen_points

SIGMA_PX = 6.0


@pytest.mark.parametrize("cameras, off_px", [(2, (0.0, 0.0)), (4, (20.0, -12.0))])
def test_joints_are_as_exact_as_they_scatter_however_a_camera_is_turned(tmp_path, cameras, off_px):
    folder = joints_session(tmp_path, simulated_rig(cameras, (320, 240)))
    add_seen(folder, seen_points(load_model()), SIGMA_PX, off_px={"cam0": off_px})
    for last in folder.glob(
        "keypoints/*/*15.json"
    ):  # after a gap, over which frames are not spread
        last.rename(last.with_name("5000.json"))
    session = Session.open(folder)
    found = joint_sigma_px(tuple(session.views))
    assert found == pytest.approx(SIGMA_PX, rel=0.12)
    for asked, used in ((0.0, found), (2.0, 2.0)):  # a user's own counts
        run = TrackingRun.open(session, {"keypoints.sigma_px": asked, "model.fit_size": "false"})
        assert set(run.observed(0).image_keypoints[0].sigma_px) == {used}
