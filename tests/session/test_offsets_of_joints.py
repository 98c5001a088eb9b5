"""A session whose cameras have a detector's joints: where it sees them is found before tracking."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from handtrack.capture.images.openpose import write_hand
from handtrack.files.toml_edit import edit_toml
from handtrack.model.articulated import HandScale, keypoint_names
from handtrack.model.model_file import load_model, read_scale, write_scale
from handtrack.observation.observation import ImageKeypoints
from handtrack.session.formats.tables import read_npz, write_npz
from handtrack.session.run import TrackingRun
from handtrack.session.seen.joint_errors import joint_sigma_px
from handtrack.session.session import Session
from handtrack.simulation.motion import motion
from handtrack.simulation.simulate import Simulation, simulate, simulated_rig
from handtrack.tracking.frame.control import Control
from handtrack.tracking.whole.refinement import Refinement

OFFSETS = {
    "thumb_mcp": (4.0, 8.0, -4.0), "index_mcp": (0.0, -9.0, 6.0), "little_pip": (0.0, 8.0, 0.0)
}  # fmt: skip
WHAT = Simulation(cameras=2, frames=16, size=(320, 240), images=False, seed=3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A simulated hand of a given size, and what a detector with offsets sees of it in two cameras."""
    made = simulate(tmp_path_factory.mktemp("joints") / "session", WHAT)
    rig, rng = Session.open(made).rig, np.random.default_rng(1)
    hand = load_model(scale=HandScale(1.0, {}, {}, OFFSETS))
    rows = [hand.joint_names.index(name) for name in keypoint_names()]
    poses = motion(hand, WHAT.motion, WHAT.frames, np.random.default_rng(WHAT.seed))
    changes = {}
    for number, camera in enumerate(rig.cameras):
        changes[f"camera.{number}.keypoints"] = f"keypoints/{camera.name}/*.json"
        changes[f"camera.{number}.keypoint_layout"] = "mediapipe21"
        (made / "keypoints" / camera.name).mkdir(parents=True)
        for frame, pose in enumerate(poses):
            bones = hand.bones(hand.transform.solver_params(pose))
            points = bones.to_world(hand.joint_bone, hand.seen_point)[rows]
            pixels = camera.project(points) + rng.normal(scale=0.5, size=(21, 2))
            path = made / "keypoints" / camera.name / f"{frame:06d}.json"
            write_hand(path, np.column_stack([pixels, np.ones(21)]), "right", "test")
    edit_toml(made / "session.toml", changes, "a session's settings")
    return made


def missed_mm(scale, joint):
    return float(np.linalg.norm(np.subtract(scale.offsets_mm[joint], OFFSETS[joint])))


@pytest.mark.parametrize("use", [{}, {"silhouettes.weight": 0}], ids=["masks too", "joints alone"])
def test_offsets_are_found_though_the_size_is_given(folder, use):
    run = TrackingRun.open(Session.open(folder), {"keypoints.sigma_px": 1.0, **use})
    assert (run.scale.overall, set(run.scale.parts.values()) | {1.0}) == (1.0, {1.0})
    for joint, true in OFFSETS.items():
        assert missed_mm(run.scale, joint) < 0.6 * np.linalg.norm(true), joint
    assert set(run.scale.offsets_mm) == set(keypoint_names())


def test_offsets_are_found_again_with_all_frames(folder):
    """The pass that refines the recording finds them itself, where nothing was fitted before; not those of a saved hand."""
    told = []
    values = {"keypoints.sigma_px": 1.0, "silhouettes.weight": 0, "model.fit_size": "later"}
    run = TrackingRun.open(Session.open(folder), values)
    list(run.track_with(Control(on_shared=told.append), range(WHAT.frames), *run.initial()))
    found = Refinement.read(told[-1]).scale
    for joint, true in OFFSETS.items():
        assert missed_mm(found, joint) < 0.6 * np.linalg.norm(true), joint
    assert found.overall == run.scale.overall, "the size was given"


