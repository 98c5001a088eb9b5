"""Bad input, end to end: one readable paragraph, exit code 2, and nothing written; or what is usable of it is used."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack import bundled_session, read_npz
from tests.app.command_line import FRAMES, refused
from tests.session.small_session import edit

VIDEO = bundled_session("open_fist_open") / "cam0.mp4"


def init(folder, **changes):
    data = json.loads((folder / "init.json").read_text())
    (folder / "init.json").write_text(json.dumps(data | changes))


def small_mask(folder):
    cv2.imwrite(str(folder / "masks/cam1/000000.png"), np.zeros((240, 320), np.uint8))


SESSIONS: dict[str, tuple[Callable[[Path], object], str]] = {
    "calibrated for another size": (
        lambda f: edit(f / "calibration.toml", "[640, 480]", "[1280, 960]"),
        "image_size = [640, 480]",
    ),
    "one camera's masks of another size": (small_mask, "320 x 240"),
    "no calibration": (lambda f: (f / "calibration.toml").unlink(), "calibration.toml"),
    "NaN in the first pose": (lambda f: init(f, xyz=[[float("nan")] * 3] * 21), "null"),
    "first pose in millimetres": (
        lambda f: init(f, xyz=[[0.0, 0.0, 10.0 * k] for k in range(21)]),
        "init.json",
    ),
}


@pytest.mark.parametrize("case", SESSIONS)
def test_a_session_that_cannot_be_used(case, handtrack, session):
    damage, word = SESSIONS[case]
    damage(session)
    refused(handtrack, session.parent, ["track", session], [word])


def test_a_truth_that_says_nothing_is_refused_and_one_in_millimetres_asked_about(
    handtrack, tracked, tmp_path
):
    path = tmp_path / "truth.npz"
    words = ["evaluate", tracked / "tracks/poses.npz", "--truth", path]
    for truth, word in (
        ({"joint_names": np.array(["elbow"]), "joint_positions": np.zeros((5, 1, 3))}, "elbow"),
        ({"keypoints21": np.full((5, 21, 3), np.nan)}, "truth.npz"),
        ({"keypoints21": np.zeros((2, 21, 3)), "frame": np.array([70, 71])}, "70 to 71"),
    ):
        np.savez(path, **truth)
        refused(handtrack, tmp_path, words, [word])
    with np.load(tracked / "truth.npz") as truth:
        np.savez(path, keypoints21=1000 * truth["keypoints21"])
    ended = handtrack.does(*words)
    assert "truth.npz" in ended.err


def test_missing_masks_are_misses(handtrack, session):
    for camera in ("cam0", "cam1", "cam2"):
        (session / "masks" / camera / "000002.png").unlink()
    (session / "masks/cam0/000003.png").write_bytes(b"no picture")
    ended = handtrack.does("track", session)
    assert read_npz(session / "tracks/poses.npz").status.tolist() == [0, 0, 2, 0, 0]
    assert "lost: frames 2" in ended.err
    assert "000003.png" in ended.err


def test_a_recording_that_is_shorter_than_its_video_says_is_tracked_to_its_end(
    handtrack, session, monkeypatch
):
    """Tracking does not wait for the frames to be counted; here that is done last, and shows that they end earlier."""
    monkeypatch.setattr("handtrack_app.commands.track.count_beside", lambda *_: None)
    path = session / "cam0.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (640, 480))
    reader = cv2.VideoCapture(str(VIDEO))
    for _ in range(FRAMES):
        writer.write(reader.read()[1])
    writer.release()
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    skin = 'images = "cam0.avi"\nmasks = { method = "skin_ycrcb" }'
    edit(session / "session.toml", 'masks = "masks/cam0/*.png"', skin)
    for mask in session.glob(f"masks/*/*{FRAMES - 1}.png"):
        mask.unlink()
    ended = handtrack.does("track", session)
    assert f"{FRAMES - 1} of {FRAMES - 1} frames" in ended.out
    assert "cam0.avi: announces 5 frames" in ended.err
    assert read_npz(session / "tracks/poses.npz").frame.tolist() == list(range(FRAMES - 1))
