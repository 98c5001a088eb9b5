"""`handtrack new --project`: Pose2Sim's folders as its versions lay them out."""

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack import CameraRig, Session
from handtrack.capture.calibration.rig_file import write_rig
from tests.app.command_line import refused
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
def test_everything_is_found(version, handtrack, tmp_path):
    ended = handtrack.does(
        "new", "--out", tmp_path / "made", "--project", project(tmp_path / "p", version)
    )
    assert f"the calibration is {tmp_path / 'p' / CALIBRATIONS[version]}" in ended.err
    assert "no video of cam1: joints alone." in ended.err
    session = Session.open(tmp_path / "made")
    assert (session.file.session.fps, session.file.hand.model) == (60.0, "body34")
    first, second = session.file.cameras
    assert (first.images, second.images) == ("cam0/*.png", None)
    assert [c.keypoint_layout for c in (first, second)] == ["halpe26"] * 2
    assert session.frame_count == len(pixels())


def test_cameras_of_other_names_are_taken_in_order(handtrack, tmp_path):
    trial = project(tmp_path / "p", names=("int_a_img", "int_b_img"))
    ended = handtrack.does("new", "--out", tmp_path / "made", "--project", trial)
    assert "in order, as Pose2Sim does: cam0 is 'int_a_img', cam1 is 'int_b_img'." in ended.err
    session = Session.open(tmp_path / "made")
    seen = session.view("int_b_img").keypoints(5, 1.0)[0]
    assert seen.pixels[seen.names.index("nose")] == pytest.approx(pixels(1)[5][4], abs=0.01)


def test_what_pose2sim_synchronised_stays_so(handtrack, tmp_path):
    """In `pose-sync` the second camera's files are renumbered: what is frame 5 there is 7 in its video and in `pose`."""
    trial = project(tmp_path / "p")
    shutil.copytree(trial / "pose" / "cam0_json", trial / "pose-sync" / "cam0_json")
    later = trial / "pose-sync" / "cam1_json"
    later.mkdir()
    for f in range(2, len(pixels())):
        shutil.copyfile(trial / f"pose/cam1_json/cam_{f:05d}.json", later / f"cam_{f - 2:05d}.json")
    ended = handtrack.does("new", "--out", tmp_path / "made", "--project", trial)
    assert "synchronised as in pose-sync: cameras are late by frames: cam1 by 2." in ended.err
    session = Session.open(tmp_path / "made")
    for camera, own in (("cam0", 5), ("cam1", 7)):
        seen = session.view(camera).keypoints(5, 1.0)[0]
        nose = pixels(int(camera[-1]))[own][4]
        assert seen.pixels[seen.names.index("nose")] == pytest.approx(nose, abs=0.01)
    for path in later.iterdir():
        path.write_text(path.read_text().replace("0.8", "0.7"))
    ended = handtrack("new", trial, "--out", tmp_path / "bare")
    assert ended.code == 2 and f"--project {trial}" in ended.err
    words = ["new", "--out", tmp_path / "other", "--project", trial]
    refused(handtrack, tmp_path, words, ["holds other joints than"])
