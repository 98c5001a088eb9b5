"""`handtrack new` with videos that do not simply go together."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack.detector.hand_detector import DetectedHand, HandDetector, Region, whole_image
from handtrack.errors import HandtrackError
from handtrack.session.bundled import bundled_session
from handtrack.session.formats.truth import read_truth
from handtrack.session.session import Session
from handtrack_app.commands import detection, track
from tests.app.command_line import refused
from tests.session.small_session import edit
from tests.session.test_truth import moving, trc


def video(path: Path, fps: float, count: int, size: tuple[int, int]) -> Path:
    """Write a video whose frame n is n grey levels bright, times 8."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), fps, size)
    for level in range(count):
        writer.write(np.full((size[1], size[0], 3), 8 * level, np.uint8))
    writer.release()
    return path


def test_c11_scaled_videos_are_taken_where_that_is_said(handtrack, tmp_path):
    calibration = bundled_session() / "calibration.toml"
    width, height = Session.open(bundled_session()).rig["cam0"].size
    small = video(tmp_path / "small.avi", 25, 3, (width // 2, height // 2))
    cut = video(tmp_path / "cut.avi", 25, 3, (width, height // 2))
    words = ["new", "--out", tmp_path / "made", "--calibration", calibration, "--masks", "none"]
    refused = handtrack(*words, "--video", f"cam0={small}")
    assert refused.code == 2
    assert "0.5 times as large" in refused.err
    refused = handtrack(*words, "--scaled", "--video", f"cam0={cut}")
    assert refused.code == 2
    assert handtrack(*words, "--scaled", "--video", f"cam0={small}").code == 0
    assert Session.open(tmp_path / "made").rig["cam0"].size == (width // 2, height // 2)


def test_c7_videos_of_different_rates_are_joined_by_time(handtrack, tmp_path):
    calibration = bundled_session() / "calibration.toml"
    size = Session.open(bundled_session()).rig["cam0"].size
    slow, fast = (video(tmp_path / f"{fps}.avi", fps, fps // 5, size) for fps in (25, 100))
    ended = handtrack(
        "new", "--out", tmp_path / "made", "--calibration", calibration, "--masks", "none",
        "--video", f"cam0={slow}", "--video", f"cam1={fast}",
    )  # fmt: skip
    assert ended.code == 0
    assert "the video of camera 'cam1' says 100 frames a second, the first 25" in ended.err
    session = Session.open(tmp_path / "made")
    assert [camera.fps for camera in session.file.cameras] == [None, 100.0]
    seen = [session.image(name, 4) for name in session.camera_names]
    levels = [-1 if image is None else round(float(image.mean()) / 8) for image in seen]
    assert levels == [4, 16]


def pictures(folder: Path, count: int, size: tuple[int, int], first: int = 0) -> Path:
    """Write numbered images; number n is n grey levels bright, times 8."""
    folder.mkdir(parents=True)
    for i in range(count):
        cv2.imwrite(
            str(folder / f"shot_{first + i:04d}.png"),
            np.full((size[1], size[0], 3), 8 * i, np.uint8),
        )
    return folder


def depths(folder: Path, count: int, size: tuple[int, int]) -> Path:
    """Write numbered depth files of 2000 units."""
    folder.mkdir(parents=True)
    for i in range(count):
        cv2.imwrite(str(folder / f"{i}.png"), np.full((size[1], size[0]), 2000, np.uint16))
    return folder


def test_image_folders_and_depth_make_a_session(handtrack, tmp_path):
    calibration = bundled_session() / "calibration.toml"
    size = Session.open(bundled_session()).rig["cam0"].size
    images, depth = pictures(tmp_path / "left", 3, size), depths(tmp_path / "deep", 2, size)
    words = [
        "new", "--out", tmp_path / "made", "--calibration", calibration, "--images", f"cam0={images}/*.png",
        "--depth", f"cam1={depth}", "--fps", 30,
    ]  # fmt: skip
    refused(handtrack, tmp_path, words, ["--depth cam1="])
    refused(handtrack, tmp_path, [*words[:-2], "--depth-scale", 0.0005], ["give it with --fps"])
    assert handtrack(*words, "--depth-scale", 0.0005).code == 0
    session = Session.open(tmp_path / "made")
    assert session.frame_count == 3
    assert session.image("cam0", 2)[0, 0, 0] == 16
    assert session.view("cam1").depth_m(1)[5, 5] == 1.0
    assert session.has_clouds
    assert [camera.masks is None for camera in session.file.cameras] == [False, True]


def test_links_are_read_by_who_made_them_alone(handtrack, tmp_path, monkeypatch):
    monkeypatch.setenv("HANDTRACK_HOME", str(tmp_path / "home"))
    calibration = bundled_session() / "calibration.toml"
    size = Session.open(bundled_session()).rig["cam0"].size
    film, images = video(tmp_path / "a.avi", 25, 3, size), pictures(tmp_path / "left", 3, size)
    made = tmp_path / "made"
    words = ["new", "--out", made, "--calibration", calibration, "--link", "--masks", "none"]
    assert (
        handtrack(*words, "--video", f"cam0={film}", "--images", f"cam1={images}/*.png").code == 0
    )
    assert sorted(path.name for path in made.iterdir()) == ["calibration.toml", "session.toml"]
    session = Session.open(made)
    assert session.file.cameras[0].images == str(film)
    assert [round(session.image(n, 2).mean() / 8) for n in ("cam0", "cam1")] == [2, 2]
    assert handtrack("doctor", made).code == 0

    other = (
        tmp_path / "sent"
    )  # the same words in another folder, as somebody else's session would have them
    shutil.copytree(made, other)
    with pytest.raises(HandtrackError):
        Session.open(other)
    edit(made / "session.toml", str(film), str(calibration))  # another folder than the linked one
    with pytest.raises(HandtrackError):
        Session.open(made)
    edit(
        made / "session.toml",
        str(calibration),
        f"{tmp_path}/left/../../{tmp_path.parent.name}/a.avi",
    )
    with pytest.raises(HandtrackError):
        Session.open(made)
    monkeypatch.setenv("HANDTRACK_HOME", str(tmp_path / "somebody"))
    edit(made / "session.toml", f"{tmp_path}/left/../../{tmp_path.parent.name}/a.avi", str(film))
    with pytest.raises(HandtrackError):
        Session.open(made)


class OneHand:
    """Stands in for the detector: sees a hand in every image but the first frame's, of one side."""

    backend = "fake"
    right = 0.98

    def find(self, image: np.ndarray, most: int) -> list[Region]:
        return [whole_image(image.shape[1], image.shape[0])] if image.mean() > 4 else []

    def hand(self, image: np.ndarray, region: Region) -> DetectedHand:
        return DetectedHand(np.zeros((21, 2)), 0.9, self.right)


def test_the_side_is_seen_and_what_follows_is_done(handtrack, tmp_path, monkeypatch):
    done: list[list[str]] = []
    monkeypatch.setattr(HandDetector, "open", lambda *_: OneHand())
    monkeypatch.setattr(
        detection,
        "detect",
        lambda args: done.append(["detect", str(args.session), args.write, args.masks]),
    )
    monkeypatch.setattr(
        track, "run", lambda args: done.append(["track", str(args.session), args.init])
    )
    calibration = bundled_session() / "calibration.toml"
    images = pictures(tmp_path / "left", 3, Session.open(bundled_session()).rig["cam0"].size)
    words = ["new", "--calibration", calibration, "--images", f"cam0={images}", "--fps", 30]
    monkeypatch.setattr(OneHand, "right", 0.03)
    ended = handtrack(*words, "--out", tmp_path / "a", "--track")
    assert ended.code == 0
    assert "side: left, 97 % sure (a hand is detected in 2 of 3 images)." in ended.err
    assert Session.open(tmp_path / "a").file.hand.side == "left"
    assert done == [
        ["detect", str(tmp_path / "a"), True, True],
        ["track", str(tmp_path / "a"), "auto"],
    ]

    monkeypatch.setattr(OneHand, "right", 0.6)
    made = handtrack(*words, "--out", tmp_path / "b")
    assert "side: right, 60 % sure" in made.err
    assert f"masks by them, are found with: handtrack detect {tmp_path / 'b'} --write" in made.err
    assert "which hand" not in handtrack(*words, "--out", tmp_path / "c", "--side", "left").err
    assert Session.open(tmp_path / "c").file.hand.side == "left"
    assert len(done) == 2
    handtrack(*words, "--out", tmp_path / "d", "--track", "--masks", "skin_ycrcb")
    assert done[2] == ["detect", str(tmp_path / "d"), True, False]


def test_without_weights_it_is_tracked_all_the_same_and_weights_that_are_named_must_be_some(
    handtrack, tmp_path, monkeypatch
):
    done: list[str] = []
    monkeypatch.setenv("HANDTRACK_HOME", str(tmp_path / "home"))
    monkeypatch.delenv("HANDTRACK_DETECTOR", raising=False)
    monkeypatch.setattr(track, "run", lambda args: done.append(args.init))
    calibration = bundled_session() / "calibration.toml"
    words = [
        "new",
        "--out",
        tmp_path / "made",
        "--calibration",
        calibration,
        "--video",
        f"cam0={bundled_session()}/cam0.mp4",
        "--track",
    ]
    refused(handtrack, tmp_path, [*words, "--detector", calibration], ["calibration.toml"])
    refused(handtrack, tmp_path, [*words, "--masks", "seeded"], ["no weights"])
    for yes in ([], ["--yes"]):  # that agrees to fetch it, and there is no network
        ended = handtrack(*words, *yes)
        assert (ended.code, done.pop()) == (0, "auto")
        shutil.rmtree(tmp_path / "made")


def test_new_takes_truth_along(handtrack, tmp_path):
    source = bundled_session()
    words = [
        "--calibration",
        source / "calibration.toml",
        "--video",
        f"cam0={source}/cam0.mp4",
        "--masks",
        "none",
    ]
    ended = handtrack("new", "--out", tmp_path / "made", *words, "--truth", trc(tmp_path / "t.trc"))
    assert ended.code == 0
    np.testing.assert_allclose(
        read_truth(tmp_path / "made/truth.npz").keypoints21, moving(), atol=1e-7
    )
