"""`handtrack new` with videos that do not simply go together, with images, depth, others' calibrations and fisheye lenses."""

import json
import shutil
from argparse import Namespace
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack import HandtrackError, Session, bundled_session
from handtrack.arrays import evenly_spread
from handtrack.detector import weights
from handtrack.detector.hand_detector import HandDetector
from handtrack.session.hand_side import side_of_frames
from handtrack.session.truth import read_truth
from handtrack_app.commands import detection, track
from handtrack_app.commands.new_session.given import side_of_hand
from tests.app.command_line import refused
from tests.capture.calibration_forms.hostile import HOSTILE
from tests.capture.calibration_forms.test_calibration_forms import fisheyes
from tests.capture.sample_files import rig_of_two, sample
from tests.detector.fake_detector import FakeDetector, hand_at
from tests.live_cameras import clip
from tests.session.small_session import edit
from tests.session.test_truth import moving

SOURCE = bundled_session()
CALIBRATION = SOURCE / "calibration.toml"
SIZE = Session.open(SOURCE).rig["cam0"].size


def new(out, *words):
    return ["new", "--out", out, "--calibration", CALIBRATION, *words]


def test_c11_scaled_videos_are_taken_where_that_is_said(handtrack, tmp_path):
    width, height = SIZE
    small = clip(tmp_path / "small.avi", 3, (width // 2, height // 2))
    cut = clip(tmp_path / "cut.avi", 3, (width, height // 2))
    words = new(tmp_path / "made", "--masks", "none")
    refused(handtrack, tmp_path, [*words, "--video", f"cam0={small}"], ["0.5 times"])
    refused(handtrack, tmp_path, [*words, "--scaled", "--video", f"cam0={cut}"], ["cam0"])
    handtrack.does(*words, "--scaled", "--video", f"cam0={small}")
    assert Session.open(tmp_path / "made").rig["cam0"].size == (width // 2, height // 2)


def pictures(folder, count, size=SIZE):
    """Write numbered images; number n is n grey levels bright, times 40."""
    folder.mkdir(parents=True)
    for i in range(count):
        cv2.imwrite(str(folder / f"shot_{i:04d}.png"), np.full((*size[::-1], 3), 40 * i, np.uint8))
    return folder


def test_image_folders_and_depth_make_a_session(handtrack, tmp_path):
    images, depth = pictures(tmp_path / "left", 3), tmp_path / "deep"
    depth.mkdir()
    for i in range(2):
        cv2.imwrite(str(depth / f"{i}.png"), np.full(SIZE[::-1], 2000, np.uint16))
    words = new(tmp_path / "made", "--images", f"cam0={images}/*.png", "--depth", f"cam1={depth}")
    refused(handtrack, tmp_path, [*words, "--fps", 30], ["--depth cam1="])
    refused(handtrack, tmp_path, [*words, "--depth-scale", 0.0005], ["--fps"])
    handtrack.does(*words, "--fps", 30, "--depth-scale", 0.0005)
    session = Session.open(tmp_path / "made")
    assert session.frame_count == 3
    assert session.image("cam0", 2)[0, 0, 0] == 80
    assert session.view("cam1").depth_m(1)[5, 5] == 1.0
    assert session.has_clouds
    damaged = min((tmp_path / "made/depth").rglob("*.png"))
    damaged.write_bytes(damaged.read_bytes()[:100])
    assert [session.measured_cloud(frame) is None for frame in range(3)] == [True, False, True]
    assert [camera.masks is None for camera in session.file.cameras] == [False, True]


def test_links_are_read_by_who_made_them_alone(handtrack, tmp_path, monkeypatch):
    monkeypatch.setenv("HANDTRACK_HOME", str(tmp_path / "home"))
    film, images = clip(tmp_path / "a.avi", 3, SIZE), pictures(tmp_path / "left", 3)
    made, others = tmp_path / "made", tmp_path / "sent"
    sources = ["--video", f"cam0={film}", "--images", f"cam1={images}/*.png"]
    handtrack.does(*new(made, "--link", "--masks", "none", *sources))
    assert sorted(path.name for path in made.iterdir()) == ["calibration.toml", "session.toml"]
    session = Session.open(made)
    assert [round(session.image(n, 2).mean() / 40) for n in ("cam0", "cam1")] == [2, 2]
    drawn = tmp_path / "rig.png"
    handtrack.does("doctor", made, "--picture", drawn)
    assert cv2.imread(str(drawn)) is not None

    shutil.copytree(made, others)  # as somebody else's session would have the same words
    for other in (CALIBRATION, f"{tmp_path}/left/../../{tmp_path.parent.name}/a.avi"):
        changed = Path(shutil.copytree(made, tmp_path / "changed", dirs_exist_ok=True))
        edit(changed / "session.toml", str(film), str(other))
        (changed / "session.toml").replace(made / "session.toml")
        with pytest.raises(HandtrackError):
            Session.open(made)
        shutil.copyfile(others / "session.toml", made / "session.toml")
    with pytest.raises(HandtrackError):
        Session.open(others)
    monkeypatch.setenv("HANDTRACK_HOME", str(tmp_path / "somebody"))
    with pytest.raises(HandtrackError):
        Session.open(made)


class OneHand(FakeDetector):
    """Sees a hand in every image but the first frame's, of one side."""

    right = 0.03

    def seen(self, image):
        return [replace(hand_at(320, 240), right=self.right)] if image.mean() > 4 else []


class TrueJoints(FakeDetector):
    """Sees a right hand where it is, and takes it for a left one. Images are asked for in order."""

    def __init__(self, session):
        super().__init__()
        true, frames = session.truth.keypoints21, evenly_spread(session.frame_count, 12)
        self.points = (view.camera.project(true[f]) for f in frames for view in session.views)

    def find(self, *image):
        self.hands = [replace(hand_at(0, 0), points=next(self.points), right=0.05)]
        return super().find(*image)


def test_joints_in_space_tell_the_side_whatever_images_look_like(monkeypatch, capsys):
    session = Session.open(bundled_session("another_hand"))
    monkeypatch.setattr(HandDetector, "open", lambda _: TrueJoints(session))
    assert side_of_hand(session, Namespace(detector=None, yes=True)) == "right"
    assert "look like a left hand, 95 % sure" in capsys.readouterr().err
    mirrored = -session.truth.keypoints21
    assert side_of_frames(mirrored[::9]) == "left"


def test_the_side_is_seen_and_what_follows_is_done(handtrack, tmp_path, monkeypatch):
    done = []
    monkeypatch.setattr(HandDetector, "open", lambda *_: OneHand())
    monkeypatch.setattr(
        detection, "detect", lambda session, write, masks: done.append((session, write, masks))
    )
    monkeypatch.setattr(track, "run", lambda session, init: done.append((session, init)))
    monkeypatch.setattr(weights, "has_weights", lambda: False)
    monkeypatch.setattr(weights, "fetch_weights", lambda: done.append("fetched"))
    images = ["--images", f"cam0={pictures(tmp_path / 'left', 3)}", "--fps", 30]
    out = tmp_path / "a"
    ended = handtrack.does(*new(out, *images, "--track", "--yes"))
    assert "97 % sure" in ended.err
    assert Session.open(out).file.hand.side == "left"
    assert done == ["fetched", (out, True, True), (out, "auto")]

    monkeypatch.setattr(OneHand, "right", 0.6)
    handtrack.does(*new(tmp_path / "b", *images))
    assert Session.open(tmp_path / "b").file.hand.side == "right"
    handtrack.does(*new(tmp_path / "c", *images, "--side", "left"))
    assert Session.open(tmp_path / "c").file.hand.side == "left"
    assert len(done) == 3
    handtrack(*new(tmp_path / "d", *images, "--track", "--masks", "skin_ycrcb"))
    assert done[3] == (tmp_path / "d", True, False)


def test_without_weights_it_is_tracked_all_the_same_and_weights_that_are_named_must_be_some(
    handtrack, tmp_path, monkeypatch
):
    done = []
    monkeypatch.setenv("HANDTRACK_HOME", str(tmp_path / "home"))
    monkeypatch.delenv("HANDTRACK_DETECTOR", raising=False)
    monkeypatch.setattr(track, "run", lambda session, init: done.append(init))
    film = clip(tmp_path / "a.avi", 3, SIZE)
    words = new(tmp_path / "made", "--video", f"cam0={film}", "--track")
    refused(handtrack, tmp_path, [*words, "--detector", CALIBRATION], ["calibration.toml"])
    refused(handtrack, tmp_path, [*words, "--masks", "seeded"], ["no weights"])
    for yes, told in (([], "detector install"), (["--yes"], "pip says")):  # there is no network
        ended = handtrack(*words, *yes)
        assert (ended.code, done.pop()) == (0, "auto")
        assert told in ended.err
        shutil.rmtree(tmp_path / "made")


def test_new_takes_truth_along(handtrack, tmp_path):
    words = ["--video", f"cam0={SOURCE}/cam0.mp4", "--masks", "none"]
    (truth,) = sample("truth/trc", tmp_path / "truth")
    handtrack.does(*new(tmp_path / "made", *words, "--truth", truth))
    found = read_truth(tmp_path / "made/truth.npz").keypoints21
    np.testing.assert_allclose(found, moving(), atol=1e-7)


@pytest.fixture(scope="module")
def videos(tmp_path_factory):
    """Return options for two videos of three frames."""
    folder = tmp_path_factory.mktemp("videos")
    files = {name: clip(folder / f"{name}.avi", 3, SIZE) for name in ("cam0", "cam1")}
    return [word for name, path in files.items() for word in ("--video", f"{name}={path}")]


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_calibration_that_cannot_be_taken_is_refused_in_a_sentence(
    kind, handtrack, videos, tmp_path
):
    write, expected = HOSTILE[kind]
    folder = tmp_path / "given"
    folder.mkdir()
    path = write(folder)
    (tmp_path / "out").mkdir()
    words = ["new", "--out", tmp_path / "out", *videos, "--calibration", path]
    refused(handtrack, tmp_path / "out", words, expected)


def test_four_coefficients_are_taken_where_their_lens_is_said(handtrack, videos, tmp_path):
    rig = rig_of_two()
    (path,) = sample("calibration/json", tmp_path)
    tables = json.loads(path.read_text())
    for table in tables.values():
        table["dist"] = table["dist"][:4]
    path.write_text(json.dumps(tables))
    words = ["new", *videos, "--calibration", path, "--out"]
    for more in ([], ["--yes"]):
        assert handtrack(*words, tmp_path / "no", *more).code == 2
        assert not (tmp_path / "no").exists()
    handtrack.does(*words, tmp_path / "out", "--lens", "plain")
    kept = Session.open(tmp_path / "out").rig
    for camera in rig:
        assert np.allclose(kept[camera.name].distortions, [*camera.distortions[:4], 0.0])


SPOTS = np.array([[0.0, 0.0, 0.5], [0.12, 0.05, 0.5], [-0.2, 0.1, 0.6], [0.05, -0.15, 0.45]])


def test_images_of_fisheyes_show_points_where_the_session_s_cameras_do(handtrack, tmp_path):
    tables, (rig,) = fisheyes(), sample("calibration/fisheye_json", tmp_path)
    options = []
    for name, table in tables.items():
        (tmp_path / name).mkdir()
        seen = rig_of_two()[name].to_camera(SPOTS)[:, None]
        lens = np.array(table["matrix"]), np.array(table["distortions"])
        image = np.zeros((480, 640, 3), np.uint8)
        for u, v in cv2.fisheye.projectPoints(seen, np.zeros(3), np.zeros(3), *lens)[0][:, 0]:
            cv2.circle(image, (round(u), round(v)), 1, (255, 255, 255), -1)
        cv2.imwrite(str(tmp_path / name / "000.png"), image)
        options += ["--images", f"{name}={tmp_path / name}/*.png"]
    handtrack.does(
        "new", "--out", tmp_path / "s", *options, "--fps", 30, "--calibration", rig, "--masks", "none"
    )  # fmt: skip
    session = Session.open(tmp_path / "s")
    shown = set()
    for view in session.views:
        image, (width, height) = view.image(0), view.camera.size
        for i, spot in enumerate(SPOTS):
            u, v = view.camera.project(spot)
            if 0 < u < width - 1 and 0 < v < height - 1:
                assert image[round(v), round(u), 0] > 105  # within 1.5 px
                shown.add(i)
    assert len(shown) == len(SPOTS)
