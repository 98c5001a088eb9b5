"""`handtrack detect` and `handtrack detector`: files that the session reads, and nothing of others written over."""

import shutil
import signal
from dataclasses import replace

import numpy as np
import pytest

from handtrack import Session, bundled_session
from handtrack.capture.masks.seeded import Seeded
from handtrack.detector.hand_detector import DetectedHand, HandDetector
from handtrack.session.detection import JointDetection
from handtrack.session.sources.views import View
from tests.app.command_line import refused
from tests.detector.fake_detector import FakeDetector, hand_at
from tests.session.small_session import FRAMES, edit, keypoints, make_session, write_images

MINE = np.zeros(3)
STEP = 40  # between the grey values of small_session's frames


class Scene(FakeDetector):
    """Sees the hands of a session's images, which it knows by their first pixel: frame and camera."""

    def __init__(self, folder):
        super().__init__()
        self.session = Session.open(folder)
        self.places = {"right": MINE}
        self.weights = type("Known", (), {"is_known": True})

    def seen(self, image):
        frame, number = divmod(int(image[0, 0, 0]), STEP)
        if frame == FRAMES - 1:
            return []
        camera = self.session.views[number].camera
        shape = 0.5 * keypoints() + [0.001 * frame, 0, 0]
        return [
            DetectedHand(camera.project(shape + place), 0.9, 0.98 if side == "right" else 0.02)
            for side, place in self.places.items()
        ]


@pytest.fixture
def folder(tmp_path):
    """The small session, with images of both cameras."""
    session = make_session(tmp_path)
    edit(session / "session.toml", 'name = "cam1"\n', 'name = "cam1"\nimages = "cam1/*.png"\n')
    write_images(session / "cam1", range(1, FRAMES * STEP, STEP))
    return session


@pytest.fixture
def scene(folder, monkeypatch):
    scene = Scene(folder)
    monkeypatch.setattr(HandDetector, "open", lambda *_: scene)
    return scene


def test_joints_are_written_and_the_session_reads_them(handtrack, folder, scene):
    handtrack.does("detect", folder, "--write")
    session = Session.open(folder)
    for view in session.views:
        assert view.settings.keypoint_layout == "mediapipe21"
        (joints,) = view.keypoints(1, 5.0)
        true = view.camera.project(0.5 * keypoints() + [0.001, 0, 0])
        assert joints.pixels[joints.names.index("index_tip")] == pytest.approx(true[8], abs=1e-3)
        assert view.keypoints(FRAMES - 1, 5.0) == ()


def test_masks_by_the_joints_are_told_of_and_written_where_that_is_said(handtrack, folder, scene):
    skin = 'masks = { method = "skin_ycrcb", open_px = 3 }'
    edit(folder / "session.toml", 'masks = "masks/cam1/*.png"', skin)
    named = [camera.masks for camera in Session.open(folder).file.cameras]
    scene.places = {}
    assert "Masks" not in handtrack("detect", folder, "--write", "--masks").out
    scene.places = {"right": MINE}
    handtrack("detect", folder, "--write")
    assert [camera.masks for camera in Session.open(folder).file.cameras] == named
    shown = handtrack("detect", folder, "--masks")
    assert "seeded" in shown.out
    handtrack("detect", folder, "--write", "--masks")
    masks = [camera.masks for camera in Session.open(folder).file.cameras]
    assert masks == [named[0], Seeded()]  # files of masks stay
    assert "seeded" not in handtrack("detect", folder, "--write", "--masks").out


def test_a_hand_of_the_other_side_is_left_out_and_told(handtrack, folder, scene):
    scene.places = {"left": MINE}
    ended = handtrack.does("detect", folder, "--write")
    assert f"'cam1': in {FRAMES - 1} images all hands" in ended.err
    assert "keypoints" not in (folder / "session.toml").read_text()


def test_a_part_of_a_fist_taken_for_a_hand_by_one_camera_is_left_out(handtrack, folder, scene):
    whole = scene.seen

    def seen(image):
        part = [replace(hand, points=0.5 * hand.points) for hand in whole(image)]
        return {0: [], 1: part}.get(int(image[0, 0, 0]), whole(image))

    scene.seen = seen
    handtrack.does("detect", folder, "--write")
    assert Session.open(folder).view("cam1").keypoints(0, 5.0) == ()


def test_joints_of_others_stay(handtrack, folder, scene):
    own = folder / "keypoints" / "cam0"
    own.mkdir(parents=True)
    (own / "000000.json").write_text('{"people": []}')
    refused(
        handtrack,
        folder,
        ["detect", folder],
        ["Move these files"],
    )
    shutil.move(own, folder / "mine")
    edit(folder / "session.toml", 'masks = "masks/cam0/*.png"', 'keypoints = "mine/*.json"')
    handtrack("detect", folder, "--write")
    assert 'keypoints = "mine/*.json"' in (folder / "session.toml").read_text()
    assert 'keypoints = "keypoints/cam1/*.json"' in (folder / "session.toml").read_text()


def test_points_outside_of_what_is_observed_are_missing(handtrack, folder, scene):
    """Beyond the image's border, or the region of interest: the networks guess them."""
    edit(folder / "session.toml", 'masks = "masks/cam0/*.png"', "roi = [0, 0, 64, 24]")
    scene.places = {"right": np.array([0.2, 0.0, 0.0])}  # half of it is right of both images
    handtrack.does("detect", folder, "--write")
    for view, (width, height) in zip(Session.open(folder).views, ((64, 24), (64, 48)), strict=True):
        true = view.camera.project(0.5 * keypoints() + scene.places["right"])
        within = ((true >= -0.5) & (true <= np.array([width, height]) - 0.5)).all(axis=1)
        assert 0 < within.sum() < 21
        (joints,) = view.keypoints(0, 5.0)
        assert np.isfinite(joints.pixels).all(axis=1).tolist() == within.tolist()


def test_ctrl_c_keeps_what_was_found(handtrack, folder, scene):
    def interrupted(*words):
        del scene.find
        signal.raise_signal(signal.SIGINT)
        return scene.find(*words)

    scene.find = interrupted
    ended = handtrack("detect", folder)
    assert ended.code == 130
    assert "1 of 1" in ended.out
    assert (folder / "keypoints" / "cam1" / "000000.json").exists()


def test_cameras_that_do_not_exist_or_have_no_images_are_refused(handtrack, folder, scene):
    edit(folder / "session.toml", 'images = "cam1/*.png"\n', "")
    for camera in ("cam7", "cam1"):
        refused(handtrack, folder, ["detect", folder, "--camera", camera], [f"'{camera}'"])
    assert "cam1" not in handtrack("detect", folder).out


def test_masks_that_show_the_hand_at_its_joints_stay(monkeypatch):
    session, detector = Session.open(bundled_session("another_hand")), FakeDetector()
    points = session.view("cam0").camera.project(session.truth.keypoints21[0])
    detector.hands = [replace(hand_at(0, 0), points=points)]
    detection = JointDetection(session, detector, ["cam0"])
    detection.step(0)
    assert detection.with_fitting_masks(["cam0"])
    nothing = np.zeros(session.view("cam0").camera.size[::-1], np.uint8)
    for other in (nothing, 255 - nothing):
        monkeypatch.setattr(View, "mask", lambda *_, other=other: other)
        assert not detection.with_fitting_masks(["cam0"])
