"""The experiments with one camera, small: the camera frames the dancer, points are triangulated, errors are counted."""

import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.observation.observation import ImageKeypoints
from handtrack.simulation.body_motion import body_pose
from tests.experiments.jumps.monocular_dance import NOISE_PX, SeenDance, framing_camera, summary
from tests.experiments.jumps.monocular_dance import tracked as dance_tracked
from tests.experiments.silhouettes.balancing import tracked, triangulated
from tests.experiments.silhouettes.four_cameras import residuals_px
from tests.experiments.silhouettes.person_session import CAMERAS, DATA


@pytest.fixture(scope="module")
def dance():
    """Three frames of an arm that is lifted."""
    model = load_model("body34")
    poses = np.stack([body_pose(model, "reach")] * 3)
    poses[:, model.parameter_names.index("left_elbow_flex")] += [0.0, 0.05, 0.1]
    places = np.stack([model.joint_positions(model.bones(pose)) for pose in poses])
    camera = framing_camera(places)
    noise = NOISE_PX * np.random.default_rng(1).normal(size=(3, len(model.joint_names), 2))
    return SeenDance(model, poses, places, camera, camera.project(places) + noise)


def test_the_camera_just_holds_all_joints(dance):
    seen = dance.camera.project(dance.places).reshape(-1, 2)
    size = np.array(dance.camera.size)
    share = np.ptp(seen, axis=0) / size
    assert share.max() == pytest.approx(0.9, abs=0.01)
    np.testing.assert_allclose(
        0.5 * (seen.min(axis=0) + seen.max(axis=0)), 0.5 * (size - 1), atol=1e-6
    )


def test_errors_are_relative_to_the_pelvis(dance):
    assert dance.errors(dance.places[1] + (0.3, -0.2, 1.0), 1) == pytest.approx(0.0, abs=1e-9)
    moved = dance.places[1].copy()
    moved[dance.model.joint_names.index("left_wrist")] += (0.0, 0.0, 0.22)
    assert dance.errors(moved, 1) == pytest.approx(10.0)  # 220 mm over 22 joints


def test_the_best_is_never_worse_than_the_choice(dance):
    few = {"mixture.draws": 4, "mixture.carried": 4}
    several, one = dance_tracked(dance, 3, **few), dance_tracked(dance, 1)
    assert (several.oracle <= several.own).all()
    np.testing.assert_array_equal(one.oracle, one.own)
    figures = summary(several, one)
    assert figures["best_of_8_mm"] <= figures["own_choice_mm"]
    assert figures["best_of_8_mm"] < 120.0
    assert set(figures) >= {"single_near", "refined_mm", "refined_best_of_8_near"}


def test_points_are_triangulated_where_two_cameras_see_them(dance):
    model, places = dance.model, dance.places[0]
    turn = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    front = dance.camera
    side = type(front)(
        "side", front.size, front.matrix, np.zeros(5), front.rotation @ turn, front.translation
    )
    names = model.joint_names
    views = [ImageKeypoints(c, names, c.project(places), 2.0) for c in (front, side)]
    views[1].pixels[3] = np.nan
    found_names, found = triangulated(views)
    assert found_names == names
    assert np.isnan(found[3]).all()
    rest = np.delete(np.arange(len(names)), 3)
    np.testing.assert_allclose(found[rest], places[rest], atol=1e-9)


def test_a_real_person_in_four_cameras(data_dir, tmp_path, monkeypatch):
    """Two frames of the recording: the fit is as near to the detections as triangulated points are (13 px), or nearly."""
    if not (data_dir / DATA).is_dir():
        pytest.skip(f"no {DATA} in the shared test data")
    monkeypatch.setenv("HANDTRACK_DATA", str(data_dir))
    monkeypatch.setattr("tests.experiments.silhouettes.balancing.FRAMES", 2)
    few = {"tracker.hypotheses": 2, "mixture.draws": 2, "mixture.carried": 2}
    found = tracked(tmp_path, CAMERAS, None, **few)
    assert [camera.size[1] for camera in found.run.session.rig] == [1920] * 4
    off = np.concatenate(
        [
            np.linalg.norm(d, axis=1)
            for d in residuals_px(found.run, found.run.model, found.results).values()
        ]
    )
    assert np.median(off) < 25.0
