"""2D joints of a session's cameras: from files to observations."""

import numpy as np

from handtrack import Session
from handtrack.model.articulated import keypoint_names
from tests.session.small_session import add_joints, edit, keypoints, make_session


def test_joints_are_observed_without_the_lens_those_hardly_seen_left_out(tmp_path):
    folder = make_session(tmp_path)
    edit(folder / "calibration.toml", "[0.0, 0.0, 0.0, 0.0, 0.0]", "[-0.1, 0.03, 0.001, 0.0, 0.0]")
    camera = Session.open(folder).rig["cam0"]
    rows = np.column_stack([camera.project(keypoints()), np.full(21, 0.9)])
    rows[4, 2], rows[8, 2] = 0.1, 0.4  # hardly seen, and so so
    (seen,) = Session.open(add_joints(folder, {"cam0": {1: rows}})).view("cam0").keypoints(1, 2.0)
    assert not seen.camera.is_distorted
    known = np.isfinite(seen.pixels).all(axis=1)
    names = np.array(seen.names)
    assert set(names[~known]) == {"thumb_tip"}
    expected = seen.camera.project(keypoints()[[keypoint_names().index(n) for n in names]])
    np.testing.assert_allclose(seen.pixels[known], expected[known], atol=1e-2)
    np.testing.assert_array_equal(seen.sigma_px, 2.0)
