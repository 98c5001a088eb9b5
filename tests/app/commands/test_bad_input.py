"""Bad input, end to end: one readable paragraph, exit code 2, and nothing written."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack.session.bundled import bundled_session
from handtrack.session.formats.tables import read_npz, write_arrays
from tests.app.command_line import FRAMES, refused
from tests.session.small_session import edit

VIDEO = bundled_session("open_fist_open") / "cam0.mp4"


@pytest.fixture
def session(tracked, tmp_path):
    return Path(shutil.copytree(tracked, tmp_path / "session"))


# ---- sessions that cannot be used ------------------------------------------------------------------

Damage = Callable[[Path], None]


def settings(old: str, new: str) -> Damage:
    return lambda folder: edit(folder / "session.toml", old, new)


def calibration(old: str, new: str) -> Damage:
    return lambda folder: edit(folder / "calibration.toml", old, new)


def camera_value(key: str, value: str) -> Damage:
    """Give the first camera of the calibration another value."""

    def damage(folder: Path) -> None:
        path = folder / "calibration.toml"
        lines = path.read_text().splitlines()
        at = next(i for i, line in enumerate(lines) if line.startswith(f"{key} = "))
        lines[at] = f"{key} = {value}"
        path.write_text("\n".join(lines))

    return damage


def init(**changes: object) -> Damage:
    def damage(folder: Path) -> None:
        data = json.loads((folder / "init.json").read_text())
        data = {key: value for key, value in {**data, **changes}.items() if value is not None}
        (folder / "init.json").write_text(json.dumps(data))

    return damage


def timestamps(text: str) -> Damage:
    def damage(folder: Path) -> None:
        (folder / "t.csv").write_text(text)
        edit(folder / "session.toml", "fps = 25.0", 'timestamps = "t.csv"')

    return damage


def other_size(folder: Path) -> None:
    file = folder / "masks/cam1/000000.png"
    cv2.imwrite(str(file), np.zeros((240, 320), np.uint8))


SESSIONS: dict[str, tuple[Damage, str]] = {
    "camera not in the calibration": (settings('name = "cam1"', 'name = "cam7"'), "cam7"),
    "NaN in the calibration": (camera_value("translation", "[0.0, nan, 0.5]"), "nan"),
    "calibrated for another size": (camera_value("size", "[1280, 960]"), "image_size = [640, 480]"),
    "one camera's masks of another size": (other_size, "320 x 240"),
    "no calibration": (
        lambda folder: (folder / "calibration.toml").unlink(),
        "calibration.toml: no such file",
    ),
    "unknown key": (settings("fps = 25.0", "fps = 25.0\nframes = 5"), "frames"),
    "unknown setting of the tracker": (
        settings("[tracking]", "[tracking]\nsolver.iter = 3"),
        "solver.iter",
    ),
    "a newer session": (settings("format = 1", "format = 2"), "format = 2"),
    "out of the folder": (settings('"masks/cam0/*.png"', '"../masks/*.png"'), "cam0"),
    "no TOML": (settings("fps = 25.0", "fps = = 25"), "line"),
    "no masks there": (settings('"masks/cam0/*.png"', '"mask/cam0/*.png"'), "cam0"),
    "no first pose": (lambda folder: (folder / "init.json").unlink(), "--init"),
    "NaN in the first pose": (init(xyz=[[float("nan")] * 3] * 21), "null"),
    "first pose in millimetres": (init(xyz=[[0.0, 0.0, 10.0 * k] for k in range(21)]), "init.json"),
    "first pose after the end": (init(frame=77), "init.json: frame = 77"),
    "times without order": (timestamps("camera,frame,time_s\ncam0,0,1.0\ncam0,1,0.5\n"), "cam0"),
}


@pytest.mark.parametrize("case", SESSIONS)
def test_a_session_that_cannot_be_used(case, handtrack, session):
    """Faults C25, C26, C30, C36."""
    damage, word = SESSIONS[case]
    damage(session)
    refused(handtrack, session.parent, ["track", session], [word])


# ---- results that cannot be used -------------------------------------------------------------------


def changed_poses(path: Path, **changes: object) -> None:
    with np.load(path) as data:
        arrays = {name: data[name] for name in data.files} | changes
    write_arrays(path, {name: np.asarray(a) for name, a in arrays.items() if a is not None})


def test_damaged_poses(handtrack, session):
    poses, whole = session / "tracks/poses.npz", (session / "tracks/poses.npz").read_bytes()
    for changes, word in (
        ({"format": 3}, "format 3"),
        ({"parameters": None}, "parameters"),
        ({"frame": np.arange(4)}, "shape"),
        ({"status": np.full(FRAMES, 9)}, "status"),
    ):
        changed_poses(poses, **changes)
        refused(handtrack, session.parent, ["export", poses, "--to", "csv"], [word])
        words = ["evaluate", poses, "--truth", session / "truth.npz"]
        refused(handtrack, session.parent, words, [word])
        poses.write_bytes(whole)


def test_poses_that_are_cut_off(handtrack, session):
    poses = session / "tracks/poses.npz"
    poses.write_bytes(poses.read_bytes()[:5000])
    expected = ["poses.npz: not a readable .npz"]
    refused(handtrack, session.parent, ["export", poses, "--to", "csv"], expected)


def test_a_truth_that_says_nothing(handtrack, session):
    words = ["evaluate", session / "tracks/poses.npz", "--truth", session / "truth.npz"]
    for truth, word in (
        ({"joint_names": np.array(["elbow"]), "joint_positions": np.zeros((5, 1, 3))}, "elbow"),
        ({"keypoints21": np.zeros((5, 20, 3))}, "(5, 20, 3)"),
        ({"keypoints21": np.full((5, 21, 3), np.nan)}, "truth.npz"),
        ({"keypoints21": np.zeros((2, 21, 3)), "frame": np.array([70, 71])}, "70 to 71"),
        ({"time_s": np.zeros(5)}, "keypoints21"),
    ):
        np.savez(session / "truth.npz", **truth)
        refused(handtrack, session.parent, words, [word])


# ---- odd, and yet no error -------------------------------------------------------------------------


def fill_masks(session: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    for file in (session / "masks").rglob("*.png"):
        cv2.imwrite(str(file), change(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)))


def test_a_truth_in_millimetres_is_asked_about(handtrack, session):
    with np.load(session / "truth.npz") as truth:
        np.savez(session / "mm.npz", keypoints21=1000 * truth["keypoints21"])
    ended = handtrack("evaluate", session / "tracks/poses.npz", "--truth", session / "mm.npz")
    assert ended.code == 0
    assert "mm.npz" in ended.err


def test_empty_masks_are_lost_frames(handtrack, session):
    fill_masks(session, np.zeros_like)
    ended = handtrack("track", session)
    assert ended.code == 0
    track = read_npz(session / "tracks/poses.npz")
    assert (track.status != 0).all()
    assert np.isfinite(track.parameters).all()
    assert "0 tracked" in ended.out
    assert "the first: model and silhouette overlap by 0 %" in ended.err
    doctor = handtrack("doctor", session)
    assert "error: camera 'cam0': all masks looked at (5) are empty." in doctor.out


def test_inverted_masks_are_found_by_the_doctor(handtrack, session):
    """Fault C18."""
    fill_masks(session, np.bitwise_not)
    ended = handtrack("doctor", session)
    assert ended.code == 0
    assert "warning: camera 'cam0': in 5 of 5 masks more than half" in ended.out
    assert "Are they inverted? Expected 0 background, 255 hand." in ended.out


def test_missing_masks_are_misses(handtrack, session):
    for camera in ("cam0", "cam1", "cam2"):
        (session / "masks" / camera / "000002.png").unlink()
    (session / "masks/cam0/000003.png").write_bytes(b"no picture")
    ended = handtrack("track", session)
    assert ended.code == 0
    assert read_npz(session / "tracks/poses.npz").status.tolist() == [0, 0, 2, 0, 0]
    assert (
        "note: lost: frames 2; the first: no camera has an observation of this frame." in ended.err
    )
    assert "000003.png: not a readable image; frame 3 counts as missing" in ended.err


def test_a_mirrored_camera_is_found(handtrack, session):
    """A camera whose pose is another's mirror image shows the hand elsewhere: the doctor compares. Fault C26."""
    camera_value("translation", "[0.0, 0.0, -0.5]")(session)
    ended = handtrack("doctor", session)
    assert ended.code == 0
    assert "warning: init.json, frame 0: " in ended.out
    assert "camera 'cam0'" in ended.out


