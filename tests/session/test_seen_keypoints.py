"""2D joints of a session's cameras: from files to observations, and tracked by them alone."""

import json

import numpy as np
import pytest

from handtrack.capture.images.openpose import LAYOUTS
from handtrack.geometry.camera import Camera
from handtrack.model.model_file import load_model
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session

FRAMES = 3
SETTINGS = """
[session]
format = 1
name = "seen by a detector"
fps = 25.0

[hand]
model = "body34"

[[camera]]
name = "front"
keypoints = "joints/*.json"
keypoint_layout = "body_25"
"""
CALIBRATION = """
[cam_0]
name = "front"
size = [1280, 960]
matrix = [[1200.0, 0.0, 640.0], [0.0, 1200.0, 480.0], [0.0, 0.0, 1.0]]
distortions = [-0.1, 0.03, 0.001, 0.0, 0.0]
rotation = [3.141592653589793, 0.0, 0.0]
translation = [0.0, 0.0, 4.0]
"""


@pytest.fixture
def folder(tmp_path):
    """A body at rest that lifts its left arm, as OpenPose would see it in a camera with a lens."""
    (tmp_path / "session.toml").write_text(SETTINGS)
    (tmp_path / "calibration.toml").write_text(CALIBRATION)
    (tmp_path / "joints").mkdir()
    model = load_model("body34")
    camera = Camera(
        "front", (1280, 960), [[1200.0, 0, 640], [0, 1200.0, 480], [0, 0, 1]],
        [-0.1, 0.03, 0.001, 0.0, 0.0], np.diag([1.0, -1.0, -1.0]), [0, 0, 4.0],
    )  # fmt: skip
    points = LAYOUTS["body_25"].points
    for frame in range(FRAMES):
        params = model.rest_params()
        params[model.parameter_names.index("left_shoulder_abd")] += 0.1 * frame
        pixels = camera.project(model.joint_positions(model.bones(params)))
        rows = np.zeros((25, 3))
        for name, row in points.items():
            rows[row] = [*pixels[model.joint_names.index(name)], 0.9]
        rows[points["nose"], 2] = 0.1  # hardly seen
        rows[points["left_knee"], 2] = 0.4  # so so
        table = {"people": [{"pose_keypoints_2d": rows.ravel().tolist()}]}
        (tmp_path / "joints" / f"front_{frame:04d}.json").write_text(json.dumps(table))
    (tmp_path / "init.json").write_text(json.dumps({"frame": 0, "parameters": {"root_tx": 0.02}}))
    return tmp_path


def test_joints_are_observed_without_the_lens_those_hardly_seen_left_out(folder):
    session = Session.open(folder)
    assert session.frame_count == FRAMES
    run = TrackingRun.open(session, {"keypoints.sigma_px": 2.0})
    (sure,) = run.observation(1).keypoints
    assert (sure.sigma_px == 2.0).all()
    assert not sure.camera.is_distorted
    known = {n for n, p in zip(sure.names, sure.pixels, strict=True) if np.isfinite(p).all()}
    assert known == set(sure.names) - {"nose"}
    wrist = sure.names.index("left_wrist")
    params = run.model.rest_params()
    params[run.model.parameter_names.index("left_shoulder_abd")] += 0.1
    place = run.model.joint_positions(run.model.bones(params))
    expected = sure.camera.project(place[run.model.joint_names.index("left_wrist")])
    np.testing.assert_allclose(sure.pixels[wrist], expected, atol=1e-3)
