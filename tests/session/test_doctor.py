"""The doctor says what is odd without refusing it."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack.geometry.camera import Camera, CameraRig
from handtrack.session.doctor import check_hand
from handtrack.session.doctor.check_outlines import check_outlines
from handtrack.session.doctor.examine import examine
from handtrack.session.doctor.finding import SEVERITIES
from handtrack.session.session import Session
from tests.conftest import REPOSITORY
from tests.session.small_session import edit, keypoints, make_session, write_init, write_truth


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return make_session(tmp_path)


def masks(folder: Path, camera: str, mask: np.ndarray, frames: range = range(4)) -> None:
    for frame in frames:
        cv2.imwrite(str(folder / f"masks/{camera}/{frame:03d}.png"), mask)


def test_a_sound_session_is_all_ok(folder):
    findings = examine(Session.open(folder))
    assert {finding.severity for finding in findings} == {"ok"}, findings
    assert findings[0].text == "4 frames, 0.4 s at 10 fps."


EMPTY, FULL = np.zeros((48, 64), np.uint8), np.full((48, 64), 255, np.uint8)
EDGE = EMPTY.copy()
EDGE[5:43, :30] = 255


def with_a_cloud_in_centimetres(folder: Path) -> None:
    (folder / "clouds").mkdir()
    np.savez(folder / "clouds/0.npz", points=100 * keypoints() + (0, 0, 1))
    with (folder / "session.toml").open("a") as file:
        file.write('\n[clouds]\nfiles = "clouds/*.npz"\n')


ODD: dict[str, tuple[Callable[[Path], object], str, str]] = {
    "all masks empty": (
        lambda f: masks(f, "cam1", EMPTY),
        "error",
        "camera 'cam1': all masks looked at (4) are empty.",
    ),
    "one mask empty": (
        lambda f: masks(f, "cam1", EMPTY, range(2, 3)),
        "warning",
        "camera 'cam1': 1 of 4 masks are empty, frames 2",
    ),
    "inverted": (
        lambda f: masks(f, "cam1", FULL, range(1, 3)),
        "warning",
        "in 2 of 4 masks more than half of the image is hand, frames 1-2. Are they inverted?",
    ),
    "region of interest": (
        lambda f: edit(f / "session.toml", 'name = "cam1"', 'name = "cam1"\nroi = [0, 0, 18, 48]'),
        "warning",
        "camera 'cam1': in 4 of 4 masks most of the hand lies outside of roi = [0, 0, 18, 48], frames 0-3",
    ),
    "touching": (
        lambda f: masks(f, "cam1", EDGE),
        "note",
        "camera 'cam1': in 4 of 4 masks the hand reaches the image's border, frames 0-3",
    ),
    "gap": (
        lambda f: (f / "masks/cam1/001.png").unlink(),
        "warning",
        "camera 'cam1': 3 masks of 64 x 48; 1 frames are missing: 1.",
    ),
    "lengths": (
        lambda f: (f / "masks/cam1/003.png").unlink(),
        "warning",
        "Lengths differ: camera 'cam0' 4, camera 'cam1' 3 frames.",
    ),
    "unreadable": (
        lambda f: (f / "masks/cam1/002.png").write_bytes(b"x"),
        "warning",
        "frame 2 counts as missing",
    ),
    "calibration in mm": (
        lambda f: edit(f / "calibration.toml", "[0.0, 0.0, 0.5]", "[0.0, 0.0, 500.0]"),
        "warning",
        "with world_unit_m = 1. Is calibration.toml in millimetres? Then world_unit_m = 0.001.",
    ),
    "same pose twice": (
        lambda f: edit(f / "calibration.toml", "[0.0, 0.7, 0.0]", "[0.0, 0.0, 0.0]"),
        "warning",
        "cameras 'cam0' and 'cam1' have one pose. Was it copied?",
    ),
    "matrix of another size": (
        lambda f: edit(f / "calibration.toml", "0.0, 31.5]", "0.0, 310.0]"),
        "warning",
        "camera 'cam0': the principal point (310, 24) is far from the middle of 64 x 48.",
    ),
    "focal length": (
        lambda f: edit(f / "calibration.toml", "[80.0, 0.0", "[8000.0, 0.0"),
        "warning",
        "camera 'cam0': a focal length of 8000 px is unusual for an image 64 px wide",
    ),
    "folding lens": (
        lambda f: edit(
            f / "calibration.toml", "[0.0, 0.0, 0.0, 0.0, 0.0]", "[-1.5, 0.0, 0.0, 0.0, 0.0]"
        ),
        "note",
        "camera 'cam0': the distortion folds back before the image's corners",
    ),
    "no first pose": (lambda f: (f / "init.json").unlink(), "note", "no init.json: tracking needs"),
    "small hand": (
        lambda f: write_init(f, xyz=(0.5 * keypoints()).tolist()),
        "warning",
        "init.json: from the wrist to the middle finger's knuckle it is 45 mm; expected 50 to "
        "130 mm.",
    ),
    "behind a camera": (
        lambda f: write_init(f, xyz=(keypoints() - (0, 0, 2)).tolist()),
        "warning",
        "init.json, frame 0: 21 of 21 keypoints lie behind camera 'cam0'.",
    ),
    "outside the image": (
        lambda f: write_init(f, xyz=(keypoints() + (1, 0, 0)).tolist()),
        "warning",
        "init.json, frame 0: 21 of 21 keypoints lie outside the image of camera 'cam0'.",
    ),
    "beside the mask": (
        lambda f: write_truth(
            f, keypoints21=np.repeat(keypoints()[None] + (0.15, 0, 0), 4, axis=0)
        ),
        "warning",
        "of the keypoints lie on the mask of camera 'cam0'. Do calibration, side, unit and",
    ),
    "parameters outside the image": (
        lambda f: write_init(f, xyz=None, convention=None, unit=None, parameters={"root_tx": 1.0}),
        "warning",
        "init.json, frame 0: 21 of 21 keypoints lie outside the image of camera 'cam0'.",
    ),
    "a cloud elsewhere": (
        with_a_cloud_in_centimetres,
        "warning",
        "m away from the nearest points of the cloud (median). Is the unit right",
    ),
    "the same images twice": (
        lambda f: edit(f / "session.toml", 'name = "cam1"', 'name = "cam1"\nimages = "cam0/*.png"'),
        "warning",
        "cameras 'cam0' and 'cam1' are given the same images, \"cam0/*.png\".",
    ),
    "images shorter than masks": (
        lambda f: (f / "cam0/003.png").unlink(),
        "warning",
        "Lengths differ: camera 'cam0', images 3, camera 'cam0', masks 4, camera 'cam1' 4 frames.",
    ),
    "no saved hand": (
        lambda f: edit(f / "session.toml", 'scale = "fit"', 'scale = "init.json"'),
        "error",
        "init.json: a saved hand is a TOML or JSON file",
    ),
    "a lens of another size": (
        lambda f: edit(
            f / "calibration.toml",
            "[[80.0, 0.0, 31.5], [0.0, 80.0",
            "[[40.0, 0.0, 31.5], [0.0, 40.0",
        ),
        "warning",
        "silhouettes do not fit together by this calibration: those of cameras 'cam0' and 'cam1' by ",
    ),
    "truth too long": (
        lambda f: write_truth(f, frame=np.array([2, 3, 4, 5]), time_s=None),
        "warning",
        "truth.npz: the session has no frames 4-5.",
    ),
    "truth at another rate": (
        lambda f: write_truth(f, time_s=np.arange(4) / 5),
        "warning",
        "truth.npz: its times run differently from the session's",
    ),
    "no truth": (
        lambda f: (f / "truth.npz").unlink(),
        "note",
        "no truth.npz: the tracking's error",
    ),
}


@pytest.mark.parametrize("case", ODD)
def test_odd_things_are_found(case, folder, monkeypatch):
    # whose hand it is has tests of its own, and takes longer than all the rest
    """Faults C6, C16, C22."""
    monkeypatch.setattr(check_hand, "_off_m", lambda xyz, side: 0.0)
    damage, severity, text = ODD[case]
    damage(folder)
    findings = examine(Session.open(folder))
    assert any(f.severity == severity and text in f.text for f in findings), findings
    assert all(f.severity in SEVERITIES for f in findings)


def recalibrated(change: Callable[[list[Camera]], list[Camera]]) -> str:
    """Return what the doctor says of the outlines of the bundled session with changed cameras."""
    given = Session.open(REPOSITORY / "sessions/open_fist_open")
    rig = CameraRig(tuple(change(list(given.rig.cameras))))
    found = check_outlines(Session(given.folder, given.file, rig), range(0, 100, 25))
    return " ".join(finding.text for finding in found)


def test_c28_exchanged_cameras_are_named():
    said = recalibrated(
        lambda c: [c[0], replace(c[2], name=c[1].name), replace(c[1], name=c[2].name)]
    )
    assert "They would fit if cameras 'cam1' and 'cam2' were exchanged" in said


def depth_session(folder: Path, value: int) -> Session:
    (folder / "depth").mkdir()
    for frame in range(4):
        cv2.imwrite(str(folder / f"depth/{frame}.png"), np.full((48, 64), value, np.uint16))
    setting = 'name = "cam1"\ndepth = "depth/*.png"\ndepth_scale_m = 0.001'
    edit(folder / "session.toml", 'name = "cam1"', setting)
    return Session.open(folder)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "camera 'cam1': no depth is measured in the frames looked at; all is 0."),
        (50, "camera 'cam1': the median depth is 0.05 m, with depth_scale_m = 0.001. Is the scale"),
    ],
)
def test_odd_depth_is_found(value, text, folder):
    assert any(text in finding.text for finding in examine(depth_session(folder, value)))
