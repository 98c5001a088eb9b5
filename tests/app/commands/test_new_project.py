"""`handtrack new --project`: Pose2Sim's folders as its versions lay them out."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack.capture.calibration.rig_file import write_rig
from handtrack.geometry.camera import CameraRig
from handtrack.session.session import Session
from tests.app.command_line import CommandLine, refused
from tests.capture.joints.people import in_order, openpose, pixels, rig

CALIBRATIONS = {
    "now": "trial/calibration/Calib_scene.toml",
    "a session's": "S00_Calibration/Calib.toml",
    "the first versions'": "trial/calib-2d/Calib_qca.toml",
    "beside the joints": "trial/Calib.toml",
}
POSES = {
    "now": "pose",
    "a session's": "pose",
    "the first versions'": "pose-2d",
    "beside the joints": "pose",
}


def project(
    folder: Path,
    version: str = "now",
    names: tuple[str, str] = ("cam0", "cam1"),
    layout: str = "halpe26",
) -> Path:
    """Make a project whose trial is `trial`: two cameras' joints, a video of the first, settings in both levels."""
    calibration = folder / CALIBRATIONS[version]
    calibration.parent.mkdir(parents=True)
    cameras = tuple(replace(c, name=n) for c, n in zip(rig(), names, strict=True))
    write_rig(calibration, CameraRig(cameras))
    for i in range(2):
        people = {f: [in_order(layout, p)] for f, p in enumerate(pixels(i))}
        openpose(folder / "trial" / POSES[version] / f"cam{i}_json", people, "cam_{:05d}.json")
    images = (
        folder / "trial" / ("raw-2d" if version == "the first versions'" else "videos") / "cam0"
    )
    images.mkdir(parents=True)
    for frame in range(3):
        cv2.imwrite(str(images / f"{frame:04d}.png"), np.zeros((480, 640, 3), np.uint8))
    (folder / "Config.toml").write_text(
        '[project]\nframe_rate = 50\n[pose]\npose_model = "Body_with_feet"\n'
    )
    (folder / "trial" / "Config.toml").write_text("[project]\nframe_rate = 60\n")
    return folder / "trial"


@pytest.mark.parametrize("version", CALIBRATIONS)
def test_everything_is_found(version: str, handtrack: CommandLine, tmp_path: Path) -> None:
    ended = handtrack(
        "new", "--out", tmp_path / "made", "--project", project(tmp_path / "p", version)
    )
    assert ended.code == 0, ended.err
    assert f"the calibration is {tmp_path / 'p' / CALIBRATIONS[version]}" in ended.err
    assert "no video of cam1: joints alone." in ended.err
    session = Session.open(tmp_path / "made")
    assert (session.file.session.fps, session.file.hand.model) == (60.0, "body34")
    first, second = session.file.cameras
    assert (first.images, second.images) == ("cam0/*.png", None)
    assert [c.keypoint_layout for c in (first, second)] == ["halpe26"] * 2
    assert session.frame_count == len(pixels())


def test_cameras_of_other_names_are_taken_in_order(handtrack: CommandLine, tmp_path: Path) -> None:
    trial = project(tmp_path / "p", names=("int_a_img", "int_b_img"))
    ended = handtrack("new", "--out", tmp_path / "made", "--project", trial)
    assert ended.code == 0, ended.err
    assert "in order, as Pose2Sim does: cam0 is 'int_a_img', cam1 is 'int_b_img'." in ended.err
    session = Session.open(tmp_path / "made")
    seen = session.view("int_b_img").keypoints(5, 1.0)[0]
    assert seen.pixels[seen.names.index("nose")] == pytest.approx(pixels(1)[5][4], abs=0.01)


