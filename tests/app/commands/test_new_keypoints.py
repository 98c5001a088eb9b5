"""`handtrack new` with 2D joints of others: in a session as its own, or refused in one sentence before anything is written."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack import Session, bundled_session
from handtrack.capture.joints.given_joints import write_joints
from handtrack.capture.masks.seeded import Seeded
from handtrack.capture.masks.segmentation import SkinYCrCb
from tests.app.command_line import refused
from tests.capture.joints.hostile import HDF5, HOSTILE
from tests.capture.sample_files import hand, rig_of_two, sample
from tests.session.small_session import keypoints

RIG = ["--calibration", bundled_session() / "calibration.toml", "--fps", 30]


def test_a_session_of_joints_alone(handtrack, tmp_path):
    (left,), (right,) = (sample(f"hands/{n}", tmp_path / n) for n in ("openpose", "deeplabcut_csv"))
    ended = handtrack.does(
        "new", "--out", tmp_path / "made", *RIG, "--keypoints", f"cam0={left}", "--keypoints", f"cam1={right}",
    )  # fmt: skip
    assert "DeepLabCut's CSV, a hand in 3 frames; not a hand's, so left out: elbow." in ended.err
    session = Session.open(tmp_path / "made")
    assert session.frame_count == 3
    assert [c.keypoint_layout for c in session.file.cameras] == ["hand_right"] * 2
    first, second = (session.view(name).keypoints(2, 1.0)[0] for name in ("cam0", "cam1"))
    assert first.names == second.names
    assert first.pixels.shape == (21, 2)


def test_masks_are_made_by_the_joints_of_most_images(handtrack, tmp_path):
    size = Session.open(bundled_session()).rig["cam0"].size
    (joints,) = sample("hands/openpose", tmp_path / "joints")
    words = ["new", *RIG]
    for number, count in enumerate((6, 7)):  # joints are in 3
        (tmp_path / f"{count}").mkdir()
        for frame in range(count):
            cv2.imwrite(str(tmp_path / f"{count}" / f"{frame}.png"), np.zeros(size[::-1], np.uint8))
        words += [
            *("--images", f"cam{number}={tmp_path / str(count)}"),
            *("--keypoints", f"cam{number}={joints}"),
        ]
    ended = handtrack.does(*words, "--out", tmp_path / "made")
    assert "masks of cam0: by the joints (method seeded)." in ended.err
    first, second = Session.open(tmp_path / "made").file.cameras
    assert isinstance(first.masks, Seeded)
    assert isinstance(second.masks, SkinYCrCb)
    handtrack.does(*words, "--out", tmp_path / "named", "--masks", "skin_ycrcb")
    named = Session.open(tmp_path / "named").file.cameras
    assert all(isinstance(camera.masks, SkinYCrCb) for camera in named)


def test_shares_are_of_the_camera_s_image(handtrack, tmp_path):
    (path,) = sample("hands/mediapipe", tmp_path)
    words = ["new", "--out", tmp_path / "made", *RIG, "--side", "left"]
    handtrack.does(*words, "--keypoints", f"cam0={path}")
    session = Session.open(tmp_path / "made")
    assert (session.file.hand.side, session.file.cameras[0].keypoint_layout) == (
        "left",
        "mediapipe21",
    )
    assert session.rig["cam0"].size == (640, 480)
    seen = session.view("cam0").keypoints(0, 1.0)[0]
    expected = session.rig["cam0"].undistort_points(hand()[0, :, :2])
    assert abs(seen.pixels - expected).max() < 1e-3


@pytest.mark.parametrize("kind", [*HOSTILE, *HDF5])
def test_joints_that_cannot_be_taken_are_refused_in_a_sentence(
    kind, handtrack, tmp_path, monkeypatch
):
    if kind in HDF5:
        for library in ("h5py", "pandas", "tables"):
            pytest.importorskip(library)
    write, expected = (HOSTILE | HDF5)[kind]
    folder = tmp_path / "given"
    folder.mkdir()
    path = write(folder)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out").mkdir()
    words = ["new", "--out", tmp_path / "out", *RIG, "--keypoints", f"cam0={path}"]
    refused(handtrack, tmp_path / "out", words, expected)
    assert not (tmp_path / "harmed").exists()


@pytest.mark.parametrize(("form", "factor", "said"), [
    ("json", 100.0, "unit: in its unit, the joints make a hand 1"),
    ("colmap_text", 3.0, "unit: 0.4 m."),
])  # fmt: skip
def test_joints_tell_the_unit(form, factor, said, handtrack, tmp_path):
    """Of a rig in centimetres, which cameras alone leave open; and of one that has no unit, a proposal that `--yes` takes."""
    rig = rig_of_two()
    hand_m = keypoints() - keypoints().mean(axis=0) + [0.0, 0.0, 0.5]
    (path,) = sample(f"calibration/{form}", tmp_path)
    scaled(path, factor)
    words = ["new", "--fps", 30, "--calibration", path]
    for camera in rig:
        points = np.column_stack([camera.project(hand_m), np.ones(21)])
        folder = tmp_path / camera.name
        write_joints({0: points, 1: points}, "hand_right", folder)
        words += ["--keypoints", f"{camera.name}={folder}"]
    ended = handtrack.does(*words, "--out", tmp_path / "made", "--yes")
    assert said in ended.err
    found = Session.open(tmp_path / "made").rig["cam1"].translation / rig["cam1"].translation
    assert found == pytest.approx(1.0, abs=1e-9 if form == "json" else 0.25)

    wrong = handtrack(*words, "--out", tmp_path / "wrong", "--world-unit-m", 1)
    assert "expected 6 to 25 cm" in wrong.err


def scaled(path: Path, factor: float) -> None:
    """Write another unit of length into a calibration: JSON, or COLMAP's text."""
    if path.is_file():
        tables = json.loads(path.read_text())
        for table in tables.values():
            table["t"] = [factor * x for x in table["t"]]
        path.write_text(json.dumps(tables))
        return
    rows = [line.split() for line in (path / "images.txt").read_text().splitlines()]
    for row in rows:
        if len(row) == 10 and row[0] != "#":
            row[5:8] = [str(factor * float(x)) for x in row[5:8]]
    (path / "images.txt").write_text("\n".join(map(" ".join, rows)) + "\n")


def test_own_markers_are_refused_with_a_table_that_then_names_them(handtrack, tmp_path):
    path = tmp_path / "own.csv"
    path.write_text(
        "frame,palm_x,palm_y,D2_base_x,D2_base_y,D2_tip_x,D2_tip_y\n0,10,20,30,40,50,60\n"
    )
    words = ["new", "--out", tmp_path / "made", *RIG, "--side", "right"]
    words += ["--keypoints", f"cam0={path}", "--keypoints", f"cam1={path}"]
    assert handtrack(*words).code == 2
    assert not (tmp_path / "made").exists()
    table = tmp_path / "made-names.toml"
    text = table.read_text()
    assert "D2_tip" in text
    for ours, theirs in {"wrist": "palm", "index_mcp": "D2_base", "index_tip": "D2_tip"}.items():
        text = text.replace(f'{ours} = ""', f'{ours} = "{theirs}"')
    table.write_text(text)
    handtrack.does(*words, "--names", table)
    points = Session.open(tmp_path / "made").view("cam0").keypoints(0, 1.0)[0]
    at = points.pixels[points.names.index("index_tip")]
    np.testing.assert_allclose(
        at, Session.open(tmp_path / "made").rig["cam0"].undistort_points(np.array([50.0, 60.0]))
    )