def test_millimetres_are_suspected(handtrack, session):
    path = session / "calibration.toml"
    lines = path.read_text().splitlines()
    for i, line in enumerate(lines):
        if line.startswith("translation = "):
            metres = json.loads(line.partition(" = ")[2])
            lines[i] = f"translation = {[1000 * x for x in metres]}"
    path.write_text("\n".join(lines))
    ended = handtrack("doctor", session)
    assert ended.code == 0
    assert "Is calibration.toml in millimetres? Then world_unit_m = 0.001." in ended.out


def cut_video(session: Path) -> None:
    """Give a camera a video that announces more frames than it has."""
    path = session / "cam0.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 25.0, (640, 480))
    reader = cv2.VideoCapture(str(VIDEO))
    for _ in range(FRAMES):
        writer.write(reader.read()[1])
    writer.release()
    path.write_bytes(path.read_bytes()[: int(0.5 * path.stat().st_size)])
    skin = 'images = "cam0.avi"\nmasks = { method = "skin_ycrcb" }'
    edit(session / "session.toml", 'masks = "masks/cam0/*.png"', skin)


def test_a_cut_video_is_tracked_as_far_as_it_goes(handtrack, session):
    """The camera's images end early: its later frames are missing observations, and a note says so. Fault C1."""
    cut_video(session)
    ended = handtrack("track", session)
    assert ended.code == 0
    assert "5 of 5 frames: 5 tracked" in ended.out
    assert "cam0.avi: announces 5 frames, but only" in ended.err


def test_a_recording_that_is_shorter_than_its_video_says_is_tracked_to_its_end(
    handtrack, session, monkeypatch
):
    """Tracking does not wait for the frames to be counted; here that is done last, and shows that they end earlier."""
    monkeypatch.setattr("handtrack_app.commands.track.count_beside", lambda *_: None)
    cut_video(session)
    for mask in session.glob("masks/*/*.png"):
        if int(mask.stem) >= FRAMES - 1:
            mask.unlink()
    ended = handtrack("track", session)
    assert ended.code == 0
    assert f"{FRAMES - 1} of {FRAMES - 1} frames" in ended.out
    assert "cam0.avi: announces 5 frames, but only" in ended.err
    track = read_npz(session / "tracks" / "poses.npz")
    assert track.frame.tolist() == list(range(FRAMES - 1))