def test_what_pose2sim_synchronised_stays_so(handtrack: CommandLine, tmp_path: Path) -> None:
    """In `pose-sync` the second camera's files are renumbered: what is frame 5 there is 7 in its video and in `pose`."""
    trial = project(tmp_path / "p")
    shutil.copytree(trial / "pose" / "cam0_json", trial / "pose-sync" / "cam0_json")
    later = trial / "pose-sync" / "cam1_json"
    later.mkdir()
    for f in range(2, len(pixels())):
        shutil.copyfile(trial / f"pose/cam1_json/cam_{f:05d}.json", later / f"cam_{f - 2:05d}.json")
    ended = handtrack("new", "--out", tmp_path / "made", "--project", trial)
    assert ended.code == 0, ended.err
    assert "synchronised as in pose-sync: cameras are late by frames: cam1 by 2." in ended.err
    session = Session.open(tmp_path / "made")
    for camera, own in (("cam0", 5), ("cam1", 7)):
        seen = session.view(camera).keypoints(5, 1.0)[0]
        nose = pixels(int(camera[-1]))[own][4]
        assert seen.pixels[seen.names.index("nose")] == pytest.approx(nose, abs=0.01)
    for path in later.iterdir():
        path.write_text(path.read_text().replace("0.8", "0.7"))
    words = ["new", "--out", tmp_path / "other", "--project", trial]
    refused(
        handtrack, tmp_path, words, ["holds other joints than", "Remove one of the two folders"]
    )


def test_settings_decide_what_joints_leave_open(handtrack: CommandLine, tmp_path: Path) -> None:
    trial = project(tmp_path / "p", layout="body_25")
    for path in trial.glob("pose/*/*.json"):  # a right arm alone
        numbers = np.zeros((25, 3))
        numbers[2:5] = (100.0, 100.0, 0.8)
        openpose(path.parent / "x", {0: [numbers]})
        path.write_text(next((path.parent / "x").iterdir()).read_text())
        shutil.rmtree(path.parent / "x")
    words = ["new", "--out", tmp_path / "made", "--project", trial, "--world-unit-m", 1]
    refused(handtrack, tmp_path, words, ["may be body_25 or body_25b"])
    (trial / "Config.toml").write_text('[pose]\npose_model = "BODY_25B"\n')
    assert handtrack(*words).code == 0
    assert Session.open(tmp_path / "made").file.cameras[0].keypoint_layout == "body_25b"


def test_what_the_user_says_goes_before(handtrack: CommandLine, tmp_path: Path) -> None:
    trial = project(tmp_path / "p")
    other = tmp_path / "other.toml"
    shutil.copyfile(trial / "calibration/Calib_scene.toml", other)
    other_joints = openpose(tmp_path / "j", {0: [in_order("coco17", pixels()[3])]})
    ended = handtrack(
        "new", "--out", tmp_path / "made", "--project", trial, "--calibration", other, "--fps", 25, "--keypoints", f"cam0={other_joints}",
    )  # fmt: skip
    assert ended.code == 0, ended.err
    file = Session.open(tmp_path / "made").file
    assert (file.session.fps, file.cameras[0].keypoint_layout) == (25.0, "coco17")


def test_what_lacks_is_told(handtrack: CommandLine, tmp_path: Path) -> None:
    trial = project(tmp_path / "p")
    words: list[object] = ["new", "--out", tmp_path / "made", "--project"]
    refused(
        handtrack,
        tmp_path,
        [*words, tmp_path / "none"],
        ["no such folder; expected a Pose2Sim project"],
    )
    refused(handtrack, tmp_path, [*words, trial.parent], ["It holds trials", f"--project {trial}"])
    refused(
        handtrack,
        tmp_path,
        words[:-1],
        ["--calibration FILE, or a Pose2Sim project with --project"],
    )
    calibration = trial / "calibration" / "Calib_scene.toml"
    shutil.copyfile(calibration, calibration.with_name("Calib_board.toml"))
    refused(
        handtrack,
        tmp_path,
        [*words, trial],
        ["several calibrations", "Calib_board.toml, Calib_scene.toml"],
    )
    calibration.with_name("Calib_board.toml").unlink()
    write_rig(calibration, CameraRig(tuple(rig(3))))
    shutil.move(trial / "pose/cam0_json", trial / "pose/left_json")
    refused(
        handtrack, tmp_path, [*words, trial], ["cameras cam0, cam1, cam2, but joints of cam1, left"]
    )
    calibration.unlink()
    refused(handtrack, tmp_path, [*words, trial], ["no calibration in it", "--calibration"])