def test_results_have_landmarks_where_the_detector_sees_the_joints(folder, tmp_path):
    """They lie nearer to what was filmed of the detector's points than the joint centres, of which two are 9 mm off."""
    settings = {"keypoints.sigma_px": 1.0, "silhouettes.weight": 0}
    run = TrackingRun.open(Session.open(folder), settings)
    frame, start = run.initial()
    found = run.result(run.track(range(4), frame, start))
    write_npz(tmp_path / "poses.npz", found)
    with np.load(tmp_path / "poses.npz") as file:
        landmarks, joints = file["landmarks"], file["keypoints21"]
        assert str(file["landmark_definition"]) == "mediapipe21"
        assert file["landmark_covariance"].shape == (4, 21, 3, 3)
    filmed = load_model(scale=HandScale(1.0, {}, {}, OFFSETS))
    poses = motion(filmed, WHAT.motion, WHAT.frames, np.random.default_rng(WHAT.seed))[:4]
    bones = [filmed.bones(filmed.transform.solver_params(pose)) for pose in poses]
    rows = [filmed.joint_names.index(name) for name in keypoint_names()]
    true = np.array([b.to_world(filmed.joint_bone, filmed.seen_point)[rows] for b in bones])
    moved = [keypoint_names().index(name) for name in OFFSETS]
    off = 1e3 * np.linalg.norm(np.stack([landmarks, joints]) - true, axis=3)[:, :, moved]
    assert off[0].mean() < 0.5 * off[1].mean()
    again = read_npz(tmp_path / "poses.npz").in_landmarks("mediapipe21")
    np.testing.assert_allclose(again.keypoints21, landmarks, atol=1e-12)
    np.testing.assert_allclose(again.in_landmarks("joints").keypoints21, joints, atol=1e-9)


def test_another_detectors_offsets_are_not_taken_for_this_ones(folder):
    write_scale(folder / "other.json", HandScale(1.0, {}, {}, OFFSETS, {}, "openpose21"))
    assert read_scale(folder / "other.json").landmark_definition == "openpose21"
    session = Session.open(folder)
    session.file = replace(session.file, hand=replace(session.file.hand, scale="other.json"))
    given = TrackingRun.open(session, {"model.fit_size": "false"})
    assert (given.scale.offsets_mm, given.scale.landmark_definition) == ({}, "mediapipe21")
    unused = TrackingRun.open(session, {"keypoints.weight": 0})
    assert unused.scale.offsets_mm == OFFSETS
    assert unused.scale.landmark_definition == "openpose21"


def test_nothing_is_fitted_where_that_is_not_wished(folder):
    session = Session.open(folder)
    assert TrackingRun.open(session, {"model.fit_size": "false"}).scale == HandScale()
    assert TrackingRun.open(session, {"keypoints.weight": 0}).scale == HandScale()


def test_a_saved_hand_brings_its_offsets(folder):
    saved = HandScale(1.0, {}, {}, OFFSETS)
    write_scale(folder / "hand.json", saved)
    edit_toml(folder / "session.toml", {"hand.scale": "hand.json"}, "a session's settings")
    run = TrackingRun.open(Session.open(folder))
    assert (run.scale, run.size_is_open) == (saved, False)


@pytest.mark.parametrize("noise", [0.5, 4.0])
def test_joints_count_for_as_exact_as_cameras_agree(noise, rng):
    """The error in each direction is found from what triangulation leaves of it, from two cameras and from three; a hand's
    points are known to 2 mm at best.
    """
    for count in (2, 3):
        cameras = simulated_rig(count).cameras
        depth = np.median([c.to_camera(np.zeros(3))[2] for c in cameras])
        least = 0.002 * float(np.median([c.pixels_per_m(depth) for c in cameras]))
        found = joint_sigma_px(tuple(_NoisyView(camera, noise, rng) for camera in cameras))
        assert found == pytest.approx(np.hypot(noise, least), rel=0.15)


@pytest.mark.parametrize(("given", "expected"), [(0.0, 0.0), (1.5, 1.5), (20.0, 20.0)])
def test_a_given_error_of_joints_stands_and_none_is_measured(folder, given, expected):
    use = {"model.fit_size": "false", "keypoints.sigma_px": given}
    run = TrackingRun.open(Session.open(folder), use)
    measured = joint_sigma_px(tuple(run.session.views))
    for joints in run.seen(0).keypoints:
        assert (joints.sigma_px == (expected or measured)).all()


class _NoisyView:
    """One camera that sees random points of a hand's breadth, the same in all cameras, with noise."""

    keypoint_files = SimpleNamespace(
        frames=range(40), layout=SimpleNamespace(points=dict.fromkeys(keypoint_names()))
    )

    def __init__(self, camera, noise, rng):
        self.camera, self.noise, self.rng = camera.without_distortion(), noise, rng

    def keypoints(self, frame, sigma_px):
        points = np.random.default_rng(frame).normal(scale=0.04, size=(21, 3))
        pixels = self.camera.project(points) + self.rng.normal(scale=self.noise, size=(21, 2))
        return (ImageKeypoints(self.camera, keypoint_names(), pixels, sigma_px),)
