"""Simulated recordings: cameras that look at the hand, sessions that open, exact truth, the same bytes."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from handtrack.diagnostics.residual_image import model_mask
from handtrack.errors import HandtrackError
from handtrack.model.model_file import load_model
from handtrack.session.session import Session
from handtrack.simulation.motion import motion
from handtrack.simulation.simulate import Simulation, simulate, simulated_rig

SMALL = {"frames": 3, "size": (160, 120), "cameras": 2}


@pytest.mark.parametrize("count", [1, 2, 3, 6])
def test_cameras_look_at_the_origin_from_where_they_stand(count):
    rig = simulated_rig(count, (320, 240), 0.6)
    assert len(rig.cameras) == count
    for camera in rig.cameras:
        assert np.linalg.norm(camera.centre) == pytest.approx(0.6)
        np.testing.assert_allclose(camera.project(np.zeros(3)), [159.5, 119.5], atol=1e-9)
        assert camera.to_camera(np.array([0, 0.1, 0]))[1] < 0  # up in the world is up in the image
        assert np.linalg.det(camera.rotation) == pytest.approx(1.0)


def test_three_cameras_stand_40_degrees_apart_in_an_arc_six_all_around():
    def azimuths(count):
        centres = np.array([camera.centre for camera in simulated_rig(count).cameras])
        return np.rad2deg(np.arctan2(centres[:, 0], centres[:, 2]))

    np.testing.assert_allclose(azimuths(3), [-40, 0, 40], atol=1e-9)
    np.testing.assert_allclose(np.sort(azimuths(6) % 360), np.arange(0, 360, 60), atol=1e-9)


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_session_opens_and_its_truth_is_the_motion(tmp_path, side):
    what = Simulation(**SMALL, side=side, scale=1.1, images=False, init_noise_m=0.0, seed=5)
    session = Session.open(simulate(tmp_path / "new", what))
    model = load_model(side=side, scale=1.1)
    joint = motion(model, what.motion, what.frames, np.random.default_rng(5))
    assert session.frame_count == 3
    assert session.fps == what.fps
    assert session.truth is not None
    assert session.init is not None
    for frame, params in enumerate(joint):
        bones = model.bones(params)
        np.testing.assert_allclose(session.truth.keypoints21[frame], model.keypoints21(bones))
        flesh = model.flesh["fine"].posed(bones)
        for seen in session.observation(frame).silhouettes:
            assert np.abs(seen.mask - model_mask(seen.camera, flesh)).sum() <= 2
    first = model.params_from(dict(session.init.parameters))
    np.testing.assert_allclose(first, joint[0], atol=1e-12)


def test_a_distorted_camera_shows_the_same_hand_once_undistorted(tmp_path):
    what = Simulation(**SMALL, distortion=True, images=False)
    session = Session.open(simulate(tmp_path / "new", what))
    assert all(camera.is_distorted for camera in session.rig.cameras)
    model = load_model()
    joint = motion(model, what.motion, what.frames, np.random.default_rng(0))
    flesh = model.flesh["fine"].posed(model.bones(joint[0]))
    for seen in session.observation(0).silhouettes:
        exact = model_mask(seen.camera, flesh).astype(np.uint8)
        rim = cv2.dilate(exact, np.ones((3, 3))) - cv2.erode(exact, np.ones((3, 3)))
        assert np.abs(seen.mask - exact)[rim == 0].max() < 0.01
        assert abs(float(seen.mask.sum()) / exact.sum() - 1) < 0.01


def test_images_show_the_hand_where_the_mask_is(tmp_path):
    session = Session.open(simulate(tmp_path / "new", Simulation(**SMALL)))
    image, mask = session.image("cam0", 1), session.mask("cam0", 1)
    assert image.shape == (120, 160, 3)
    red_over_blue = image[..., 2].astype(float) - image[..., 0]
    inside = cv2.erode(mask, np.ones((7, 7))) > 0
    outside = cv2.dilate(mask, np.ones((7, 7))) == 0
    assert red_over_blue[inside].mean() > 30 > red_over_blue[outside].mean() + 20


def test_noisy_keypoints_are_as_noisy_as_asked(tmp_path):
    what = Simulation(**SMALL, images=False, init_noise_m=0.005)
    folder = simulate(tmp_path / "new", what)
    session = Session.open(folder)
    off = (
        np.array(json.loads((folder / "init.json").read_text())["xyz"])
        - session.truth.keypoints21[0]
    )
    assert 0.0035 < off.std() < 0.0065


def test_the_same_seed_gives_the_same_files(tmp_path):
    folders = [simulate(tmp_path / n, Simulation(**SMALL, images=False)) for n in ("a", "b")]
    for file in sorted(p.relative_to(folders[0]) for p in folders[0].rglob("*") if p.is_file()):
        if file.suffix != ".npz":  # a zip holds the time of writing
            assert (folders[0] / file).read_bytes() == (folders[1] / file).read_bytes()


def test_nothing_is_written_over(tmp_path):
    (tmp_path / "mine.txt").write_text("keep")
    with pytest.raises(HandtrackError, match="is not empty; nothing was written"):
        simulate(tmp_path, Simulation(**SMALL))
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]


@pytest.mark.parametrize(
    "wrong", [{"cameras": 0}, {"frames": 0}, {"size": (8, 8)}, {"distance_m": 0.0}, {"fps": -1.0}]
)
def test_numbers_that_make_no_recording(tmp_path, wrong):
    with pytest.raises(HandtrackError, match="^simulate: expected "):
        simulate(tmp_path / "new", Simulation(**(SMALL | wrong)))
    assert not (tmp_path / "new").exists()


def test_progress_counts_to_the_end(tmp_path):
    seen = []
    simulate(tmp_path / "new", Simulation(**SMALL, images=False), lambda *x: seen.append(x))
    assert seen == [(i + 1, 6) for i in range(6)]
