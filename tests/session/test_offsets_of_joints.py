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
from handtrack.session.seen.joint_errors import joint_errors
from handtrack.session.session import Session
from handtrack.simulation.motion import motion
from handtrack.simulation.simulate import Simulation, simulate, simulated_rig

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
def test_joints_count_for_as_exact_as_cameras_agree(folder, rng, noise):
    """The error in each direction is found from what triangulation leaves of it: from two cameras and from three."""
    for count in (2, 3):
        views = [_NoisyView(camera, noise, rng) for camera in simulated_rig(count).cameras]
        assert joint_errors(tuple(views)).px == pytest.approx(noise, rel=0.15)
    (sure, *_) = (
        TrackingRun.open(Session.open(folder), {"model.fit_size": "false"}).seen(0).keypoints
    )
    assert sure.sigma_px == 5.0, "the setting, where they agree better"


class _NoisyView:
    """One camera that sees random points of a hand's breadth, the same in all cameras, with noise."""

    keypoint_files = SimpleNamespace(frames=range(40))

    def __init__(self, camera, noise, rng):
        self.camera, self.noise, self.rng = camera.without_distortion(), noise, rng

    def keypoints(self, frame, sigma_px):
        points = np.random.default_rng(frame).normal(scale=0.04, size=(21, 3))
        pixels = self.camera.project(points) + self.rng.normal(scale=self.noise, size=(21, 2))
        return (ImageKeypoints(self.camera, keypoint_names(), pixels, sigma_px),)


def graded(power, seed=4):
    """Return what is found of joints whose errors of 6 px at a confidence of 1 grow with a power as it falls to 0.35."""
    rng = np.random.default_rng(seed)
    views = [_UnsureView(camera, 6.0, rng, power) for camera in simulated_rig(2).cameras]
    return joint_errors(tuple(views))


@pytest.mark.parametrize("power", [1.0, 2.0])
def test_errors_that_grow_as_confidence_falls_are_graded(power):
    found = graded(power)
    assert found.power is not None
    sure = np.array([0.35, 0.5, 0.7, 0.95])
    true = 6.0 * sure**-power
    np.testing.assert_allclose(found.sigma_px(sure, 5.0), true, rtol=0.45)
    assert (np.diff(found.sigma_px(np.linspace(0.3, 1.0, 50), 5.0)) <= 0).all()
    assert found.sigma_px(np.array([1.0]), 20.0) == 20.0, "never surer than the setting"


def test_errors_that_do_not_grow_keep_two_steps():
    found = graded(0.0)
    assert (found.power, found.px) == (None, pytest.approx(6.0, rel=0.15))
    assert found.sigma_px(np.array([0.9, 0.5]), 5.0).tolist() == [found.px, 2 * found.px]


class _UnsureView(_NoisyView):
    """One camera whose joints' errors grow with a power of the confidence that it states."""

    def __init__(self, camera, noise, rng, power):
        super().__init__(camera, noise, rng)
        self.power = power

    def keypoints(self, frame, sigma_px):
        (exact,) = super().keypoints(frame, sigma_px)
        sure = self.rng.uniform(0.35, 1.0, 21)
        points = np.random.default_rng(frame).normal(scale=0.04, size=(21, 3))
        true = self.camera.project(points)
        pixels = true + (exact.pixels - true) * sure[:, None] ** -self.power
        return (ImageKeypoints(self.camera, exact.names, pixels, sigma_px, sure),)
